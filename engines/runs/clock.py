"""The time that a run has had: the robot's clock, without the pauses. Time-outs of a program's states count by it."""

from __future__ import annotations

import heapq
import itertools
import threading
from collections.abc import Callable

_JUMP_NS = 5_000_000_000
"""a step of the robot's clock beyond this is another clock (a plant that was started anew), not time that went by"""


class RunClock:
    """Calls back when a time is over. Every method may be called from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._last: int | None = None
        self._elapsed = 0
        self._stands = False
        self._due: list[tuple[int, int, Callable[[], None]]] = []
        self._numbers = itertools.count()

    def tick(self, time_ns: int) -> None:
        """The robot's clock, as it is heard; calls what is due from this thread."""
        with self._lock:
            step = 0 if self._last is None else time_ns - self._last
            self._last = time_ns
            if not self._stands and 0 < step < _JUMP_NS:
                self._elapsed += step
            ready = []
            while self._due and self._due[0][0] <= self._elapsed:
                ready.append(heapq.heappop(self._due)[2])
        for call in ready:
            call()

    @property
    def elapsed_s(self) -> float:
        """s that the run has had."""
        with self._lock:
            return self._elapsed / 1e9

    def skip(self) -> bool:
        """Let the time go by until what is due next, and call it. False when nothing is."""
        with self._lock:
            if not self._due:
                return False
            self._elapsed, _, call = heapq.heappop(self._due)
        call()
        return True

    def after(self, seconds: float, call: Callable[[], None]) -> Callable[[], None]:
        """Have `call` called once so much of the run's time is over. Returns what takes it back."""
        with self._lock:
            entry = (self._elapsed + round(seconds * 1e9), next(self._numbers), call)
            heapq.heappush(self._due, entry)

        def take_back() -> None:
            with self._lock:
                if entry in self._due:
                    self._due.remove(entry)
                    heapq.heapify(self._due)

        return take_back

    def stand(self) -> None:
        """No time goes by until `go`."""
        with self._lock:
            self._stands = True

    def go(self) -> None:
        """Time goes by again."""
        with self._lock:
            self._stands = False
