"""Carries its joints' weight and lets them be moved by hand."""

from __future__ import annotations

from typing import Annotated, Self

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from daemon.controllers.base import Controller, Gains, Setup
from daemon.robot_state import RobotState
from hal.joint import JointCommand


class Parameters(msgspec.Struct, forbid_unknown_fields=True):
    """What may be said of it."""

    damping: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.3
    """share of the robot's own joint damping"""


class GravityCompensation(Controller):
    """The model's gravity torque, a little damping in the drives, and no stiffness; commanded is always where the joint is."""

    def __init__(self, joints: NDArray[np.int64], gains: Gains, damping: float = 0.3):
        super().__init__(joints, Gains(np.zeros_like(gains.stiffness), damping * gains.damping))
        self._still = np.zeros(len(joints))

    @classmethod
    def make(cls, setup: Setup) -> Self:
        parameters = msgspec.convert(dict(setup.parameters), Parameters)
        return cls(setup.joints, setup.gains, parameters.damping)

    def activate(self, robot: RobotState, last: JointCommand) -> None:
        """Nothing to take over."""

    def update(self, robot: RobotState, out: JointCommand) -> None:
        self.write_impedance(robot, out, robot.joints.position[self.joints], self._still)
