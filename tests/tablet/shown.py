"""The real window on a virtual screen, with a finger, for tests."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any


class Shown:
    """An open window, its session, and a finger."""

    def __init__(self, robot: Any, meshes: Path, describe: Callable[[str], Any] | None = None):
        from PySide6.QtTest import QTest

        from tablet_client.session import Session
        from tablet_client.window import open_window

        self.robot, self.test = robot, QTest
        self.opened = open_window(
            "tcp://somewhere:47800",
            describe or (lambda _: robot.description),
            meshes,
            size=(1024, 640),
            antialiasing=0,
            operator="Ada",
        )
        self.window, self.desk = self.opened.window, self.opened.desk
        self.session = Session(robot.connect, self.desk.inbox, heartbeat=0.05, retry=0.05)
        self.desk.serve(self.session)
        self.session.start()
        self.until(self.window.isExposed)

    def turn(self, seconds: float = 0.01) -> None:
        """Let the window work. QTest.qWait would keep Python's lock, and the session's threads would starve."""
        from PySide6.QtCore import QEventLoop, QTimer

        loop = QEventLoop()
        QTimer.singleShot(round(seconds * 1000), loop.quit)
        loop.exec()

    def until(self, holds: Callable[[], Any], seconds: float = 60.0) -> Any:
        """Let the window work until something holds; returns what it became."""
        deadline = time.monotonic() + seconds
        while not (value := holds()):
            assert time.monotonic() < deadline, "did not happen in time"
            self.turn()
        return value

    def drawn(self) -> Shown:
        """Waits until the robot is there."""
        self.until(lambda: self.opened.stage.property("state") == "ready")
        return self

    def find(self, name: str) -> Any:
        from PySide6.QtCore import QObject

        found = self.window.findChild(QObject, name)
        assert found is not None, f"no {name} in the window"
        return found

    def item(self, name: str) -> Any:
        """An item by its name; those that a Repeater made are not the window's QObject children."""
        queue = [self.window.contentItem()]
        while queue:
            item = queue.pop()
            if item.objectName() == name:
                return item
            queue += item.childItems()
        raise AssertionError(f"no {name} in the window")

    def all_items(self) -> Iterator[Any]:
        queue = [self.window.contentItem()]
        while queue:
            item = queue.pop()
            if item.isVisible():
                yield item
                queue += item.childItems()

    def middle(self, name: str) -> Any:
        from PySide6.QtCore import QPointF

        item = self.item(name)
        return item.mapToScene(QPointF(item.width() / 2, item.height() / 2)).toPoint()

    def press(self, name: str) -> None:
        from PySide6.QtCore import Qt

        self.until(lambda: self.item(name).isEnabled())
        self.turn(0.02)  # let the layout settle
        self.test.mouseClick(self.window, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, self.middle(name))

    def key(self, key: Any) -> None:
        self.test.keyClick(self.window, key)

    def count(self, item: Any, colour: Any) -> int:
        """How many pixels of an item are about that colour."""
        from PySide6.QtCore import QRectF

        box = item.mapRectToScene(QRectF(0, 0, item.width(), item.height())).toRect()
        image = self.window.grabWindow().copy(box)
        near = 0
        for x in range(image.width()):
            for y in range(image.height()):
                pixel = image.pixelColor(x, y)
                off = (pixel.red() - colour.red(), pixel.green() - colour.green(), pixel.blue() - colour.blue())
                near += max(map(abs, off)) < 40
        return near

    def words(self, expression: str) -> Any:
        """A QML expression's value."""
        from PySide6.QtQml import QQmlExpression, qmlContext

        asked = QQmlExpression(qmlContext(self.find("emptyTitle")), self.find("emptyTitle"), expression)
        value, _ = asked.evaluate()
        assert not asked.hasError(), asked.error().toString()
        return value

    def node(self, name: str) -> tuple[float, float, float]:
        """Where a node of the scene stands in the world, m."""
        from PySide6.QtCore import QObject

        place = self.find("scene").findChild(QObject, name).property("scenePosition")
        return place.x(), -place.z(), place.y()  # Quick 3D has y up

    def has_node(self, name: str) -> bool:
        """Whether the scene has such a node, now: those of a list are made anew with it."""
        from PySide6.QtCore import QObject

        return self.find("scene").findChild(QObject, name) is not None

    def close(self) -> None:
        self.robot.released.set()
        self.session.close()
        self.opened.close()


def distance(one: tuple[float, ...], other: tuple[float, ...]) -> float:
    return sum((a - b) ** 2 for a, b in zip(one, other, strict=True)) ** 0.5


def judge(asking: Shown, size: tuple[int, int]) -> None:
    """Every control that is shown is at least 44 px large, has a name, and is not cut off."""
    from PySide6.QtQml import QQmlProperty, qmlContext

    controls = [
        item
        for item in asking.all_items()
        if any(item.inherits(f"QQuick{kind}") for kind in ("AbstractButton", "Slider", "TextField"))
    ]
    assert len(controls) >= 10
    for control in controls:
        name = QQmlProperty(control, "Accessible.name", qmlContext(control)).read()
        assert name, f"{control.objectName()} has no accessible name"
        assert min(control.width(), control.height()) >= 44, control.objectName()
        whole = control if (scrolled := scrolled_by(control)) is None else scrolled
        corner = whole.mapToScene(whole.boundingRect().bottomRight())
        assert corner.x() <= size[0] and corner.y() <= size[1], f"{control.objectName()} is cut off"


def scrolled_by(item: Any) -> Any:
    """The list that an item can be scrolled into sight in, or None."""
    while item is not None and not item.inherits("QQuickFlickable"):
        item = item.parentItem()
    return item
