"""Moves a frame in a straight line under Cartesian impedance: a spring in the world, damping in the drives."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from daemon.controllers.base import Array, Gains, MotionController
from daemon.controllers.frame_room import JACOBIAN_DAMPING, frame_room
from daemon.controllers.joint_velocities import JointVelocities
from daemon.controllers.references import LinePath, PathClock, placement
from daemon.exchange import CartesianMotion, TaskFrameMotion
from daemon.state.robot_state import FramePose, RobotState
from hal.joint import JointCommand

_SPRING_REACH = np.array((0.10, 0.5))
"""m and rad: the spring pulls no harder than at this distance"""
_FOLLOW_RATE = 20.0
"""1/s at which the commanded joints close in on the commanded frame"""
_NEAR, _FAR = np.array((0.005, 0.04)), np.array((0.02, 0.15))
"""m and rad that the commanded frame is behind its line: from the first on the line is run slower, at the second it stands"""
_PATIENCE = 1.0
"""s that the line may stand, or its end be missed by less than that, before the motion ends"""
_STANDS = 0.05
"""share of the line's rate"""


class CartesianImpedance(MotionController):
    """Torque g + Jᵀ K e + τ_posture from here, damping about the commanded joint velocities in the drives.

    e is the commanded minus the measured pose (position, rotation vector; world axes). The damping is where it is stable: at
    500 Hz a damper closed over the bus is not (the tool's own inertia is a quarter of a kilogram), the drives' firmware is. The
    commanded joints follow the line by damped least squares within their limits (JointVelocities); they give the drives their
    velocity, the null space its posture, and the hold that comes after its command. Joint stiffness is zero meanwhile.

    Where they can't keep up, near a singularity or at a joint's limit, the line waits for them: its clock slows down with the
    distance to the commanded frame. Where it has stood for `_PATIENCE` s the motion ends, and says which joints have no room left;
    so it does where its end is nearly reached, but not quite.
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
        self._joints: JointVelocities | None = None
        self._stuck = 0.0
        """s"""
        self._why = ""

    @property
    def done(self) -> bool:
        return self.clock.at_end and (self.clock.share == 1.0 or self._stuck > _PATIENCE)

    @property
    def remark(self) -> str:
        return self._why

    @property
    def failure(self) -> str:
        return self._why if self.clock.share < _STANDS else ""

    def activate(self, robot: RobotState, last: JointCommand) -> None:
        # From where the frame is commanded, not measured: what it leans on now, it goes on leaning on.
        start = robot.commanded_frame(self._frame)
        self._line = LinePath(start.rotation, start.translation, self.goal(start), self._duration)
        self._position = last.position[self.joints].copy()
        self._joints = JointVelocities(robot.kinematics.description, self.joints, robot.period)
        self._joints.begin(last.velocity[self.joints])
        self._stuck, self._why, self.clock.share = 0.0, "", 1.0
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
        return rotation, translation, np.concatenate((linear, angular)) * self.clock.pace

    def update(self, robot: RobotState, out: JointCommand) -> None:
        assert self._joints is not None, "activate comes before update"
        self.clock.advance()
        rotation, translation, twist = self.reference(robot)
        measured, commanded = robot.frame(self._frame), robot.commanded_frame(self._frame)
        jacobian = robot.jacobian(self._frame)[:, self.joints]

        drift = _pose_error(rotation, translation, commanded.rotation, commanded.translation)
        velocity = self._joints.towards(twist + _FOLLOW_RATE * drift, jacobian, self._position)
        self._position += velocity * robot.period
        self._wait(drift, robot.period)

        # Where the joints can't bring it the spring does not pull: else it leans on their limits, and on with them when they go on.
        error = _pose_error(rotation, translation, measured.rotation, measured.translation)
        error -= drift - _shortened(drift, _NEAR)
        wrench = self._stiffness * _shortened(error, _SPRING_REACH)
        self.write_impedance(robot, out, self._position, velocity)
        rows = self.joints
        out.torque[rows] += jacobian.T @ wrench + self._posture(jacobian, robot)
        out.stiffness[rows] = 0.0

    def _posture(self, jacobian: Array, robot: RobotState) -> Array:
        """(m,) N·m of the joints' springs, freed of what they would move the frame by: K δ − Jᵀ (J K⁻¹ Jᵀ)⁻¹ J δ.

        Weighted so, it is a spring, too: symmetric, so passive. With J⁺ alone what holds a torso comes out of the light wrist. A
        joint at its limit is held as by a stop, whatever the frame is pulled at.
        """
        assert self._joints is not None, "activate comes before update"
        rows = self.joints
        stiffness = self.gains.stiffness[rows]
        posture = stiffness * (self._position - robot.joints.position[rows])
        eased = jacobian.T / stiffness[:, None]
        mobility = jacobian @ eased
        mobility.flat[::7] += JACOBIAN_DAMPING**2 * np.mean(1.0 / stiffness)
        free = self._joints.room(self._position) * posture
        return np.asarray(posture - jacobian.T @ np.linalg.solve(mobility, eased.T @ free), np.float64)

    def _wait(self, drift: Array, period: float) -> None:
        """Run the line as far as the commanded frame, which is `drift` (6,) behind, keeps up with it."""
        assert self._joints is not None, "activate comes before update"
        away = np.array((np.linalg.norm(drift[:3]), np.linalg.norm(drift[3:])))
        self.clock.share = float(np.clip((_FAR - away) / (_FAR - _NEAR), 0.0, 1.0).min())
        late = self.clock.share < _STANDS or (self.clock.at_end and self.clock.share < 1.0)
        self._stuck = self._stuck + period if late and not self.clock.held else 0.0
        if self._stuck > _PATIENCE:
            full = self._joints.at_limits(self._position)
            because = f"{', '.join(full)} at the limit" if full else "the arm is stretched or singular there"
            self._why = f"{self._frame} is {away[0]:.3f} m, {away[1]:.2f} rad short of its line: {because}"


def _pose_error(rotation_to: Array, translation_to: Array, rotation: Array, translation: Array) -> Array:
    """(6,): from (rotation, translation) to the other pose, m and rad about world axes."""
    turn = rotation @ pin.log3(rotation.T @ rotation_to)
    return np.concatenate((translation_to - translation, turn))


def _shortened(error: Array, most: Array) -> Array:
    """The error (6,) with its parts no longer than `most`, m and rad."""
    short = error.copy()
    for part, longest in zip((slice(0, 3), slice(3, 6)), most.tolist(), strict=True):
        size = float(np.linalg.norm(error[part]))
        if size > longest:
            short[part] *= longest / size
    return short
