"""The real window on a virtual screen, with a finger, for tests."""

from __future__ import annotations

import gc
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any


class Shown:
    """An open window, its session, and a finger."""

    def __init__(self, robot: Any, meshes: Path, describe: Callable[[str], Any] | None = None):
        from PySide6.QtTest import QTest

        from tablet_client.session import Session
        from tablet_client.window import open_window

        self.robot, self.test = robot, QTest
        self.touch: Any = None
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
        self.frames = 0
        self.window.frameSwapped.connect(self._swapped)
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

    def there(self, name: str) -> bool:
        """Whether such an item is in sight, or can be scrolled there."""
        return any(item.objectName() == name for item in self.all_items())

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

        self.until(lambda: self.item(name).isEnabled() and self.item(name).isVisible())
        self._settle(name)
        self.test.mouseClick(self.window, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, self.middle(name))

    def _swapped(self) -> None:
        self.frames += 1

    def _settle(self, name: str) -> None:
        """Brings an item into sight, and waits until it stands still: layouts are made frame by frame, and a frame may be late."""
        before = None
        while True:
            self.reveal(self.item(name))
            if before == (before := self.middle(name)):
                return
            count = self.frames
            self.window.update()
            self.until(lambda count=count: self.frames > count)

    def reveal(self, item: Any) -> None:
        """Scrolls what it lies in, if anything, until it is in sight."""
        from PySide6.QtCore import QRectF

        list_ = item.parentItem()
        while list_ is not None and not list_.inherits("QQuickFlickable"):
            list_ = list_.parentItem()
        if list_ is not None:
            content = list_.property("contentItem")
            box = item.mapRectToItem(content, QRectF(0, 0, item.width(), item.height()))
            least, most = box.bottom() - list_.height(), box.top()
            list_.setProperty("contentY", min(max(list_.property("contentY"), least), max(most, 0.0)))

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

    def page(self, name: str) -> None:
        """Opens a page of the rail."""
        self.words(f"Pages.open('{name}')")

    def pages(self) -> list[str]:
        """Names of all pages."""
        return list(self.words("Pages.all.map(page => page.name).join(' ')").split())

    def words(self, expression: str) -> Any:
        """A QML expression's value."""
        from PySide6.QtQml import QQmlExpression, qmlContext

        asked = QQmlExpression(qmlContext(self.find("emptyTitle")), self.find("emptyTitle"), expression)
        value, _ = asked.evaluate()
        assert not asked.hasError(), asked.error().toString()
        return value

    def spot(self, point: tuple[float, ...]) -> Any:
        """The window's pixel that shows a point of the world, as Quick 3D itself says."""
        from PySide6.QtCore import QPointF
        from PySide6.QtQml import QQmlExpression, qmlContext

        x, y, z = point
        scene = self.find("scene")
        expression = QQmlExpression(qmlContext(scene), scene, f"mapFrom3DScene(Qt.vector3d({x}, {z}, {-y}))")
        at, _ = expression.evaluate()
        return scene.mapToScene(QPointF(at.x(), at.y())).toPoint()

    def arrow(self, axis: int, by: float = 0.0, *, share: float = 1.0) -> tuple[float, ...]:
        """Where an arrow's tip is in the world, of the handle on an instance that is not turned, or `by` m further along it.

        `share` of the arrow's length: from 0.35, where it begins, to its tip.
        """
        place = list(self.opened.stage.property("handle").toTuple())
        place[axis] += share * self.find("handle").property("length") + by
        return tuple(place)

    @contextmanager
    def finger(self, at: Any) -> Iterator[Finger]:
        """A finger that is on the screen, and is lifted in the end."""
        finger = Finger(self, at)
        yield finger
        finger.lift()

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
        self.window.frameSwapped.disconnect(self._swapped)
        self.opened.close()
        del self.opened, self.window, self.desk  # whoever still has this, as pytest has, does not keep them


@contextmanager
def closed_here() -> Iterator[list[Shown]]:
    """Windows that are put into the list are closed in the end, and collected on this thread: see `tablet_client.collecting`.

    What a slot raises goes to Python's hook only, and whatever else that slot was to do is not done: it fails the test.
    """
    by_itself, opened = gc.isenabled(), list[Shown]()
    raised, said = list[BaseException](), sys.excepthook

    def hook(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
        raised.append(error)
        said(kind, error, trace)

    gc.disable()
    sys.excepthook = hook
    try:
        yield opened
    finally:
        sys.excepthook = said
        for shown in opened:
            shown.close()
        opened.clear()
        gc.collect()
        if by_itself:
            gc.enable()
    assert not raised, f"a slot of the window raised {raised}"


class Finger:
    """On the window's screen, at a pixel of it."""

    def __init__(self, shown: Shown, at: Any):
        self._shown, self._at = shown, at
        if shown.touch is None:
            shown.touch = shown.test.createTouchDevice()
        self._event().press(0, at, shown.window).commit()

    def _event(self) -> Any:
        return self._shown.test.touchEvent(self._shown.window, self._shown.touch)

    def to(self, there: Any, steps: int = 10) -> None:
        """Moves it."""
        start = self._at
        for step in range(1, steps + 1):
            self._at = start + (there - start) * step / steps
            self._event().move(0, self._at, self._shown.window).commit()
            self._shown.turn(0.005)

    def lift(self) -> None:
        self._event().release(0, self._at, self._shown.window).commit()


def distance(one: tuple[float, ...], other: tuple[float, ...]) -> float:
    return sum((a - b) ** 2 for a, b in zip(one, other, strict=True)) ** 0.5


def judge(asking: Shown, size: tuple[int, int]) -> int:
    """Every control that is shown is at least 44 px large, has a name, is reached by Tab, and is not cut off.

    Returns how many of them are the open page's own.
    """
    from PySide6.QtQml import QQmlProperty, qmlContext

    controls = [item for item in asking.all_items() if is_control(item)]
    assert len(controls) >= 10
    for control in controls:
        name = QQmlProperty(control, "Accessible.name", qmlContext(control)).read()
        assert name, f"{control.objectName()} has no accessible name"
        assert min(control.width(), control.height()) >= 44, (control.objectName(), control.width(), control.height())
        assert control.property("activeFocusOnTab"), f"{control.objectName()} is not reached by the keyboard"
        whole = control if (scrolled := scrolled_by(control)) is None else scrolled
        corner = whole.mapToScene(whole.boundingRect().bottomRight())
        assert corner.x() <= size[0] and corner.y() <= size[1], f"{control.objectName()} is cut off"
    page = "page_" + asking.words("Pages.current")
    return sum(within(control, page) for control in controls)


def is_control(item: Any) -> bool:
    """Whether a finger or a key does something with it. What holds other controls, and keeps fingers from others, is none."""
    if any(item.inherits(f"QQuick{kind}") for kind in ("AbstractButton", "Slider", "TextField", "TextArea")):
        return True
    tapped = any(child.inherits("QQuickTapHandler") and child.property("enabled") for child in item.children())
    return tapped and not any(each.inherits("QQuickAbstractButton") for each in below(item))


def below(item: Any) -> Iterator[Any]:
    """All items that an item holds."""
    for child in item.childItems():
        yield child
        yield from below(child)


def within(item: Any, name: str) -> bool:
    """Whether an item lies in one of this name."""
    while item is not None and item.objectName() != name:
        item = item.parentItem()
    return item is not None


def scrolled_by(item: Any) -> Any:
    """The list that an item can be scrolled into sight in, or None."""
    while item is not None and not item.inherits("QQuickFlickable"):
        item = item.parentItem()
    return item
