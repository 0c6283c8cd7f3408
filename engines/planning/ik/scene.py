"""The bodies that a clearance is about: a robot's links and what stands around it, and which pairs of them may not meet."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable, Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from engines.planning.ik.mechanism import Mechanism
from engines.planning.obstacles import Obstacle

_NEAR_IN_TREE = 2
"""links at most so many joints apart overlap at their joints, or can't meet within the joints' limits: never checked"""


class Scene:
    """Read only once made, and may be shared; each solver has geometry data of its own.

    `allowed`: pairs of names (of links and obstacles, with wildcards) that may meet or touch.
    """

    def __init__(
        self, mechanism: Mechanism, obstacles: Sequence[Obstacle] = (), allowed: Iterable[tuple[str, str]] = (),
        *, with_self: bool = True,
    ):  # fmt: skip
        self.mechanism = mechanism
        self.obstacles = tuple(obstacles)
        self.geometry = pin.GeometryModel()
        model, allowed = mechanism.model, tuple(allowed)
        names, joints = [], []
        for body in mechanism.geometry.geometryObjects:
            self.geometry.addGeometryObject(body)
            names.append(model.frames[body.parentFrame].name)
            joints.append(body.parentJoint)
        links = len(names)
        for number, obstacle in enumerate(self.obstacles):
            self.geometry.addGeometryObject(
                pin.GeometryObject(f"obstacle {number}", 0, 0, obstacle.placement, obstacle.geometry)
            )
            names.append(obstacle.name)
            joints.append(0)
        self.names = tuple(names)
        """of the bodies: a link's or an obstacle's; several bodies may share one"""
        self.joints: NDArray[np.int64] = np.array(joints, np.int64)
        """the joint that carries each body; 0: the world"""
        supports = [set(model.supports[j]) for j in range(model.njoints)]
        pairs = []
        for second in range(len(names)):
            for first in range(min(second, links)):
                if second < links:
                    apart = supports[joints[first]] ^ supports[joints[second]]
                    wanted = with_self and len(apart) > _NEAR_IN_TREE
                else:
                    wanted = joints[first] != 0
                if wanted and not _listed(names[first], names[second], allowed):
                    pairs.append((first, second))
        for first, second in pairs:
            self.geometry.addCollisionPair(pin.CollisionPair(first, second))
        self.pairs: NDArray[np.int64] = np.array(pairs, np.int64).reshape(-1, 2)
        """bodies that may not meet; row k is the geometry's collision pair k"""
        centres, radii = [], []
        for body in self.geometry.geometryObjects:
            body.geometry.computeLocalAABB()
            centres.append(body.geometry.aabb_center)
            radii.append(body.geometry.aabb_radius)
        self.centres = np.array(centres).reshape(-1, 3)
        """(bodies, 3) m, of a ball about each, in the body's own frame"""
        self.radii = np.array(radii)

    def bodies_of(self, name: str) -> list[int]:
        """The bodies of a link or an obstacle. Raises ValueError when there is none."""
        found = [i for i, one in enumerate(self.names) if one == name]
        if not found:
            raise ValueError(f"link: got {name!r}; expected one with a shape: {', '.join(sorted(set(self.names)))}")
        return found


def _listed(a: str, b: str, pairs: Iterable[tuple[str, str]]) -> bool:
    return any(
        (fnmatch.fnmatchcase(a, one) and fnmatch.fnmatchcase(b, other))
        or (fnmatch.fnmatchcase(b, one) and fnmatch.fnmatchcase(a, other))
        for one, other in pairs
    )
