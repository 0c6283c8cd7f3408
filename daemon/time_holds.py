"""Who holds simulated time: in lock-step, an engine that computes may make the robot wait for it.

A hold names its owner and ends by itself after its limit of wall time, so that a dead owner stops nothing for long.
"""

from __future__ import annotations

import time

from daemon.exchange import MAX_HOLDS


class TimeHolds:
    """Holds of simulated time, one an owner. Under the wall clock nobody can hold time and all of this does nothing."""

    def __init__(self, lockstep: bool):
        self._lockstep = lockstep
        self._until: dict[int, float] = {}

    def add(self, owner: int, limit_s: float) -> bool:
        """Hold for `owner` from now, at most `limit_s` of wall time; replaces its earlier hold. False: too many owners."""
        if not self._lockstep:
            return True
        self.active()
        if owner not in self._until and len(self._until) >= MAX_HOLDS:
            return False
        self._until[owner] = time.monotonic() + limit_s
        return True

    def release(self, owner: int) -> None:
        """End `owner`'s hold, if it has one."""
        self._until.pop(owner, None)

    def release_all(self) -> None:
        """End every hold."""
        self._until.clear()

    def active(self) -> list[int]:
        """Owners whose hold has not run out."""
        if self._until:
            now = time.monotonic()
            self._until = {owner: until for owner, until in self._until.items() if until > now}
        return list(self._until)

    def remaining(self) -> float:
        """s of wall time until the next hold runs out; 0 without one."""
        return max(0.0, min(self._until.values(), default=0.0) - time.monotonic())
