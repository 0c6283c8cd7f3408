"""Python's garbage is collected on the window's thread alone."""

from __future__ import annotations

import gc

from PySide6.QtCore import QObject, QTimer

_LOOK_MS = 1000


class Collector(QObject):
    """Collects cyclic garbage from a timer of the thread that makes this, as often as Python's thresholds say, and nowhere else.

    Python collects on whatever thread happens to allocate. Where that takes down an object of Qt's that has a running timer, Qt
    can't stop the timer from there, and calls the object later, which is gone: the process crashes.
    """

    def __init__(self) -> None:
        super().__init__()
        self._by_itself = gc.isenabled()
        gc.disable()
        self._timer = QTimer(self, interval=_LOOK_MS)
        self._timer.timeout.connect(self._look)
        self._timer.start()

    def _look(self) -> None:
        due = [
            number
            for number, (count, most) in enumerate(zip(gc.get_count(), gc.get_threshold(), strict=True))
            if count > most
        ]
        if due:
            gc.collect(due[-1])

    def close(self) -> None:
        """Let Python collect again as before."""
        self._timer.stop()
        if self._by_itself:
            gc.enable()
