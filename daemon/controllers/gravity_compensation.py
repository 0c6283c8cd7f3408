"""Carries its joints' weight and lets them be moved by hand."""

from __future__ import annotations

from typing import Annotated, Self

import msgspec
import numpy as np
from msgspec import Meta

from daemon.controllers.base import Controller, Gains, Setup
from daemon.state.robot_state import RobotState
from hal.joint import JointCommand


class Parameters(msgspec.Struct, forbid_unknown_fields=True):
    """What may be said of it."""

    damping: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.3
    """share of the robot's own joint damping"""


class GravityCompensation(Controller):
    """The model's gravity torque, a little damping in the drives, and no stiffness; commanded is where the joint is.

    The command comes there no faster than the joint may move, and stays within its ends, as the limits would have it: they end
    whatever they hold back, and there may be a way to go after a joint was pressed from where it was commanded.
    """

    def __init__(self, setup: Setup, damping: float = 0.3):
        gains, rows, description = setup.gains, setup.joints, setup.kinematics.description
        super().__init__(rows, Gains(np.zeros_like(gains.stiffness), damping * gains.damping))
        self._still, self._position = np.zeros(len(rows)), np.zeros(len(rows))
        self._lower, self._upper = description.lower[rows], description.upper[rows]
        self._step = description.velocity_limit[rows] * setup.period

    @classmethod
    def make(cls, setup: Setup) -> Self:
        parameters = msgspec.convert(dict(setup.parameters), Parameters)
        return cls(setup, parameters.damping)

    def activate(self, robot: RobotState, last: JointCommand) -> None:
        self._position = last.position[self.joints].copy()

    def update(self, robot: RobotState, out: JointCommand) -> None:
        position, step = self._position, self._step
        towards = np.clip(robot.joints.position[self.joints], self._lower, self._upper)
        position += np.clip(towards - position, -step, step)
        self.write_impedance(robot, out, position, self._still)
