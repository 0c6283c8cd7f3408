"""One core for two processes that take turns: in lock-step neither plant nor loop ever has work while the other one has.

On two cores each turn begins with waking a core that has gone idle, which on a virtual machine costs 50 µs and cold caches; on one
core it is a switch of context. Where others want that core too, the two are let go for a moment, so that the kernel finds them a
better place, and stay together there.
"""

from __future__ import annotations

import contextlib
import os
import time

_LOOK_S = 0.1
"""between two looks at how long this process was kept waiting"""
_KEPT_WAITING = 0.35
"""share of the time in which it could have run but did not, above which the core is left. Each waits a little for the other: it
finishes its turn after the message that begins the next one"""
_AT_LARGE_S = 0.2
"""how long the kernel may look for a better place"""


class SharedCore:
    """Keeps this process (its main thread) and one that it takes turns with on the same core. Call `look` between turns."""

    def __init__(self, other: int):
        """`other`: process id; a process that is not there, or not ours, is left alone."""
        self._processes = (0, other)
        self._allowed = os.sched_getaffinity(0)
        self._next_look = time.monotonic()
        self._waited_ns = self._looked_ns = 0
        self._together = False

    def look(self) -> None:
        """See, a few times a second, whether this core still is a good place for both."""
        now = time.monotonic()
        if now < self._next_look or len(self._allowed) < 2:
            return
        waited_ns, looked_ns = _waited_ns(), time.monotonic_ns()
        kept_waiting = waited_ns - self._waited_ns > _KEPT_WAITING * (looked_ns - self._looked_ns)
        self._waited_ns, self._looked_ns = waited_ns, looked_ns
        if not self._together:
            self._move({_here()})
        elif kept_waiting:
            self._move(self._allowed)
        self._next_look = now + (_LOOK_S if self._together else _AT_LARGE_S)

    def close(self) -> None:
        """Let both go."""
        if self._together:
            self._move(self._allowed)

    def _move(self, cores: set[int]) -> None:
        self._together = cores is not self._allowed
        for process in self._processes:
            with contextlib.suppress(OSError):
                os.sched_setaffinity(process, cores)


def _waited_ns() -> int:
    """How long this process has stood in a core's queue (proc(5), schedstat); 0 where the kernel does not count it."""
    with contextlib.suppress(OSError, IndexError):
        return int(_read("/proc/self/schedstat").split()[1])
    return 0


def _here() -> int:
    """The core that this process runs on (proc(5), stat, field 39)."""
    return int(_read("/proc/self/stat").rpartition(b")")[2].split()[36])


def _read(path: str) -> bytes:
    # Several times a second between two turns of the loop: pathlib and decoding would cost as much again as the kernel does.
    descriptor = os.open(path, os.O_RDONLY)
    try:
        return os.read(descriptor, 1024)
    finally:
        os.close(descriptor)
