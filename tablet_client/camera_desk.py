"""The camera's inset: its latest picture as QML draws it, made only while someone looks, and no more often than one can look."""

from __future__ import annotations

import time
from typing import Any

from PySide6.QtCore import Property, QObject, QRectF, Signal, Slot
from PySide6.QtGui import QImage, QPainter
from PySide6.QtQuick import QQuickPaintedItem

from tablet_client.models.camera_picture import picture
from tablet_client.models.clouds import Seen
from tablet_client.models.situation import Situation

_WIDTH, _HEIGHT = 288, 216
_PAUSE_S = 0.4  # between two pictures: making one takes some ten milliseconds of the window's own thread
_MAP: Any = "QVariantMap"  # PySide takes the names of Qt's types; its stubs do not


class CameraDesk(QObject):
    """What QML reads of the inset, and calls."""

    changed = Signal()
    drawn = Signal()

    def __init__(self, situation: Situation):
        super().__init__()
        self._situation = situation
        self._open = False
        self._seen: Seen | None = None
        self._made = 0.0
        self._view: dict[str, Any] = {"open": False, "camera": "", "cameras": []}
        self._chosen = ""
        self.image = QImage()

    @Property(_MAP, notify=changed)
    def view(self) -> dict[str, Any]:
        return self._view

    @Slot(bool)
    def open(self, on: bool) -> None:
        self._open, self._seen, self._made = on, None, 0.0
        self.build()

    @Slot(str)
    def choose(self, camera: str) -> None:
        """Another camera's."""
        self._chosen, self._seen, self._made = camera, None, 0.0
        self.build()

    def build(self) -> None:
        """Look at the clouds anew."""
        cameras = self._situation.clouds.seen
        camera = self._chosen if self._chosen in cameras else next(iter(cameras), "")
        view = {"open": self._open and bool(camera), "camera": camera, "cameras": list(cameras)}
        if view != self._view:
            self._view = view
            self.changed.emit()
        seen, now = cameras.get(camera), time.monotonic()
        if not view["open"] or seen is None or seen is self._seen or now - self._made < _PAUSE_S:
            return
        self._seen, self._made = seen, now
        pixels = picture(seen.points.positions, seen.points.colours, seen.origin, _WIDTH, _HEIGHT)
        self.image = QImage(pixels.tobytes(), _WIDTH, _HEIGHT, 3 * _WIDTH, QImage.Format.Format_RGB888).copy()
        self.drawn.emit()


class CameraPicture(QQuickPaintedItem):
    """Draws a CameraDesk's picture."""

    deskChanged = Signal()

    def __init__(self, parent: Any = None):
        super().__init__(parent)
        self._desk: CameraDesk | None = None

    def _get_desk(self) -> CameraDesk | None:
        return self._desk

    def _set_desk(self, desk: CameraDesk) -> None:
        self._desk = desk
        desk.drawn.connect(self.update)
        self.deskChanged.emit()

    desk = Property(QObject, _get_desk, _set_desk, notify=deskChanged)

    def paint(self, painter: QPainter) -> None:
        if self._desk is not None and not self._desk.image.isNull():
            painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
            painter.drawImage(QRectF(0, 0, self.width(), self.height()), self._desk.image)
