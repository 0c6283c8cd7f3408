"""Cores for two processes that take turns: in lock-step neither plant nor loop ever has work while the other one has.

Where cores are free each has one to itself and waits awake (hal.awake): caches stay warm, and nobody has to be woken. Where others
want the cores the two share one, asleep while they wait, and from time to time look whether they could part again; where others
want that core, too, they are let go for a moment, so that the kernel finds them a better one.
"""

from __future__ import annotations

import contextlib
import os
import time

_LOOK_S = 0.1
"""between two looks at how long this process was kept waiting"""
_CROWDED, _LOOKS = 0.2, 3
"""share of the time in which this process could have run but did not, above which two cores are too many, if so many looks in a
row say so: the kernel may have put both on one for a moment"""
_KEPT_WAITING = 0.35
"""likewise, above which the shared core is left. Each waits a little for the other: it finishes its turn after the message that
begins the next one"""
_TOGETHER_S, _LONGEST_TOGETHER_S = 1.0, 8.0
"""how long they share a core; twice as long each time that parting was no good, at most so long"""


class CorePair:
    """Cores for this process (its main thread) and one that it takes turns with. Call `look` between turns."""

    def __init__(self, other: int):
        """`other`: process id; a process that is not there, or not ours, is left alone."""
        self._processes = (0, other)
        self._allowed = os.sched_getaffinity(0)
        self._next_look = time.monotonic() + _LOOK_S
        self._waited_ns, self._looked_ns = _waited_ns(), time.monotonic_ns()
        self._together, self._part_at, self._crowded = False, 0.0, 0
        self._together_s = _TOGETHER_S
        self._move(self._allowed)  # who took turns with it before may have been killed while they shared a core

    def look(self) -> None:
        """See, a few times a second, whether these cores still are a good place for both."""
        now = time.monotonic()
        if now < self._next_look or len(self._allowed) < 2:
            return
        waited_ns, looked_ns = _waited_ns(), time.monotonic_ns()
        waiting = (waited_ns - self._waited_ns) / (looked_ns - self._looked_ns)
        self._waited_ns, self._looked_ns = waited_ns, looked_ns
        self._next_look = now + _LOOK_S
        self._crowded = self._crowded + 1 if waiting > _CROWDED else 0
        if self._together:
            if now >= self._part_at or waiting > _KEPT_WAITING:
                self._move(self._allowed)
        elif self._crowded >= _LOOKS:
            self._move({_here()})
            self._part_at = now + self._together_s
            self._together_s = min(2.0 * self._together_s, _LONGEST_TOGETHER_S)
        elif not self._crowded:
            self._together_s = _TOGETHER_S

    def close(self) -> None:
        """Let both go."""
        if self._together:
            self._move(self._allowed)

    def _move(self, cores: set[int]) -> None:
        self._together, self._crowded = cores is not self._allowed, 0
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
