"""Holds joints where they were commanded to be."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daemon.controllers.base import Controller, Gains
from daemon.robot_state import RobotState
from hal.joint import JointCommand


class Hold(Controller):
    """Joint impedance about one posture: the command that it takes over, or a posture given (the measured one, on enabling)."""

    name = "hold"

    def __init__(self, joints: NDArray[np.int64], gains: Gains, position: NDArray[np.float64] | None = None):
        """`position`: (n,) rad of all joints, of which `joints` are held; None: where they were last commanded to be."""
        super().__init__(joints, gains)
        self._given = None if position is None else position[joints].copy()
        self._position = self._still = np.zeros(len(joints))

    def activate(self, robot: RobotState, last: JointCommand) -> None:
        self._position = last.position[self.joints].copy() if self._given is None else self._given

    def update(self, robot: RobotState, out: JointCommand) -> None:
        self.write_impedance(robot, out, self._position, self._still)
