"""The rigid-body model that the daemon and the planners share (pinocchio; robot side only).

Arrays have one row a joint in the description's order; frames are in the world, which is the fixed base's `base_link`.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from handrail.robot.description import RobotDescription
from handrail.robot.rooting import rebuilt, turns_without_end


class Kinematics:
    """A pinocchio model of a robot with one-degree-of-freedom joints, seen from its base.

    Joints that a gripper moves are part of the model, and stand where `set_gripper` put them last: closed at 0 at first.
    """

    def __init__(self, description: RobotDescription):
        self.description = description
        self.model = pin.buildModelFromUrdf(str(description.urdf))
        if turns_without_end(self.model):
            self.model, _ = rebuilt(self.model, pin.GeometryModel())
        self.data = self.model.createData()
        ids = [self.model.getJointId(name) for name in description.joints]
        self.index_v = np.array([self.model.idx_vs[i] for i in ids], dtype=np.intp)
        """(n,) the model's velocity index of each joint; for such joints it is the configuration's index too"""
        self._q = pin.neutral(self.model)
        for joint, (lower, upper, _, _) in description.device_limits.items():
            self.set_gripper(joint, min(max(0.0, lower), upper))
        self._frames: dict[str, int] = {}

    def set_gripper(self, joint: str, position: float) -> None:
        """Put a gripper's driven joint at `position`, rad or m, and the joints that mimic it where they then are.

        Raises KeyError for a joint that no gripper drives.
        """
        if joint not in self.description.device_limits:
            raise KeyError(joint)
        self._q[self._row(joint)] = position
        for follower, mimic in self.description.mimics.items():
            if mimic.joint == joint:
                self._q[self._row(follower)] = mimic.multiplier * position + mimic.offset

    def _row(self, joint: str) -> int:
        return self.model.idx_vs[self.model.getJointId(joint)]

    def configuration(self, position: np.ndarray) -> np.ndarray:
        """pinocchio's q for joint positions (n,) rad. The array is reused by the next call."""
        self._q[self.index_v] = position
        return self._q

    def frame_id(self, name: str) -> int:
        """pinocchio's index of a frame: the link's where a joint has the same name. Raises KeyError when there is none."""
        if name not in self._frames:
            if not self.model.existFrame(name):
                raise KeyError(name)
            link = self.model.existFrame(name, pin.BODY)
            self._frames[name] = self.model.getFrameId(name, pin.BODY) if link else self.model.getFrameId(name)
        return self._frames[name]

    def frame(self, position: np.ndarray, name: str) -> pin.SE3:
        """Pose of a frame in the world at joint positions (n,) rad."""
        pin.forwardKinematics(self.model, self.data, self.configuration(position))
        return pin.SE3(pin.updateFramePlacement(self.model, self.data, self.frame_id(name)))

    def jacobian(self, position: np.ndarray, name: str) -> np.ndarray:
        """(6, n): linear and angular velocity of the frame's origin, world axes, per joint velocity."""
        full = pin.computeFrameJacobian(
            self.model, self.data, self.configuration(position), self.frame_id(name), pin.LOCAL_WORLD_ALIGNED
        )
        return full[:, self.index_v]

    def gravity(self, position: np.ndarray) -> np.ndarray:
        """Torque (n,) N·m that holds the robot still at joint positions (n,) rad."""
        return pin.computeGeneralizedGravity(self.model, self.data, self.configuration(position))[self.index_v]

    def inverse_dynamics(self, positions: np.ndarray, velocities: np.ndarray, accelerations: np.ndarray) -> np.ndarray:
        """Torques (k, n) N·m, gravity included, through positions (k, n) rad at velocities, rad/s, and accelerations, rad/s²."""
        velocity, acceleration = np.zeros(self.model.nv), np.zeros(self.model.nv)
        torques = np.empty(np.shape(positions))
        for row, position in enumerate(positions):
            velocity[self.index_v], acceleration[self.index_v] = velocities[row], accelerations[row]
            torques[row] = pin.rnea(self.model, self.data, self.configuration(position), velocity, acceleration)[
                self.index_v
            ]
        return torques

    def mass_matrix(self, position: np.ndarray) -> np.ndarray:
        """Joint-space inertia (n, n) kg·m² at joint positions (n,) rad."""
        pin.crba(self.model, self.data, self.configuration(position))
        upper = np.triu(self.data.M)
        full = upper + np.triu(upper, 1).T
        return full[np.ix_(self.index_v, self.index_v)]
