"""STOP in a process of its own: it hears a touch also while the window's own thread hangs.

`python -m tablet_client.stop_guard --address ADDRESS --keys FOLDER --operator NAME`, started by `guarding.StopGuard`, which tells
it on standard input, some times a second and from the window's own thread, that the window is alive and where its STOP is.

- On X11 this process's STOP lies in the window's corner as a child of the window: the server itself brings its touches here.
- Wherever it is, once the window has been silent for some time, a STOP as large as the window comes up: a touch anywhere on it,
  or any key, stops the robot. It goes when the window is alive again.

It ends when its input does. On standard output it says `pressed`, `in_corner` when it lies there, and of the large one `shown` and
`hidden`.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from PySide6.QtCore import QCoreApplication, QEvent, QObject, QRect, Qt, QTimer, Signal
from PySide6.QtGui import QColor, QGuiApplication, QPainter, QRasterWindow, QWindow

from handrail.client import connect
from tablet_client.models.arrivals import StopProgress
from tablet_client.stopper import Stopper

_LOOK_MS = 100
_RED, _PRESSED, _PALE = QColor("#e3261c"), QColor("#a5140c"), QColor("#ffd9d6")


def _words(text: str) -> str:
    return QCoreApplication.translate("StopGuard", text)


class _Stop(QRasterWindow):
    """A STOP that fills its window."""

    def __init__(self, press: Callable[[], None]):
        super().__init__()
        self._press = press
        self._down = False
        self.large = False
        self.said = ""
        self.ground = "#141a20"

    def event(self, event: QEvent) -> bool:
        kind = event.type()
        if kind in (QEvent.Type.MouseButtonPress, QEvent.Type.TouchBegin, QEvent.Type.KeyPress):
            event.accept()
            self._down = True
            self._press()
            self.update()
            return True
        if kind in (QEvent.Type.MouseButtonRelease, QEvent.Type.TouchEnd, QEvent.Type.KeyRelease):
            self._down = False
            self.update()
            return True
        if kind == QEvent.Type.Close:
            event.ignore()
            return True
        return super().event(event)

    def say(self, text: str, ground: str) -> None:
        if (text, ground) != (self.said, self.ground):
            self.said, self.ground = text, ground
            self.update()

    def paintEvent(self, event: Any) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        width, height = self.width(), self.height()
        painter.fillRect(0, 0, width, height, QColor(self.ground))
        unit = height / 56 if not self.large else min(height / 640, width / 1024) * 2.6  # StopButton.qml's pixels
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(_PRESSED if self._down else _RED)
        painter.drawRoundedRect(0, 0, width, height, 10 * unit, 10 * unit)
        font = painter.font()
        font.setPixelSize(round((64 if self.large else 22) * unit))
        font.setBold(True)
        painter.setFont(font)
        painter.setPen(QColor("white"))
        painter.drawText(
            QRect(0, 0, width, round(height * (0.6 if self.large else 0.72))),
            Qt.AlignmentFlag.AlignCenter,
            _words("STOP"),
        )
        font.setPixelSize(round((9.5 if self.large else 11.5) * unit))
        font.setBold(self.large)
        painter.setFont(font)
        painter.setPen(_PALE)
        below = QRect(round(8 * unit), round(height * 0.54), width - round(16 * unit), round(height * 0.4))
        painter.drawText(below, Qt.AlignmentFlag.AlignCenter | Qt.TextFlag.TextWordWrap, self.said)
        painter.end()


class Guard(QObject):
    """What this process does."""

    _beat = Signal(dict)
    _ended = Signal()
    _progressed = Signal(str)

    def __init__(self, address: str, keys: str, operator: str, silent_s: float):
        super().__init__()
        self._silent_s = silent_s
        self._operator = operator
        self._stopper = Stopper(connect(address, keys or None, timeout_s=0), self._progress)
        self._stopper.start()
        self._last: dict[str, Any] = {}
        self._heard = 0.0
        self._state = ""
        self._hung = self._over = False
        self._corner: _Stop | None = None
        self._window: QWindow | None = None
        self._cover = _Stop(self._press)
        self._cover.large = True
        self._cover.setTitle("STOP")
        self._cover.setFlags(Qt.WindowType.FramelessWindowHint | Qt.WindowType.WindowStaysOnTopHint)
        self._beat.connect(self._alive)
        self._ended.connect(self._end)
        self._progressed.connect(self._show_progress)
        self._look = QTimer(self, interval=_LOOK_MS)
        self._look.timeout.connect(self._watch)
        self._look.start()
        threading.Thread(target=self._listen, name="stop-guard-input", daemon=True).start()

    def _listen(self) -> None:
        for line in sys.stdin:
            self._beat.emit(json.loads(line))
        self._ended.emit()

    def _end(self) -> None:
        """The window has gone: so does this process, as soon as no STOP is on its way any more."""
        self._over = True
        if self._state != "sending":
            os._exit(0)  # with another process's window as parent, Qt's own way out takes seconds

    def _alive(self, beat: dict[str, Any]) -> None:
        self._last, self._heard = beat, time.monotonic()
        if self._hung:
            self._hung = False
            self._state = ""
            self._cover.hide()
            print("hidden", flush=True)
        if QGuiApplication.platformName() == "xcb":
            self._lie_in_corner(beat)

    def _lie_in_corner(self, beat: dict[str, Any]) -> None:
        """Be where the window has its own STOP, as its child."""
        if self._corner is None:
            self._window = QWindow.fromWinId(beat["window"])
            if self._window is None:
                return
            self._corner = _Stop(self._press)
            self._corner.setParent(self._window)
        place = QRect(*beat["stop"])
        if self._corner.geometry() != place:
            self._corner.setGeometry(place)
        if not self._corner.isVisible():
            self._corner.show()
            print("in_corner", flush=True)
        self._corner.say(self._text(beat["said"]), beat["ground"])

    def _watch(self) -> None:
        """Look whether the window is silent."""
        if not self._heard or not self._last["shown"] or self._hung or time.monotonic() - self._heard < self._silent_s:
            return
        self._hung = True
        self._say_hung()
        if QGuiApplication.platformName().startswith("wayland"):
            self._cover.showFullScreen()  # nobody may place a window there
        else:
            self._cover.setGeometry(QRect(*self._last["place"]))
            self._cover.show()
        self._cover.raise_()
        self._cover.requestActivate()
        print("shown", flush=True)

    def _say_hung(self) -> None:
        told = self._text(_words("Touch anywhere here, or press any key, to stop the robot."))
        self._cover.say(_words("The window does not react.") + "\n" + told, self._last["ground"])

    def _text(self, otherwise: str) -> str:
        return {
            "sending": _words("sending …"),
            "answered": _words("The robot has confirmed the stop.") if self._hung else otherwise,
            "failed": _words("NOT CONFIRMED: use the robot's emergency stop"),
        }.get(self._state, otherwise)

    def _press(self) -> None:
        why = "at the tablet, whose window hung" if self._hung else "at the tablet"
        self._stopper.stop(f"{self._operator}, {why}")
        print("pressed", flush=True)

    def _progress(self, news: StopProgress) -> None:
        self._progressed.emit(news.state)

    def _show_progress(self, state: str) -> None:
        self._state = state
        if self._over:
            self._end()
        if self._hung:
            self._say_hung()
        if self._corner is not None:
            self._corner.say(self._text(self._last["said"]), self._last["ground"])


def main() -> None:
    """Guard until standard input ends."""
    parser = argparse.ArgumentParser(
        prog="tablet_client.stop_guard", description="The tablet's STOP beside the window."
    )
    parser.add_argument("--address", required=True)
    parser.add_argument("--keys", default="")
    parser.add_argument("--operator", default="operator")
    parser.add_argument("--silent", type=float, default=2.0)
    given = parser.parse_args()
    app = QGuiApplication(sys.argv[:1])
    app.setQuitOnLastWindowClosed(False)
    guard = Guard(given.address, given.keys, given.operator, given.silent)
    app.exec()
    del guard


if __name__ == "__main__":
    main()
