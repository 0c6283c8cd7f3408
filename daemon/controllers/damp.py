"""Lets a robot that falls sink: every joint damped, none held."""

from __future__ import annotations

import numpy as np

from daemon.controllers.base import Controller
from daemon.state.robot_state import RobotState
from hal.joint import JointCommand, Mode


class Damp(Controller):
    """Damping alone, the one that goes with the joints' stiffness. What is commanded of a joint is where it is.

    Stiff limbs would break the fall with whatever they reach the floor with, and pull the robot where it was to be.
    """

    name = "damp"

    def activate(self, robot: RobotState, last: JointCommand) -> None:
        """Nothing to take over."""

    def update(self, robot: RobotState, out: JointCommand) -> None:
        rows, description = self.joints, robot.kinematics.description
        out.table[:, rows] = 0.0
        out.position[rows] = np.clip(robot.joints.position[rows], description.lower[rows], description.upper[rows])
        out.damping[rows], out.mode[rows] = self.gains.damping[rows], Mode.DAMPING
