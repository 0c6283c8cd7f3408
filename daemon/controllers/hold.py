"""Holds joints in a posture."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daemon.controllers.base import Controller, Gains
from daemon.state.robot_state import RobotState
from hal.joint import JointCommand


class Hold(Controller):
    """Joint impedance about one posture, with the model's gravity torque; of joints that others claim in part, the rest of it."""

    name = "hold"

    def __init__(
        self,
        joints: NDArray[np.int64],
        gains: Gains,
        position: NDArray[np.float64],
        free: NDArray[np.bool_] | None = None,
    ):
        """`position`: (n,) rad of all the robot's joints, of which `joints` are held; `free`: (5, n) what nobody else claims of
        them, None: everything."""
        super().__init__(joints, gains)
        self._position = position[joints]
        self._still = np.zeros(len(joints))
        self._whole = JointCommand(len(position)) if free is not None and not free[:, joints].all() else None
        self._free = free

    def activate(self, robot: RobotState, last: JointCommand) -> None:
        """Nothing to take over: the posture was given."""

    def update(self, robot: RobotState, out: JointCommand) -> None:
        whole = self._whole
        if whole is None:
            self.write_tracking(robot, out, self._position, self._still)
            return
        self.write_impedance(robot, whole, self._position, self._still)
        np.copyto(out.table, whole.table, where=self._free)
        out.mode[self.joints] = whole.mode[self.joints]
