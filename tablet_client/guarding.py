"""The window's side of the STOP in a process of its own (`stop_guard.py`): says that it is alive and where its STOP is."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

from PySide6.QtCore import QObject, QPointF, QTimer, Signal
from PySide6.QtQuick import QQuickItem, QQuickWindow

_BEAT_MS = 200
_AGAIN_S = 3.0  # before a guard that has died is started anew
_FRESH_S = 1.0  # what was pressed longer ago is not pressed again here: the stop may have been cleared meanwhile


class StopGuard(QObject):
    """Starts the guard once the window is drawn, keeps it alive, and ends it with the window."""

    pressed = Signal()
    """the guard's STOP was touched, just now, and it has sent it"""
    _heard = Signal(float)

    def __init__(self, window: QQuickWindow, address: str, keys: Path | None, operator: str, silent_s: float = 2.0):
        """`keys`: folder of this user's keys. `silent_s`: after which it counts as hung: longer than it ever takes to draw."""
        super().__init__()
        self._window = window
        self._command = [
            *(sys.executable, "-m", "tablet_client.stop_guard"),
            *("--address", address, "--keys", str(keys or ""), "--operator", operator, "--silent", str(silent_s)),
        ]
        stop = window.findChild(QQuickItem, "stop")
        assert stop is not None
        self._stop: QQuickItem = stop
        self.process: subprocess.Popen[bytes] | None = None
        self.in_corner = False
        """its STOP lies over the window's own"""
        self.covered = False
        """its large STOP is up: it takes the window for hung"""
        self._started = 0.0
        self._timer = QTimer(self, interval=_BEAT_MS)
        self._timer.timeout.connect(self._beat)
        self._heard.connect(self._pass_on)

    def start(self) -> None:
        """From now on; a window that is not drawn yet may take its time."""
        self._timer.start()

    def close(self) -> None:
        self._timer.stop()
        if self.process is not None:
            self._close(self.process)
            self.process = None

    @staticmethod
    def _close(process: subprocess.Popen[bytes]) -> None:
        assert process.stdin is not None
        with contextlib.suppress(OSError):
            process.stdin.close()
        with contextlib.suppress(subprocess.TimeoutExpired):  # it is still sending STOP: it ends by itself
            process.wait(2.0)

    def _beat(self) -> None:
        if not self._window.isExposed() and self.process is None:
            return
        if self.process is None or self.process.poll() is not None:
            if time.monotonic() - self._started < _AGAIN_S:
                return
            self._spawn()
        assert self.process is not None and self.process.stdin is not None
        # A guard that does not read loses beats; the window must not wait for it.
        with contextlib.suppress(BlockingIOError, BrokenPipeError):
            os.write(self.process.stdin.fileno(), self._told())

    def _spawn(self) -> None:
        self._started, self.in_corner, self.covered = time.monotonic(), False, False
        self.process = subprocess.Popen(
            self._command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=os.name == "posix",  # Ctrl-C is for the window; this one ends with it
        )
        assert self.process.stdin is not None
        if hasattr(os, "set_blocking"):  # for pipes on Windows from Python 3.12 on
            os.set_blocking(self.process.stdin.fileno(), False)
        threading.Thread(target=self._hear, args=(self.process,), name="tablet-guard", daemon=True).start()

    def _hear(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None
        for line in process.stdout:
            told = line.strip()
            self.covered = told == b"shown" or (self.covered and told != b"hidden")
            self.in_corner |= told == b"in_corner"
            if told == b"pressed":
                self._heard.emit(time.monotonic())

    def _pass_on(self, at: float) -> None:
        if time.monotonic() - at < _FRESH_S:
            self.pressed.emit()

    def _told(self) -> bytes:
        window, stop = self._window, self._stop
        corner = stop.mapToScene(QPointF(0, 0))
        place = window.geometry()
        told = {
            "window": int(window.winId()),
            "shown": window.isVisible() and window.visibility() != QQuickWindow.Visibility.Minimized,
            "place": [place.x(), place.y(), place.width(), place.height()],
            "stop": [round(corner.x()), round(corner.y()), round(stop.width()), round(stop.height())],
            "said": stop.property("said"),
            "ground": stop.property("behind").name(),
        }
        return json.dumps(told).encode() + b"\n"
