"""Moves a frame along a path under Cartesian impedance, and lets it give way, press or swing on axes of a task frame.

Source: Backes, Generalized Compliant Motion with sensor fusion, ICAR 1991: trajectory, force control, spring, damper and dither
each add their motion at one task frame.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from daemon.controllers.base import Array, Gains
from daemon.controllers.cartesian_impedance import CartesianImpedance
from daemon.exchange import TaskFrameMotion
from daemon.state.robot_state import FramePose, RobotState
from hal.joint import JointCommand


class CompliantMotion(CartesianImpedance):
    """The reference that the impedance has is the path's, displaced along the task's axes by e + d.

    On compliant axes D ė = f + w − K' e, with w the wrench that something outside exerts on the frame, f what the frame shall
    exert, |ė| ≤ speed, |e| ≤ reach; 1/K' = 1/K − 1/K₀, so that with the impedance's own spring K₀, which gives way, too, the
    stiffness is K. At a rigid wall the force then comes to f as a first-order lag of rate K₀/D, whatever the model's errors are.
    d is the dither. All of it stands while the path does.
    """

    name = "compliant_motion"

    def __init__(self, motion: TaskFrameMotion, gains: Gains, period: float):
        super().__init__(motion, gains, period)
        self._axes = pin.Quaternion(motion.axes).normalized().matrix()
        self._turns, self._shift = motion.turns_with_frame, motion.shift
        on, self._force, stiffness, self._damping, self._speed, self._reach = motion.compliance
        self._on = on > 0.0
        self._damping = np.where(self._on, self._damping, 1.0)
        sprung = stiffness > 0.0
        self._spring = np.zeros(6)
        self._spring[sprung] = 1.0 / (1.0 / stiffness[sprung] - 1.0 / self._stiffness[sprung])
        self._swing, self._frequency = motion.dither[0], 2.0 * np.pi * motion.dither[1]
        self.offset = np.zeros(6)
        """e: m and rad along and about the task's axes"""

    def goal(self, start: FramePose) -> pin.SE3:
        if self._goal is not None:
            return self._goal
        return pin.SE3(start.rotation, start.translation + self._task_axes(start.rotation) @ self._shift)

    def reference(self, robot: RobotState) -> tuple[Array, Array, Array]:
        rotation, translation, twist = super().reference(robot)
        axes, rate = self._task_axes(rotation), self.clock.pace
        felt = (robot.wrenches[self._frame].reshape(2, 3) @ axes).ravel()
        speed = (self._force + felt - self._spring * self.offset) / self._damping
        speed = np.where(self._on, np.clip(speed, -self._speed, self._speed), 0.0) * rate
        before = self.offset
        self.offset = np.clip(before + speed * robot.period, -self._reach, self._reach)
        phase = self._frequency * self.clock.s
        away = self.offset + self._swing * np.sin(phase)
        moving = (self.offset - before) / robot.period + rate * self._swing * self._frequency * np.cos(phase)
        translation = translation + axes @ away[:3]
        rotation = pin.exp3(axes @ away[3:]) @ rotation
        return rotation, translation, twist + (moving.reshape(2, 3) @ axes.T).ravel()

    def _task_axes(self, rotation: Array) -> Array:
        """(3, 3): the task frame's axes in the world, where the frame's are `rotation`."""
        return rotation @ self._axes if self._turns else self._axes

    def activate(self, robot: RobotState, last: JointCommand) -> None:
        super().activate(robot, last)
        self.offset = np.zeros(6)
