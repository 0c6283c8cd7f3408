"""Forward kinematics of a URDF for drawing: the world poses of its moving bodies, for one posture or many at once.

`yourdfpy` reads the URDF. Its own `update_cfg` walks a scene graph of every link in 6 ms for TALOS; a window that draws robot
and ghost thirty times a second wants less, so the chain of moving bodies is evaluated here with arrays (0.1 ms, tested against
yourdfpy). Links behind fixed joints belong to the body that carries them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import yourdfpy
from numpy.typing import NDArray

Array = NDArray[np.float64]

_MOVING = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class Frame:
    """A link: the body that carries it, and its constant pose in that body's frame (4, 4)."""

    body: int
    pose_in_body: Array


class Chain:
    """The moving bodies of a robot, seen from its base, which is body 0; each other one moves with a joint of its own."""

    def __init__(self, model: yourdfpy.URDF, joints: Sequence[str]):
        """`joints`: the order of the columns of all positions. Raises KeyError for a joint that the URDF does not move."""
        self.joints = tuple(joints)
        columns = {name: column for column, name in enumerate(joints)}
        children: dict[str, list[yourdfpy.Joint]] = {}
        for joint in model.robot.joints:
            children.setdefault(joint.parent, []).append(joint)
        for name in joints:
            if name not in model.joint_map or model.joint_map[name].type not in _MOVING:
                raise KeyError(f"joint {name} does not move in the URDF of {model.robot.name}")

        carried = {joint.child for joint in model.robot.joints}
        base = next(link.name for link in model.robot.links if link.name not in carried)
        self.frames: dict[str, Frame] = {base: Frame(0, np.eye(4))}
        names, parents, mounts, axes, slides, sources = [base], [-1], [np.eye(4)], [np.zeros(3)], [False], []
        queue = [base]
        while queue:
            link = queue.pop()
            at = self.frames[link]
            for joint in children.get(link, ()):
                mount = at.pose_in_body @ (np.eye(4) if joint.origin is None else joint.origin)
                if joint.type in _MOVING:
                    self.frames[joint.child] = Frame(len(names), np.eye(4))
                    names.append(joint.child)
                    parents.append(at.body)
                    mounts.append(mount)
                    axes.append(np.asarray(joint.axis, float) / np.linalg.norm(joint.axis))
                    slides.append(joint.type == "prismatic")
                    sources.append(_source(joint, columns))
                else:
                    self.frames[joint.child] = Frame(at.body, mount)
                queue.append(joint.child)

        self.bodies = tuple(names)
        """the links that give the bodies their frames; index 0 is the base"""
        self._parents = parents
        self._mounts = np.array(mounts)
        self._slides = np.array(slides)
        self._axes = np.array(axes)
        x, y, z = self._axes.T
        zero = np.zeros_like(x)
        self._cross = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
        self._cross_squared = self._cross @ self._cross
        self._columns = np.array([0] + [column for column, _, _ in sources])
        self._factors = np.array([0.0] + [factor for _, factor, _ in sources])
        self._offsets = np.array([0.0] + [offset for _, _, offset in sources])
        self._masses, self._middles = _weigh(model, self.frames, len(names))

    def poses(self, positions: Array) -> Array:
        """Poses (..., bodies, 4, 4) at `positions` (..., n), rad or m."""
        positions = np.asarray(positions, float)
        values = positions[..., self._columns] * self._factors + self._offsets
        motion = np.zeros((*values.shape, 4, 4))
        angle = np.where(self._slides, 0.0, values)[..., None, None]
        motion[..., :3, :3] = np.eye(3) + np.sin(angle) * self._cross + (1 - np.cos(angle)) * self._cross_squared
        motion[..., :3, 3] = np.where(self._slides, values, 0.0)[..., None] * self._axes
        motion[..., 3, 3] = 1.0
        local = self._mounts @ motion
        world = np.empty_like(local)
        for body, parent in enumerate(self._parents):
            world[..., body, :, :] = (
                local[..., body, :, :] if parent < 0 else (world[..., parent, :, :] @ local[..., body, :, :])
            )
        return world

    def centre_of_mass(self, poses: Array) -> Array:
        """(..., 3) m, in the base, of bodies at `poses` (..., bodies, 4, 4)."""
        middles = np.einsum("...bij,bj->...bi", poses[..., :3, :3], self._middles) + poses[..., :3, 3]
        return np.asarray(np.einsum("b,...bi->...i", self._masses, middles) / self._masses.sum())

    def leading(self, link: str) -> tuple[str, ...]:
        """The joints between the base and a link, from the base on."""
        body, found = self.frames[link].body, list[str]()
        while body > 0:
            if self._factors[body]:
                found.append(self.joints[self._columns[body]])
            body = self._parents[body]
        return tuple(reversed(found))

    def positions(self, link: str, positions: Array) -> Array:
        """Positions (k, 3), m, of a link's origin along `positions` (k, n)."""
        frame = self.frames[link]
        poses = self.poses(positions)[:, frame.body]
        return poses[:, :3, :3] @ frame.pose_in_body[:3, 3] + poses[:, :3, 3]


def _weigh(model: yourdfpy.URDF, frames: dict[str, Frame], bodies: int) -> tuple[Array, Array]:
    """Masses (bodies,) kg, and centres of mass (bodies, 3) m in the bodies' own frames. A model that says nothing of its masses has
    its centre at its base.
    """
    masses, moments = np.zeros(bodies), np.zeros((bodies, 3))
    for link in model.robot.links:
        inertial = link.inertial
        if link.name not in frames or inertial is None or not inertial.mass:
            continue
        frame, middle = frames[link.name], np.eye(4) if inertial.origin is None else inertial.origin
        masses[frame.body] += inertial.mass
        moments[frame.body] += inertial.mass * (frame.pose_in_body @ middle)[:3, 3]
    if not masses.any():
        masses[0] = 1.0
    return masses, moments / np.maximum(masses, 1e-12)[:, None]


def _source(joint: yourdfpy.Joint, columns: dict[str, int]) -> tuple[int, float, float]:
    """Which column moves the joint, its factor and offset; a joint that nobody commands rests at zero."""
    if joint.mimic is not None and joint.mimic.joint in columns:
        return columns[joint.mimic.joint], joint.mimic.multiplier or 1.0, joint.mimic.offset or 0.0
    if joint.name in columns:
        return columns[joint.name], 1.0, 0.0
    return 0, 0.0, 0.0
