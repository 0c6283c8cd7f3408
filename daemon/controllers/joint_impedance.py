"""Follows references of its joints under joint impedance: what others are chained to."""

from __future__ import annotations

from typing import Annotated, Self

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from daemon.controllers.base import ChainableController, Gains, Setup
from daemon.state.robot_state import RobotState
from hal.joint import JointCommand


class Parameters(msgspec.Struct, forbid_unknown_fields=True):
    """What may be said of it."""

    stiffness: Annotated[float, Meta(gt=0.0, le=1.0)] = 1.0
    """share of the robot's own joint stiffness; damping follows with its square root, so that the damping ratio stays"""


class JointImpedance(ChainableController):
    """Joint impedance about `reference`, softer than the robot's own by `stiffness`. Alone, it holds where it took over."""

    def __init__(self, joints: NDArray[np.int64], gains: Gains, stiffness: float = 1.0):
        super().__init__(joints, Gains(stiffness * gains.stiffness, np.sqrt(stiffness) * gains.damping))

    @classmethod
    def make(cls, setup: Setup) -> Self:
        parameters = msgspec.convert(dict(setup.parameters), Parameters)
        return cls(setup.joints, setup.gains, parameters.stiffness)

    def follow(self, robot: RobotState, out: JointCommand) -> None:
        rows, reference = self.joints, self.reference
        self.write_impedance(robot, out, reference.position[rows], reference.velocity[rows])
