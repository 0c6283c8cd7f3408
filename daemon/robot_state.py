"""What the loop knows of the robot in one cycle: measured joints, the model at them, and the model at what was commanded."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from hal.joint import JointCommand, JointState
from handrail.compiled import compiled
from handrail.robot.kinematics import Kinematics

Array = NDArray[np.float64]

_FORCE_CUTOFF_HZ = 30.0
_TORQUE_NOISE, _LARGEST_FORCE = 0.005, 100.0
"""What the damping weighs against each other: errors of the torques, as a share of each joint's rated torque; N to be expected"""


class FramePose(NamedTuple):
    """A frame in the world."""

    rotation: Array
    """(3, 3)"""
    translation: Array
    """(3,) m"""


class RobotState:
    """The robot as measured (`joints`) and as commanded, with pinocchio's answers about both.

    Gravity is there after `update`; forward kinematics run when somebody asks for a frame, once a cycle. Arrays have one row a
    joint in the description's order, frames are in the world (`base_link`). `gravity` is overwritten by the next `update`.
    """

    def __init__(self, kinematics: Kinematics, joints: JointState, period: float):
        self.kinematics = kinematics
        self.joints = joints
        self.period = period
        self.gravity = np.zeros(len(joints))
        """N·m (n,), at the measured position"""
        self.forces: dict[str, Array] = {}
        """frame → N (3,), world axes: what something outside exerts there; see `estimate_forces`"""
        self._model = kinematics.model
        self._measured, self._commanded = self._model.createData(), self._model.createData()
        self._rows = kinematics.index_v
        self._q, self._v = np.zeros(self._model.nq), np.zeros(self._model.nv)
        self._q_command, self._v_command = np.zeros(self._model.nq), np.zeros(self._model.nv)
        self._last = JointCommand(len(joints))
        self._squared_weight = 1.0 / kinematics.description.torque_limit**2
        self._force_gain = 1.0 - np.exp(-2.0 * np.pi * _FORCE_CUTOFF_HZ * period)
        self._measured_fresh = self._commanded_fresh = False

    def update(self, last: JointCommand) -> None:
        """Take the joints as measured now into the model. `last`: what was commanded in the cycle before, and frames then tell."""
        self._last = last
        self._q[self._rows] = self.joints.position
        self._v[self._rows] = self.joints.velocity
        self.gravity[...] = pin.computeGeneralizedGravity(self._model, self._measured, self._q)[self._rows]
        self._measured_fresh = self._commanded_fresh = False

    def frame(self, name: str) -> FramePose:
        """A frame where it is measured to be."""
        pose = pin.updateFramePlacement(self._model, self._measured_pass(), self.kinematics.frame_id(name))
        return FramePose(pose.rotation.copy(), pose.translation.copy())

    def commanded_frame(self, name: str) -> FramePose:
        """A frame where the joints are commanded to bring it."""
        pose = pin.updateFramePlacement(self._model, self._commanded_pass(), self.kinematics.frame_id(name))
        return FramePose(pose.rotation.copy(), pose.translation.copy())

    def lag(self, name: str) -> Array:
        """(3,) m: a frame's commanded minus its measured position."""
        frame = self.kinematics.frame_id(name)
        commanded = pin.updateFramePlacement(self._model, self._commanded_pass(), frame).translation
        return commanded - pin.updateFramePlacement(self._model, self._measured_pass(), frame).translation

    def commanded_frame_velocity(self, name: str) -> Array:
        """Linear velocity (3,) m/s of a frame's origin, world axes, as commanded."""
        frame = self.kinematics.frame_id(name)
        motion = pin.getFrameVelocity(self._model, self._commanded_pass(), frame, pin.LOCAL_WORLD_ALIGNED)
        return motion.linear.copy()

    def jacobian(self, name: str) -> Array:
        """(6, n): linear and angular velocity of a frame's origin, world axes, per joint velocity, where it is measured."""
        return self._model_jacobian(name)[:, self._rows]

    def joint_torque(self, name: str, force: Array) -> Array:
        """Jᵀ F, N·m (n,): joint torques that make a force (3,) N, world axes, at a frame's origin."""
        return (force @ self._model_jacobian(name)[:3])[self._rows]

    def estimate_forces(self, frames: Collection[str]) -> None:
        """Update `forces`: for each of `frames`, the force that something outside exerts on its origin.

        Weighted, damped least squares of Jᵀ F = C(q, q̇) q̇ + g(q) − τ_spring, low-passed at 30 Hz. Quasi-static, and meant for
        guards, not for force control: M(q) q̈ is left out, so a free arm that accelerates at 1 m/s² reads a few newtons; a moment
        at the frame, or a force elsewhere on the arm, is taken for a force at the frame; an error of the model's mass counts
        fully; along directions that the joints hardly move the estimate is pulled to zero by the damping. Each frame is
        estimated as if it were the only one touched.
        """
        for old in [frame for frame in self.forces if frame not in frames]:
            del self.forces[old]
        if not frames:
            return
        bias = pin.nonLinearEffects(self._model, self._measured, self._q, self._v)
        for frame in frames:
            gain = self._force_gain
            if frame not in self.forces:
                self.forces[frame], gain = np.zeros(3), 1.0
            jacobian = self._model_jacobian(frame)
            _follow_force(
                self.forces[frame], gain, jacobian, bias, self._rows, self.joints.torque, self._squared_weight
            )

    def _measured_pass(self) -> pin.Data:
        """Forward kinematics at the measured joints."""
        if not self._measured_fresh:
            pin.forwardKinematics(self._model, self._measured, self._q, self._v)
            self._measured_fresh = True
        return self._measured

    def _commanded_pass(self) -> pin.Data:
        """Forward kinematics at the commanded joints."""
        if not self._commanded_fresh:
            self._q_command[self._rows] = self._last.position
            self._v_command[self._rows] = self._last.velocity
            pin.forwardKinematics(self._model, self._commanded, self._q_command, self._v_command)
            self._commanded_fresh = True
        return self._commanded

    def _model_jacobian(self, name: str) -> Array:
        frame = self.kinematics.frame_id(name)
        return pin.computeFrameJacobian(self._model, self._measured, self._q, frame, pin.LOCAL_WORLD_ALIGNED)


