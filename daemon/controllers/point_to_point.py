"""Point to point on-line: joint positions over a path parameter s, from any motion to rest at a target (ruckig).

Source: Berscheid and Kröger, Jerk-limited real-time trajectory generation with arbitrary target states, RSS 2021.
"""

from __future__ import annotations

import numpy as np
from ruckig import InputParameter, Result, Ruckig, RuckigError, Synchronization, Trajectory

from daemon.controllers.references import LEAST_ROOM, Array

_RATE_SHARE = 0.5
"""of the limits of acceleration and jerk: the rest is for changes of speed on the way, as of plans"""
_MAX_RATE_CHANGE = 3.0
"""1/s: more would leave the rate's jerk too little"""


class NoWay(Exception):
    """There is no way that could be computed: a number is none, or a limit is."""


class PointToPoint:
    """The fastest way to a target within limits, all joints together: in a straight line, where it begins at rest."""

    def __init__(self, limits: Array, period: float):
        """`limits` (3, m): rad/s, rad/s², rad/s³ of the joints, the first as fast as it shall be; `period`: of the loop, s."""
        m = limits.shape[1]
        self._limits, share = limits, np.array([[1.0], [_RATE_SHARE], [_RATE_SHARE]])
        self._ruckig, self._input, self._way = Ruckig(m, period), InputParameter(m), Trajectory(m)
        self._input.max_velocity, self._input.max_acceleration, self._input.max_jerk = (limits * share).tolist()
        self._input.synchronization = Synchronization.Phase

    @property
    def length(self) -> float:
        """s that the way takes."""
        return float(self._way.duration)

    def begin(self, position: Array, velocity: Array, target: Array) -> None:
        """Go from `position` (m,) rad, `velocity` (m,) rad/s to `target` (m,) rad. Raises NoWay."""
        self._plan([position.tolist(), velocity.tolist(), [0.0] * len(position)], target)

    def turn_to(self, s: float, target: Array) -> None:
        """Go on from where it is at `s` to another target; s begins anew. Raises NoWay, and the way is what it was."""
        self._plan(self._way.at_time(s), target)

    def evaluate(self, s: float, position: Array, velocity: Array) -> None:
        """Write position (m,) rad and its derivative by s (m,) rad/s."""
        position[:], velocity[:], _ = self._way.at_time(s)

    def room(self) -> tuple[float, float]:
        """The rate's acceleration 1/s and jerk 1/s² for which there is room on such a way (references.PathClock)."""
        fast, hard, rough = self._limits
        change = min((1.0 - _RATE_SHARE) * float((hard / fast).min()), _MAX_RATE_CHANGE)
        left = (1.0 - _RATE_SHARE) * rough - 3.0 * _RATE_SHARE * hard * change
        return change, float((np.maximum(left, LEAST_ROOM * rough) / fast).min())

    def _plan(self, state: list[list[float]], target: Array) -> None:
        asked = self._input
        asked.current_position, asked.current_velocity, asked.current_acceleration = state
        asked.target_position = target.tolist()
        way = Trajectory(len(target))
        try:
            result = self._ruckig.calculate(asked, way)
        except RuckigError as error:
            raise NoWay(str(error)) from error
        if result not in (Result.Working, Result.Finished):
            raise NoWay(f"ruckig: {result}")
        self._way = way


class Excursion:
    """From where joints are commanded to be to where they are, which lets their springs go, and to the path: offsets from it."""

    def __init__(self, limits: Array, period: float, start: Array, there: Array):
        """`limits`, `period`: as of PointToPoint; `start`, `there` (m,) rad off the path. Raises NoWay."""
        still = np.zeros(len(start))
        self._out, self._back = PointToPoint(limits, period), PointToPoint(limits, period)
        self._out.begin(start, still, there)
        self._back.begin(there, still, still)
        self.length = self._out.length + self._back.length
        self.room = self._out.room

    def evaluate(self, s: float, position: Array, velocity: Array) -> None:
        """As PointToPoint's; `position` is what is to be added to the path's."""
        if s < self._out.length:
            self._out.evaluate(s, position, velocity)
        else:
            self._back.evaluate(s - self._out.length, position, velocity)
