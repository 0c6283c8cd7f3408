"""Which joint velocities bring a frame on as asked, within what the joints may do in the next cycle."""

from __future__ import annotations

import daqp
import numpy as np
from numpy.typing import NDArray

from daemon.controllers.frame_room import JACOBIAN_DAMPING, damped_inverse
from handrail.robot.description import RobotDescription

Array = NDArray[np.float64]

_SHARE = 0.25
"""of the joints' acceleration limits: what is left of them where a whole arm brakes at once and no torque is fed forward for it"""
_NEAR_LIMIT = 0.05
"""rad"""
_NO_ROOM = 0.1
"""of it"""


class JointVelocities:
    """min |J q̇ − v|² + λ² |q̇|² (Nakamura and Hanafusa 1986), l ≤ q̇ ≤ u, joint for joint.

    The bounds are the velocity limit, what the acceleration limit makes of the cycle before, and what leaves room to brake at it
    before the position limit; so a joint comes to a stand at its limit, and the others take over as fast as they can and no
    faster. What that leaves undone is not done: whoever asks has to look where the frame got to.
    """

    def __init__(self, description: RobotDescription, rows: NDArray[np.int64], period: float):
        """`rows` (m,): the joints, in the description's order; `period`: of the loop, s."""
        self._lower, self._upper = description.lower[rows], description.upper[rows]
        self._most, self._acceleration = description.velocity_limit[rows], description.acceleration_limit[rows]
        self._deceleration = _SHARE * self._acceleration
        self._names, self._period = [description.joints[row] for row in rows], period
        self.velocity = np.zeros(len(rows))
        """(m,) rad/s, of the cycle before"""

    def begin(self, velocity: Array) -> None:
        """Go on from these velocities (m,) rad/s."""
        self.velocity = np.clip(velocity, -self._most, self._most)

    def towards(self, twist: Array, jacobian: Array, position: Array) -> Array:
        """(m,) rad/s for a frame's twist (6,) m/s and rad/s with `jacobian` (6, m), where the joints are at `position` (m,) rad."""
        velocity = damped_inverse(jacobian) @ twist
        lower, upper = self._bounds(position)
        if (velocity < lower).any() or (velocity > upper).any():
            hessian = jacobian.T @ jacobian
            hessian.flat[:: len(hessian) + 1] += JACOBIAN_DAMPING**2
            best, _, solved, _ = daqp.solve(hessian, -(jacobian.T @ twist), np.empty((0, len(hessian))), upper, lower)
            velocity = np.clip(best if solved > 0 else velocity, lower, upper)
        self.velocity = velocity
        return velocity

    def _bounds(self, position: Array) -> tuple[Array, Array]:
        change = self._acceleration * self._period
        slowest, fastest = self.velocity - change, self.velocity + change
        up = np.minimum(self._most, self._braking(self._upper - position))
        down = np.minimum(self._most, self._braking(position - self._lower))
        # Who is too fast already brakes as hard as it may.
        return np.clip(-down, slowest, fastest), np.clip(up, slowest, fastest)

    def _braking(self, room: Array) -> Array:
        """rad/s from which a joint still comes to a stand within `room` rad, the cycle that it is commanded for included."""
        change = self._deceleration * self._period
        return np.asarray(np.sqrt(change**2 + 2.0 * self._deceleration * np.maximum(room, 0.0)) - change, np.float64)

    def room(self, position: Array) -> Array:
        """(m,) from 1, where a joint at `position` (m,) rad is far from its limits, down to 0 at one."""
        room = np.minimum(position - self._lower, self._upper - position)
        return np.asarray(np.clip(room / _NEAR_LIMIT, 0.0, 1.0), np.float64)

    def at_limits(self, position: Array) -> list[str]:
        """The joints that have no room left on one side."""
        return [name for name, room in zip(self._names, self.room(position).tolist(), strict=True) if room < _NO_ROOM]
