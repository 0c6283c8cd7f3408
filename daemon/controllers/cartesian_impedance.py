"""Moves a frame in a straight line under Cartesian impedance: a spring in the world, damping in the drives."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from daemon.controllers.base import Array, Gains, MotionController
from daemon.controllers.frame_room import damped_inverse, frame_room
from daemon.controllers.references import LinePath, PathClock, placement
from daemon.exchange import CartesianMotion, TaskFrameMotion
from daemon.state.robot_state import FramePose, RobotState
from hal.joint import JointCommand

_SPRING_REACH = 0.10
"""m: the spring pulls no harder than at this distance"""
_SPRING_TURN = 0.5
"""rad: likewise"""
_FOLLOW_RATE = 20.0
"""1/s at which the commanded joints close in on the commanded frame"""
_LOOK_AHEAD = 0.02
"""s: a joint that would be at its limit then stands"""


class CartesianImpedance(MotionController):
    """Torque g + Jᵀ K e + N₀ᵀ τ_posture from here, damping about the commanded joint velocities in the drives.

    e is the commanded minus the measured pose (position, rotation vector; world axes). The damping is where it is stable: at
    500 Hz a damper closed over the bus is not (the tool's own inertia is a quarter of a kilogram), the drives' firmware is. The
    commanded joints follow the line by damped least squares (Nakamura and Hanafusa 1986); they give the drives their velocity,
    the null space its posture, and the hold that comes after its command. Joint stiffness is zero meanwhile.
    """

    name = "cartesian_impedance"

    def __init__(self, motion: CartesianMotion | TaskFrameMotion, gains: Gains, period: float):
        super().__init__(motion.joints, gains)
        self.force_frame = motion.frame
        self._frame, self._duration = motion.frame, motion.duration
        linear, angular = motion.stiffness
        self._stiffness = np.array([linear] * 3 + [angular] * 3)
        self.clock = PathClock(motion.duration, period)
        self._goal = motion.goal_in_world and placement(motion.goal_in_world)
        self._position = np.zeros(len(motion.joints))
        self._line: LinePath | None = None

    def activate(self, robot: RobotState, last: JointCommand) -> None:
        # From where the frame is commanded, not measured: what it leans on now, it goes on leaning on.
        start = robot.commanded_frame(self._frame)
        self._line = LinePath(start.rotation, start.translation, self.goal(start), self._duration)
        self._position = last.position[self.joints].copy()
        self.clock.room = lambda: self._room(robot)

    def _room(self, robot: RobotState) -> tuple[float, float]:
        """Of the joints' limits, what the line leaves for a change of the clock's rate; compliance and dither left out."""
        assert self._line is not None, "activate comes before update"
        description, rows = robot.kinematics.description, self.joints
        limits = np.array((description.acceleration_limit[rows], description.jerk_limit[rows]))
        position = robot.joints.position.copy()
        position[rows] = self._position
        return frame_room(self._line, self.clock.s, robot.kinematics, self._frame, rows, position, limits)

    def goal(self, start: FramePose) -> pin.SE3:
        """Where the line leads from `start`."""
        return self._goal or pin.SE3(start.rotation, start.translation)

    def reference(self, robot: RobotState) -> tuple[Array, Array, Array]:
        """(rotation (3, 3), translation (3,) m, twist (6,) m/s and rad/s, world axes) that the frame shall have now."""
        assert self._line is not None, "activate comes before update"
        rotation, translation, linear, angular = self._line.evaluate(self.clock.s)
        return rotation, translation, np.concatenate((linear, angular)) * self.clock.rate

    def update(self, robot: RobotState, out: JointCommand) -> None:
        self.clock.advance()
        rotation, translation, twist = self.reference(robot)
        measured, commanded = robot.frame(self._frame), robot.commanded_frame(self._frame)
        jacobian = robot.jacobian(self._frame)[:, self.joints]
        inverse = damped_inverse(jacobian)

        drift = _pose_error(rotation, translation, commanded.rotation, commanded.translation)
        velocity = self._within_limits(jacobian, inverse, twist + _FOLLOW_RATE * drift, robot)
        self._position += velocity * robot.period

        error = _pose_error(rotation, translation, measured.rotation, measured.translation)
        wrench = self._stiffness * _within_reach(error)
        self.write_impedance(robot, out, self._position, velocity)
        rows = self.joints
        posture = self.gains.stiffness[rows] * (self._position - robot.joints.position[rows])
        posture -= jacobian.T @ (inverse.T @ posture)
        out.torque[rows] += jacobian.T @ wrench + posture
        out.stiffness[rows] = 0.0

    def _within_limits(self, jacobian: Array, inverse: Array, twist: Array, robot: RobotState) -> Array:
        """Joint velocities (m,) rad/s for a twist (6,); a joint that would run into its limit stands, the others take over."""
        description, rows = robot.kinematics.description, self.joints
        velocity = inverse @ twist
        ahead = self._position + velocity * _LOOK_AHEAD
        blocked = ((ahead < description.lower[rows]) & (velocity < 0)) | (
            (ahead > description.upper[rows]) & (velocity > 0)
        )
        if blocked.any():
            velocity = damped_inverse(np.where(blocked, 0.0, jacobian)) @ twist
        most = description.velocity_limit[rows]
        return np.clip(velocity, -most, most)


def _pose_error(rotation_to: Array, translation_to: Array, rotation: Array, translation: Array) -> Array:
    """(6,): from (rotation, translation) to the other pose, m and rad about world axes."""
    turn = rotation @ pin.log3(rotation.T @ rotation_to)
    return np.concatenate((translation_to - translation, turn))


def _within_reach(error: Array) -> Array:
    """The error (6,) with its parts shortened to where the springs stop growing."""
    short = error.copy()
    for part, most in ((slice(0, 3), _SPRING_REACH), (slice(3, 6), _SPRING_TURN)):
        size = float(np.linalg.norm(error[part]))
        if size > most:
            short[part] *= most / size
    return short
