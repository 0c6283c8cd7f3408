"""Puts the window together: models, desk, scene and QML. Knows nothing of the network; `app` and the tests bring a session."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from PySide6.QtCore import QCoreApplication, QEvent, QUrl
from PySide6.QtGui import QGuiApplication, QOffscreenSurface, QOpenGLContext
from PySide6.QtQml import QQmlApplicationEngine, QQmlError, qmlRegisterSingletonType, qmlRegisterType
from PySide6.QtQuick import QQuickWindow
from PySide6.QtQuickControls2 import QQuickStyle

from handrail.robot.description import RobotDescription
from tablet_client.camera_desk import CameraPicture
from tablet_client.canvas_desk import Lines
from tablet_client.collecting import Collector
from tablet_client.desk import FRAME, FRAME_IN_SOFTWARE, Desk
from tablet_client.models.situation import Situation
from tablet_client.scene.stage import Stage
from tablet_client.signals_desk import Trace

_log = logging.getLogger(__name__)
_QML = Path(__file__).parent / "qml"
_GL_RENDERER = 0x1F01
_SOFTWARE = ("llvmpipe", "softpipe", "swrast", "software")

NO_ANTIALIASING, WHEN_STILL, ALWAYS, SUPERSAMPLED = range(4)


@dataclass
class TabletWindow:
    """An open window and what it shows. Keep it: its parts vanish with it."""

    window: QQuickWindow
    desk: Desk
    stage: Stage
    engine: QQmlApplicationEngine
    collector: Collector

    def close(self) -> None:
        """Take the window down in an order that Qt survives: QML first, then what it was bound to."""
        self.window.frameSwapped.disconnect(self.desk.frame_swapped)
        self.desk.close()
        self.stage.close()
        self.window.close()
        self.engine.deleteLater()
        QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
        self.collector.close()


def application() -> QGuiApplication:
    """The process's one QGuiApplication, made when there is none."""
    existing = QGuiApplication.instance()
    if isinstance(existing, QGuiApplication):
        return existing
    QQuickStyle.setStyle("Basic")
    app = QGuiApplication(sys.argv[:1])
    app.setApplicationName("handrail")
    app.setApplicationDisplayName("Handrail")
    return app


def open_window(
    address: str,
    describe: Callable[[str], RobotDescription],
    meshes: Path,
    *,
    size: tuple[int, int] = (1280, 800),
    look: str = "robot",
    antialiasing: int | None = None,
    operator: str = "operator",
) -> TabletWindow:
    """Show the window. `look`: the view to start with; `antialiasing` None: what this machine's graphics can afford.

    Raises RuntimeError with QML's errors.
    """
    application()
    collector = Collector()
    _register()
    stage = Stage(describe, meshes)
    software = software_rendering()
    desk = Desk(Situation(address), stage, operator, FRAME_IN_SOFTWARE if software else FRAME)
    engine = QQmlApplicationEngine()
    problems: list[str] = []

    def note(warnings: list[QQmlError]) -> None:
        for warning in warnings:
            problems.append(warning.toString())
            _log.warning("%s", warning.toString())

    engine.warnings.connect(note)
    engine.rootContext().setContextProperty("desk", desk)
    engine.rootContext().setContextProperty("stage", stage)
    if antialiasing is None:
        antialiasing = NO_ANTIALIASING if software else ALWAYS
    engine.setInitialProperties({"smoothing": antialiasing, "look": look, "width": size[0], "height": size[1]})
    engine.load(QUrl.fromLocalFile(str(_QML / "Main.qml")))
    roots = engine.rootObjects()
    if not roots:
        raise RuntimeError("the window can't be built: " + "; ".join(problems))
    window = roots[0]
    assert isinstance(window, QQuickWindow)
    window.frameSwapped.connect(desk.frame_swapped)
    window.show()
    return TabletWindow(window, desk, stage, engine, collector)


@cache
def _register() -> None:
    for name in ("Theme", "Words", "Pages"):
        register: Any = qmlRegisterSingletonType  # takes str, whatever its stubs say
        register(QUrl.fromLocalFile(str(_QML / f"{name}.qml")), "Handrail", 1, 0, name)
    register = qmlRegisterType
    register(Trace, "Handrail", 1, 0, "Trace")
    register(Lines, "Handrail", 1, 0, "CanvasLines")
    register(CameraPicture, "Handrail", 1, 0, "CameraPicture")


@cache
def software_rendering() -> bool:
    """True where OpenGL is computed by the processor: antialiasing then costs three frames of four."""
    context, surface = QOpenGLContext(), QOffscreenSurface()
    surface.create()
    if not context.create() or not context.makeCurrent(surface):
        return True
    try:
        renderer = str(context.functions().glGetString(_GL_RENDERER) or "")
    finally:
        context.doneCurrent()
    return any(word in renderer.lower() for word in _SOFTWARE)
