"""Holds joints in a posture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daemon.controllers.base import Controller, Gains
from daemon.robot_state import RobotState
from hal.joint import JointCommand


class Hold(Controller):
    """Joint impedance about one posture, with the model's gravity torque."""

    name = "hold"

    def __init__(self, joints: NDArray[np.int64], gains: Gains, position: NDArray[np.float64]):
        """`position`: (n,) rad of all the robot's joints, of which `joints` are held."""
        super().__init__(joints, gains)
        self._position = position[joints]
        self._still = np.zeros(len(joints))

    def activate(self, robot: RobotState, last: JointCommand) -> None:
        """Nothing to take over: the posture was given."""

    def update(self, robot: RobotState, out: JointCommand) -> None:
        self.write_impedance(robot, out, self._position, self._still)