@compiled
def _follow_force(force, gain, jacobian, bias, rows, torque, squared_weight):  # type: ignore[no-untyped-def]
    """Move `force` (3,) by `gain` towards argmin over F of Σ_j (w_j (Jᵀ F − bias + torque)_j)² + (noise |F| / largest)².

    Cramer's rule on the normal equations [[a, b, c], [b, d, e], [c, e, f]] F = (x, y, z); p … u: the adjugate.
    """
    a = d = f = (_TORQUE_NOISE / _LARGEST_FORCE) ** 2
    b = c = e = x = y = z = 0.0
    for j in range(rows.shape[0]):
        row = rows[j]
        residual, j0, j1, j2 = bias[row] - torque[j], jacobian[0, row], jacobian[1, row], jacobian[2, row]
        w0, w1, w2 = squared_weight[j] * j0, squared_weight[j] * j1, squared_weight[j] * j2
        x, y, z = x + w0 * residual, y + w1 * residual, z + w2 * residual
        a, b, c, d, e, f = a + w0 * j0, b + w0 * j1, c + w0 * j2, d + w1 * j1, e + w1 * j2, f + w2 * j2
    p, q, r, s, t, u = d * f - e * e, c * e - b * f, b * e - c * d, a * f - c * c, b * c - a * e, a * d - b * b
    determinant = a * p + b * q + c * r
    force[0] += gain * ((p * x + q * y + r * z) / determinant - force[0])
    force[1] += gain * ((q * x + s * y + t * z) / determinant - force[1])
    force[2] += gain * ((r * x + t * y + u * z) / determinant - force[2])
