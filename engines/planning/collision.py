"""Clearances by coal through pinocchio: the robot's links as convex hulls against a template's shapes and against each other."""

from __future__ import annotations

import fnmatch
from collections.abc import Sequence
from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from engines.planning.obstacles import Obstacle
from handrail.robot.description import Arm
from handrail.robot.kinematics import Kinematics

Array = NDArray[np.float64]

_NEAR_IN_TREE = 2
"""links at most so many joints apart overlap at their joints, or can't meet within the joints' limits: never checked"""


@dataclass(frozen=True)
class Clearance:
    """Distances over a way of k postures, the smallest, and between whom. Negative: penetration."""

    distance: float
    between: str
    along: Array
    """(k,) m at every posture"""
    pairs: tuple[str, ...]
    """(k,) between whom that is"""

    @classmethod
    def of(cls, along: Array, pairs: tuple[str, ...]) -> Clearance:
        """From what is nearest at every posture, at least one."""
        row = int(np.argmin(along))
        return cls(float(along[row]), pairs[row], along, pairs)


def nearer(one: Clearance, other: Clearance) -> Clearance:
    """Of two over the same way, what is nearer at every posture."""
    pairs = tuple(a if x <= y else b for x, y, a, b in zip(one.along, other.along, one.pairs, other.pairs, strict=True))
    return Clearance.of(np.minimum(one.along, other.along), pairs)


class RobotBodies:
    """The robot's collision geometry, and which pairs of it can meet when one arm moves."""

    def __init__(self, kinematics: Kinematics):
        self.kinematics = kinematics
        self.description = kinematics.description
        model = kinematics.model
        self.geometry = pin.buildGeomFromUrdf(model, str(self.description.urdf), pin.COLLISION)
        self.links: list[str] = []
        for body in self.geometry.geometryObjects:
            if isinstance(body.geometry, coal.BVHModelBase):
                body.geometry.buildConvexHull(True, "Qt")
                body.geometry = body.geometry.convex
            self.links.append(model.frames[body.parentFrame].name)
        self._ancestors = [self._chain(body.parentJoint) for body in self.geometry.geometryObjects]

    def _chain(self, joint: int) -> tuple[int, ...]:
        chain = []
        while joint:
            chain.append(joint)
            joint = self.kinematics.model.parents[joint]
        return tuple(reversed(chain))

    def _allowed(self, a: str, b: str) -> bool:
        return any(
            (fnmatch.fnmatch(a, one) and fnmatch.fnmatch(b, other))
            or (fnmatch.fnmatch(b, one) and fnmatch.fnmatch(a, other))
            for one, other in self.description.allowed_collision_pairs
        )

    def self_pairs(self, arm: Arm) -> list[tuple[int, int]]:
        """Pairs of bodies whose relative pose depends on the arm's joints, the allowed and the neighbouring ones left out."""
        moving = {self.kinematics.model.getJointId(name) for name in arm.joints}
        pairs = []
        for i in range(len(self.links)):
            for j in range(i):
                between = set(self._ancestors[i]) ^ set(self._ancestors[j])
                if (
                    between & moving
                    and len(between) > _NEAR_IN_TREE
                    and not self._allowed(self.links[i], self.links[j])
                ):
                    pairs.append((j, i))
        return pairs

    def carried(self, arm: Arm) -> tuple[list[int], list[int]]:
        """Bodies that the arm's joints move: those of its tool, all others."""
        moving = {self.kinematics.model.getJointId(name) for name in arm.joints}
        bodies = [i for i, chain in enumerate(self._ancestors) if moving & set(chain)]
        return [i for i in bodies if self.links[i] == arm.tool], [i for i in bodies if self.links[i] != arm.tool]


class CollisionScene:
    """Distances of one arm on its way among obstacles that stand still."""

    def __init__(self, bodies: RobotBodies, arm: Arm, obstacles: Sequence[Obstacle]):
        self._kinematics = bodies.kinematics
        tool, others = bodies.carried(arm)
        first = len(bodies.links)
        behind = range(first, first + len(obstacles))
        self._names = [*bodies.links, *(obstacle.name for obstacle in obstacles)]
        self._self = self._checker(bodies, obstacles, bodies.self_pairs(arm))
        self._others = self._checker(bodies, obstacles, [(i, j) for i in others for j in behind])
        self._tool = self._checker(bodies, obstacles, [(i, j) for i in tool for j in behind])

    @staticmethod
    def _checker(
        bodies: RobotBodies, obstacles: Sequence[Obstacle], pairs: list[tuple[int, int]]
    ) -> tuple[pin.GeometryModel, pin.GeometryData] | None:
        if not pairs:
            return None
        geometry = pin.GeometryModel()
        for body in bodies.geometry.geometryObjects:
            geometry.addGeometryObject(body)
        for number, obstacle in enumerate(obstacles):
            geometry.addGeometryObject(
                pin.GeometryObject(f"obstacle_{number}", 0, 0, obstacle.placement, obstacle.geometry)
            )
        for i, j in pairs:
            geometry.addCollisionPair(pin.CollisionPair(i, j))
        return geometry, geometry.createData()

    def to_self(self, positions: Array) -> Clearance:
        """The robot from itself over positions (k, n) rad of all joints."""
        return self._smallest(self._self, positions)

    def to_obstacles(self, positions: Array, *, tool_may_touch: bool) -> Clearance:
        """What the arm carries from the obstacles over positions (k, n) rad; the tool counts unless it may touch."""
        others = self._smallest(self._others, positions)
        if tool_may_touch:
            return others
        return nearer(others, self._smallest(self._tool, positions))

    def _smallest(self, checker: tuple[pin.GeometryModel, pin.GeometryData] | None, positions: Array) -> Clearance:
        if checker is None:
            return Clearance.of(np.full(len(positions), np.inf), ("",) * len(positions))
        geometry, data = checker
        model, scratch = self._kinematics.model, self._kinematics.data
        along, nearest = np.empty(len(positions)), []
        for row, position in enumerate(positions):
            pair = pin.computeDistances(model, scratch, geometry, data, self._kinematics.configuration(position))
            along[row] = data.distanceResults[pair].min_distance
            nearest.append(pair)
        return Clearance.of(along, tuple(self._between(geometry.collisionPairs[pair]) for pair in nearest))

    def _between(self, pair: pin.CollisionPair) -> str:
        return f"{self._names[pair.first]} and {self._names[pair.second]}"
