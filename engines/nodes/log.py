"""What a node prints: lines that come to its host, as many a second as a person could read."""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections import deque
from collections.abc import Callable

from engines.nodes.reactor import REACTOR

LINES_A_SECOND = 50
_LONGEST = 2000
_KEPT = 5


class NodeLog:
    """The reading end of a node's standard output and error. The node never waits for it."""

    def __init__(self, said: Callable[[str], None]):
        """:param said: called in the reactor's thread, with each line"""
        self._said = said
        self._read, self.write_fd = os.pipe2(os.O_CLOEXEC)
        os.set_blocking(self._read, False)
        self._partial = b""
        self._since, self._lines, self._left_out = 0.0, 0, 0
        self.last: deque[str] = deque(maxlen=_KEPT)
        self.ended = threading.Event()
        REACTOR.add(self, self._heard)

    def fileno(self) -> int:
        return self._read

    def _heard(self) -> None:
        with contextlib.suppress(BlockingIOError):
            data = os.read(self._read, 1 << 16)
            *lines, self._partial = (self._partial + data).split(b"\n")
            if len(self._partial) > _LONGEST or (not data and self._partial):
                lines, self._partial = [*lines, self._partial], b""
            for line in lines:
                self._line(line[:_LONGEST].decode(errors="replace").rstrip())
            if not data:
                self._tell_left_out()
                REACTOR.remove(self)
                os.close(self._read)
                self.ended.set()

    def _line(self, text: str) -> None:
        now = time.monotonic()
        if now - self._since >= 1.0:
            self._tell_left_out()
            self._since, self._lines = now, 0
        self.last.append(text)
        self._lines += 1
        if self._lines <= LINES_A_SECOND:
            self._said(text)
        else:
            self._left_out += 1

    def _tell_left_out(self) -> None:
        if self._left_out:
            self._said(f"({self._left_out} lines were left out: more than {LINES_A_SECOND} a second)")
        self._left_out = 0
