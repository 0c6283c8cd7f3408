"""Brings joints to a stand along the straight line that they are on, and holds them there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daemon.controllers.base import Array, Controller, Gains
from daemon.state.robot_state import RobotState
from hal.joint import JointCommand


class Brake(Controller):
    """All joints together: speed q̇₀ (1 − 3u² + 2u³), u = t/T, so that neither speed nor torque jumps; the run-out is q̇₀ T/2.

    What the deceleration takes, M(q) q̈, is fed forward with gravity: under impedance alone the joints would run on by M q̈ / K.
    """

    name = "brake"

    def __init__(self, joints: NDArray[np.int64], gains: Gains, position: Array, velocity: Array, duration: float):
        """From `position`, `velocity` (n,) rad, rad/s of all the robot's joints, of which `joints` brake within `duration` s."""
        super().__init__(joints, gains)
        self._start, self._speed, self._duration = position[joints].copy(), velocity[joints].copy(), duration
        self._deceleration = np.zeros(len(position))
        self._at = 0.0

    @property
    def done(self) -> bool:
        """The joints are commanded to stand."""
        return self._at >= self._duration

    def activate(self, robot: RobotState, last: JointCommand) -> None:
        """Nothing to take over: where and how fast the joints are was given."""

    def update(self, robot: RobotState, out: JointCommand) -> None:
        self._at = min(self._at + robot.period, self._duration)
        u = self._at / self._duration if self._duration > 0.0 else 1.0
        run = self._duration * (u - u**3 + 0.5 * u**4)
        rate = 1.0 - u * u * (3.0 - 2.0 * u)
        self.write_tracking(robot, out, self._start + run * self._speed, rate * self._speed)
        if not self.done:
            self._deceleration[self.joints] = -6.0 * u * (1.0 - u) / self._duration * self._speed
            torque = robot.kinematics.mass_matrix(robot.joints.position) @ self._deceleration
            out.torque[self.joints] += torque[self.joints]
