"""One thread that listens to all nodes of a process: a thread a node would wake this process as often as all of them together."""

from __future__ import annotations

import contextlib
import logging
import os
import selectors
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Protocol


class _HasFileno(Protocol):
    def fileno(self) -> int: ...


class Reactor:
    """Calls back when something may be read, and now and then. Nothing that it calls may wait."""

    LOOK_S = 0.25
    """between two looks"""

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()
        self._wake_read, self._wake_write = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self._selector.register(self._wake_read, selectors.EVENT_READ, None)
        self._changes: deque[Callable[[], None]] = deque()
        self._looks: dict[object, Callable[[], None]] = {}
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None

    def add(self, readable: _HasFileno, heard: Callable[[], None]) -> None:
        """From any thread: call `heard` whenever there is something to read."""
        self.call(lambda: self._selector.register(readable, selectors.EVENT_READ, heard) and None)

    def remove(self, readable: _HasFileno) -> None:
        """From any thread; once this returns, what was added is not listened to any more."""
        done = threading.Event()

        def forget() -> None:
            with contextlib.suppress(KeyError, ValueError):
                self._selector.unregister(readable)
            done.set()

        if threading.current_thread() is self._thread:
            forget()
        else:
            self.call(forget)
            done.wait()

    def look(self, owner: object, look: Callable[[], None] | None) -> None:
        """From any thread: call `look` every `LOOK_S`, for an owner; None: no more."""
        with self._lock:
            if look is None:
                self._looks.pop(owner, None)
            else:
                self._looks[owner] = look
        self.call(lambda: None)

    def call(self, change: Callable[[], None]) -> None:
        """From any thread: call it once, in the reactor's."""
        self._changes.append(change)
        with self._lock:
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="nodes", daemon=True)
                self._thread.start()
        with contextlib.suppress(BlockingIOError):
            os.write(self._wake_write, b"!")

    def _run(self) -> None:
        due = time.monotonic()
        while True:
            with self._lock:
                idle = not self._looks
            for key, _ in self._selector.select(None if idle else max(0.0, due - time.monotonic())):
                if key.data is None:
                    with contextlib.suppress(BlockingIOError):
                        os.read(self._wake_read, 4096)
                elif self._selector.get_map().get(key.fileobj) is key:  # none of those just dealt with has removed it
                    _safely(key.data)
            while self._changes:
                _safely(self._changes.popleft())
            # After all that has come was read: what is waiting unread is a sign of life, too.
            if time.monotonic() >= due:
                with self._lock:
                    looks = list(self._looks.values())
                for look in looks:
                    _safely(look)
                due = time.monotonic() + self.LOOK_S


def _safely(call: Callable[[], None]) -> None:
    try:
        call()
    except Exception:
        # What is wrong with one node must not leave all others unheard.
        logging.exception("what came from a node could not be dealt with")


REACTOR = Reactor()
"""of this process"""
