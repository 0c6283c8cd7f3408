"""Moves joints to a target that may be replaced on the way: home postures, jogging, whatever has no plan."""

from __future__ import annotations

import numpy as np

from daemon.controllers.base import Array, Gains, MotionController
from daemon.controllers.point_to_point import NoWay, PointToPoint
from daemon.controllers.references import PathClock
from daemon.exchange import TargetMotion
from daemon.state.robot_state import RobotState
from hal.joint import JointCommand


class JointTarget(MotionController):
    """Joint impedance along the way that ruckig finds, anew at each target, from the motion that there is.

    Changes of speed and pauses slow the way down that was found; so a target that comes meanwhile begins at the same rate, and
    neither position, velocity nor acceleration jump.
    """

    name = "joint_target"

    def __init__(self, motion: TargetMotion, gains: Gains, period: float):
        super().__init__(motion.joints, gains)
        self._motion, self._period = motion, period
        self.clock = PathClock(np.inf, period)
        self._position, self._velocity = np.zeros((2, len(motion.joints)))
        self._way: PointToPoint | None = None
        self._newest = 0

    def activate(self, robot: RobotState, last: JointCommand) -> None:
        description, rows = robot.kinematics.description, self.joints
        fastest = self._motion.speed * description.velocity_limit[rows]
        limits = np.array((fastest, description.acceleration_limit[rows], description.jerk_limit[rows]))
        self._way = PointToPoint(limits, self._period)
        self._way.begin(last.position[rows], last.velocity[rows], self._motion.positions)
        self.clock.begin_anew(self._way.length)
        self.clock.room = self._way.room

    def sample(self, sequence: int, position: Array, velocity: Array) -> bool:
        if len(position) != len(self.joints):
            return False
        if sequence > self._newest:
            assert self._way is not None, "activate comes before samples"
            self._newest = sequence
            try:
                self._way.turn_to(self.clock.s, position)
            except NoWay:
                return False
            self.clock.begin_anew(self._way.length)
        return True

    def update(self, robot: RobotState, out: JointCommand) -> None:
        assert self._way is not None, "activate comes before update"
        self.clock.advance()
        self._way.evaluate(self.clock.s, self._position, self._velocity)
        self.write_tracking(robot, out, self._position, self._velocity * self.clock.rate)
