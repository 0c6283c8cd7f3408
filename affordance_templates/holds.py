"""Who drags what: nobody else may move it meanwhile."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

HOLD_S = 2.0
"""s after its holder's last call about the instance, a hold has ended"""


@dataclass
class _Hold:
    by: str
    until: float
    number: int


class Holds:
    """Not safe to share between threads: the affordance server locks."""

    def __init__(self, clock: Callable[[], float] = time.monotonic):
        self._clock = clock
        self._holds: dict[str, _Hold] = {}
        self._count = time.time_ns()  # steps on disk know the holds of the process before this one

    def holder(self, name: str) -> str:
        """Who holds an instance; empty: nobody."""
        hold = self._alive(name)
        return "" if hold is None else hold.by

    def number(self, name: str, by: str) -> int:
        """Of this operator's hold on an instance; 0: there is none."""
        hold = self._alive(name)
        return 0 if hold is None or hold.by != by else hold.number

    def take(self, name: str, by: str) -> bool:
        """Take or renew a hold. False: somebody else has one."""
        hold = self._alive(name)
        if hold is None:
            self._count += 1
            self._holds[name] = _Hold(by, self._clock() + HOLD_S, self._count)
            return True
        self.renew(name, by)
        return hold.by == by

    def renew(self, name: str, by: str) -> None:
        """Its holder was heard."""
        hold = self._alive(name)
        if hold is not None and hold.by == by:
            hold.until = self._clock() + HOLD_S

    def end(self, name: str, by: str) -> bool:
        """Let go. False: this operator did not hold it."""
        hold = self._holds.get(name)
        if hold is None or hold.by != by:
            return False
        del self._holds[name]
        return True

    def forget(self, name: str) -> None:
        """The instance is gone."""
        self._holds.pop(name, None)

    def expired(self) -> list[str]:
        """Instances whose hold has ended by itself; each is told once."""
        ended = [name for name in self._holds if self._alive(name) is None]
        for name in ended:
            del self._holds[name]
        return ended

    @property
    def next_end_s(self) -> float | None:
        """s until the next one may end; None: there is none."""
        return min((hold.until - self._clock() for hold in self._holds.values()), default=None)

    def _alive(self, name: str) -> _Hold | None:
        hold = self._holds.get(name)
        return hold if hold is not None and self._clock() < hold.until else None
