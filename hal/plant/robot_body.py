"""The robot as a PyBullet body: which of its numbers is which joint and link, and how a link moves."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from hal.plant.bullet import pybullet as p
from hal.plant.model import carriers, prepare
from handrail.robot.description import RobotDescription

BASE = -1
"""PyBullet's number of a body's root link"""
_FRICTION = 0.6
# What grips is made to grip: soft pads, on the links that a gripper moves.
_PAD_FRICTION = 1.0


Vector = tuple[float, ...]
Motion = tuple[Vector, Vector, Vector, Vector, Vector]
"""of a link, in the world: its centre of mass m, its frame's position m and orientation (x, y, z, w), and its centre's velocity
m/s and angular velocity rad/s"""


class RobotBody:
    """One robot in one world. Its base stands at the world's origin: fixed (a gantry's harness is that too), or loose."""

    def __init__(self, description: RobotDescription, client: int, *, visual: bool = False, urdf: Path | None = None):
        """`visual`: with its looks, for pictures; `urdf`: made from what `prepare` gave, and used instead of it."""
        self.description, self.client = description, client
        self.fixed = description.base == "fixed" or description.support == "gantry"
        self.number = p.loadURDF(
            str(urdf or prepare(description, visual=visual)),
            useFixedBase=self.fixed,
            flags=p.URDF_USE_INERTIA_FROM_FILE,
            physicsClientId=client,
        )
        infos = [
            p.getJointInfo(self.number, i, physicsClientId=client) for i in range(p.getNumJoints(self.number, client))
        ]
        self.joints = {info[1].decode(): info[0] for info in infos}
        """joint → PyBullet's number of it, which is its child link's too"""
        self._parents = {info[0]: info[16] for info in infos}
        self.links = {info[12].decode(): info[0] for info in infos}
        self.links[p.getBodyInfo(self.number, physicsClientId=client)[0].decode()] = BASE
        # PyBullet counts velocities from 6 on, whether the base's own six are there or not.
        self.first_dof = 6 if self.fixed else 0
        self.dofs = {info[1].decode(): info[4] - self.first_dof for info in infos if info[4] >= 0}
        """moving joint → its row in PyBullet's mass matrix"""
        self._home = carriers(description)
        self._to_frame = {}
        for link in range(BASE, len(infos)):
            dynamics = p.getDynamicsInfo(self.number, link, physicsClientId=client)
            self._to_frame[link] = (np.array(dynamics[3]), _rotation(dynamics[4]))
            p.changeDynamics(
                self.number,
                link,
                jointDamping=0,
                linearDamping=0,
                angularDamping=0,
                lateralFriction=_FRICTION,
                physicsClientId=client,
            )
        base = p.getDynamicsInfo(self.number, BASE, physicsClientId=client)
        self._frame_in_centre = p.invertTransform(base[3], base[4])
        gripping = {*description.mimics, *description.device_limits}
        for joint in gripping & set(self.joints):
            p.changeDynamics(self.number, self.joints[joint], lateralFriction=_PAD_FRICTION, physicsClientId=client)

    def inertial(self, link: int) -> tuple[np.ndarray, np.ndarray]:
        """Centre of mass (3,) m and axes (3, 3) of PyBullet's inertial frame, in the link's own frame."""
        return self._to_frame[link]

    def beyond(self, link: int) -> list[int]:
        """One of PyBullet's links and all that hang on it."""
        found = [link]
        for number in sorted(self.joints.values()):
            if number != link and self._parents[number] in found:
                found.append(number)
        return found

    def place(self, joint: str, position: float) -> None:
        """Put a joint somewhere, at rest."""
        p.resetJointState(self.number, self.joints[joint], position, physicsClientId=self.client)

    def mass_matrix(self, positions: dict[str, float]) -> np.ndarray:
        """Inertia of all moving joints, and of a free base, at `positions` (joint → rad or m, 0 where left out); rows as `dofs`."""
        values = np.zeros(len(self.dofs))
        for joint, position in positions.items():
            values[self.dofs[joint] - (0 if self.fixed else 6)] = position
        configuration = values.tolist() if self.fixed else [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, *values.tolist()]
        return np.array(p.calculateMassMatrix(self.number, configuration, physicsClientId=self.client))

    def frame(self, link: str) -> tuple[int, np.ndarray, np.ndarray]:
        """PyBullet's link that carries a link of the description, with position (3,) and rotation (3, 3) of its frame there.

        Raises KeyError for a link that the robot has not.
        """
        carrier, placement = self._home[link]
        return self.links[carrier], placement[:3, 3].copy(), placement[:3, :3].copy()

    def link_motion(self, link: int) -> Motion:
        """How one of PyBullet's links moves."""
        if link == BASE:
            centre, orientation, linear, angular = self.base_motion()
            position, orientation = p.multiplyTransforms(centre, orientation, *self._frame_in_centre)
            return centre, position, orientation, linear, angular
        state = p.getLinkState(
            self.number, link, computeLinkVelocity=1, computeForwardKinematics=1, physicsClientId=self.client
        )
        return state[0], state[4], state[5], state[6], state[7]

    def base_motion(self) -> tuple[Vector, Vector, Vector, Vector]:
        """Of the root link's inertial frame in the world: position, orientation, velocity and angular velocity."""
        centre, orientation = p.getBasePositionAndOrientation(self.number, physicsClientId=self.client)
        linear, angular = p.getBaseVelocity(self.number, physicsClientId=self.client)
        return centre, orientation, linear, angular


def _rotation(orientation: Vector) -> np.ndarray:
    return np.array(p.getMatrixFromQuaternion(orientation)).reshape(3, 3)
