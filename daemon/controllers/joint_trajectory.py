"""Follows joint-space knots, with a force along the path that grows while the tool lags behind."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daemon.controllers.base import Array, Gains, MotionController
from daemon.controllers.point_to_point import Excursion, NoWay
from daemon.controllers.references import DetourClock, HermitePath, PathClock, fade
from daemon.exchange import TrajectoryMotion
from daemon.state.robot_state import RobotState
from hal.joint import JointCommand
from handrail.messages import PathForce

_LEAD_IN = 0.2
"""s over which the difference between the command and the first knot is worked off"""
PUSHED_OFF = 0.02
"""rad by which a joint that stands is elsewhere than where it came to a stand: then the command goes there first, and back"""
_RETURN_SPEED = 0.3
"""share of the velocity limits at which that is"""


class PathForceIntegrator:
    """Joint torques of a force F t̂ at a frame, F ← clip(F + gain · t̂·(x_d − x) dt, 0, limit); see messages.PathForce.

    The lag is that of the measured frame behind the command that it had one cycle to follow. Friction that the path's speed
    does not reveal (a valve's, a drawer's) is found by pushing until the tool moves, no harder than `limit`.
    """

    def __init__(self, spec: PathForce, claimed: NDArray[np.bool_]):
        """`claimed` (n,): the robot's joints that may do it."""
        self.spec = spec
        self.force = 0.0
        self._claimed = claimed
        self._tangent, self._torque = np.zeros(3), np.zeros(len(claimed))

    def torque(self, robot: RobotState) -> Array:
        """N·m (n,) to add to the feed-forward in this cycle; the next one overwrites it."""
        frame, gain, limit = robot.carried(self.spec.frame), self.spec.gain * robot.period, self.spec.limit
        self.force = frame.pull(self._tangent, self.force, gain, limit, self._claimed, self._torque)
        return self._torque


class JointTrajectory(MotionController):
    """Cubic Hermite knots under joint impedance in the drives, gravity and path force fed forward from here."""

    name = "joint_trajectory"
    clock: DetourClock

    def __init__(self, motion: TrajectoryMotion, gains: Gains, period: float):
        super().__init__(motion.joints, gains)
        self._path = HermitePath(motion.times, motion.positions, motion.velocities)
        self.clock = DetourClock(self._path.length, period)
        self._period = period
        self._back: Excursion | None = None
        claimed = np.isin(np.arange(len(gains.stiffness)), motion.joints)
        self._force = PathForceIntegrator(motion.path_force, claimed) if motion.path_force else None
        self._position, self._velocity = np.zeros(len(motion.joints)), np.zeros(len(motion.joints))
        self._lead = np.zeros(len(motion.joints))
        self._lean = np.zeros(len(motion.joints))
        self._away, self._returning = np.zeros(len(motion.joints)), np.zeros(len(motion.joints))
        self._running = 0.0
        if motion.path_force:
            self.force_frame = motion.path_force.frame

    def activate(self, robot: RobotState, last: JointCommand) -> None:
        self._path.evaluate(0.0, self._position, self._velocity)
        self._lead = last.position[self.joints] - self._position
        description, rows = robot.kinematics.description, self.joints
        limits = np.array((description.acceleration_limit[rows], description.jerk_limit[rows]))
        self.clock.room = lambda: self._path.room(limits)

    def update(self, robot: RobotState, out: JointCommand) -> None:
        clock = self.clock
        clock.advance()
        self._path.evaluate(clock.s, self._position, self._velocity)
        if self._running < _LEAD_IN:
            self._running += robot.period
            self._position += self._lead * fade(self._running, _LEAD_IN)
        velocity, rate = self._velocity, clock.rate
        if clock.detour is not None:
            assert self._back is not None
            self._back.evaluate(clock.detour.s, self._away, self._returning)
            self._position += self._away
            velocity, rate = self._returning, clock.detour.rate
        if rate != 1.0:
            velocity *= rate
        self.write_tracking(robot, out, self._position, velocity)
        if self._force is not None:
            out.torque += self._force.torque(robot)

    def stood(self, robot: RobotState, last: JointCommand) -> None:
        rows = self.joints
        self._lean = robot.joints.position[rows] - last.position[rows]

    def come_back(self, robot: RobotState, last: JointCommand) -> None:
        rows, description = self.joints, robot.kinematics.description
        commanded, measured = last.position[rows], robot.joints.position[rows]
        if np.abs(measured - commanded - self._lean).max() <= PUSHED_OFF:
            return
        # What it leaned on when it came to a stand it goes on leaning on; not beyond where it is, nor beyond its limits.
        here = np.clip(measured - self._lean, np.minimum(commanded, measured), np.maximum(commanded, measured))
        lower, upper = description.lower[rows], description.upper[rows]
        here = np.clip(here, np.minimum(lower, commanded), np.maximum(upper, commanded))
        if self.clock.detour is None:
            self._away[:] = 0.0
        fastest = _RETURN_SPEED * description.velocity_limit[rows]
        limits = np.array((fastest, description.acceleration_limit[rows], description.jerk_limit[rows]))
        try:
            self._back = Excursion(limits, self._period, self._away, self._away + here - commanded)
        except NoWay:
            return
        detour = PathClock(self._back.length, self._period)
        detour.room = self._back.room
        self.clock.leave(detour)

    @property
    def path_force(self) -> float:
        return self._force.force if self._force else 0.0
