"""Whether a robot on its own feet is falling: a function of how it stood in the cycles before."""

from __future__ import annotations

from daemon.exchange import Rule
from daemon.safety.rules import Trip
from daemon.state.stance import Stance

OUTSIDE = 0.05
"""m by which the capture point may be outside the hull of the feet that hold: arms and hips bring it back from there"""
PATIENCE = 0.1
"""s for which it may be further; a foot that bounces holds nothing so long"""
_STANDS, _SETTLES = 0.5, 0.2
"""share of its weight that its feet bear, and s of that with the capture point inside, from which on it stands by itself"""


class BalanceWatch:
    """Watches a robot from when it stands by itself; what hangs in a gantry has nothing to lose."""

    def __init__(self, period: float):
        """`period`: of the loop, s."""
        self._period = period
        self.stands = False
        """it stands by itself, or did until it began to fall"""
        self._settled = self._lost = 0

    def forget(self) -> None:
        """Nobody commands the robot: what becomes of it is no fall of the daemon's."""
        self.stands, self._settled, self._lost = False, 0, 0

    def update(self, stance: Stance, *, known: bool, hangs: bool) -> Trip | None:
        """Once a cycle. The rule by which every motion must end in this one; None: all is well.

        `known`: somebody tells where the base is; `hangs`: that it hangs still.
        """
        if hangs:
            self.forget()
            return None
        outside = stance.outside if known else float("inf")
        if not self.stands:
            self._settled = self._settled + 1 if stance.bearing > _STANDS and outside < 0.0 else 0
            self.stands = self._settled * self._period > _SETTLES
            return None
        self._lost = self._lost + 1 if not outside <= OUTSIDE else 0
        if self._lost * self._period <= PATIENCE:
            return None
        self.forget()
        return Trip(Rule.BALANCE, -1, outside, OUTSIDE)
