"""What braking has to overcome, and what it has for it, where the robot is: inertia and weight, and never more than anywhere.

The most that they can be is known from postures all over the robot's limits (bodies.py); an arm that is not stretched out brakes in
half of the time that follows from that. Working out what they are costs as much as half a cycle, so it is done only where somebody
would have to brake by the most: at the command and where braking from it would end. The larger one counts, and some more for what
lies between, and for what moves until it is forgotten.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from handrail.compiled import compiled
from handrail.robot.kinematics import Kinematics

Array = NDArray[np.float64]

SHARE = 0.6
"""of the torque that weight leaves, and of its rate, that may be spent on braking: the rest is for what the model does not know"""
LEAST = 0.25
"""of a joint's torque that braking may count on, whatever weight is on it"""
_LASTS_S = 0.01
"""for which a look holds good"""
_MORE = 1.2
"""by which inertia and weight may be larger than at both ends, on the way and since the last look"""


def at_most(kinematics: Kinematics, inertia: Array, weight: Array) -> Array:
    """(n + 3, n), see separation.judge: with |M| (n, n) and |g| (n,) as the most that they can be."""
    description = kinematics.description
    torque = np.maximum(SHARE * (description.torque_limit - weight), LEAST * description.torque_limit)
    return np.vstack((inertia, torque, SHARE * description.torque_rate_limit, 0.5 * description.stiffness))


class Braking:
    """`limits`, as of `at_most`: the most, or for a while after a `look` what it showed."""

    def __init__(self, kinematics: Kinematics, worst: Array, period: float):
        """`worst`: of `at_most`; `period`: of the loop, s."""
        self.limits = self._worst = worst
        self._present, self._ends = worst.copy(), np.zeros((2, worst.shape[1] + 1, worst.shape[1]))
        self._model, self._data, self._rows = kinematics.model, kinematics.model.createData(), kinematics.index_v
        self._q = kinematics.configuration(kinematics.description.home_position())
        self._rated = kinematics.description.torque_limit
        self._lasts, self._left = max(round(_LASTS_S / period), 1), 0

    def begin_cycle(self) -> None:
        """Forget the last look when it is too old."""
        self._left -= 1
        if self._left <= 0:
            self.limits = self._worst

    def look(self, moving: Array, duration: float) -> bool:
        """Take `limits` from where the robot is; False where they are already.

        `moving` (·, n): positions rad and speeds rad/s that count; `duration`: s that braking takes by `limits`.
        """
        if self.limits is self._present:
            return False
        for end in range(2):
            self._q[self._rows] = moving[0] + end * 0.5 * duration * moving[1]
            pin.crba(self._model, self._data, self._q)
            weight = pin.computeGeneralizedGravity(self._model, self._data, self._q)
            _take(self._data.M.T, weight, self._rows, end, self._ends, self._rated, self._worst, self._present)
        self.limits, self._left = self._present, self._lasts
        return True


@compiled
def _take(mass, weight, rows, end, ends, rated, worst, limits):  # type: ignore[no-untyped-def]
    """`ends` (2, n + 1, n): |M| and |g| at both ends; `limits`: of the larger ones, right once both are there.

    `mass`: M's lower triangle.
    """
    n = rows.shape[0]
    for i in range(n):
        for j in range(n):
            a, b = rows[i], rows[j]
            ends[end, i, j] = abs(mass[max(a, b), min(a, b)])
            limits[i, j] = min(_MORE * max(ends[0, i, j], ends[1, i, j]), worst[i, j])
    for j in range(n):
        ends[end, n, j] = abs(weight[rows[j]])
        left = rated[j] - _MORE * max(ends[0, n, j], ends[1, n, j])
        limits[n, j] = max(SHARE * left, worst[n, j])
