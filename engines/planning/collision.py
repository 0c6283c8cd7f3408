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
    """The smallest distance over a way, and between whom. Negative: penetration."""

    distance: float
    between: str


NONE = Clearance(np.inf, "")


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
        return min(others, self._smallest(self._tool, positions), key=lambda clearance: clearance.distance)

    def _smallest(self, checker: tuple[pin.GeometryModel, pin.GeometryData] | None, positions: Array) -> Clearance:
        if checker is None:
            return NONE
        geometry, data = checker
        model, scratch = self._kinematics.model, self._kinematics.data
        distance, pair = np.inf, 0
        for position in positions:
            index = pin.computeDistances(model, scratch, geometry, data, self._kinematics.configuration(position))
            here = data.distanceResults[index].min_distance
            if here < distance:
                distance, pair = here, index
        first, second = geometry.collisionPairs[pair].first, geometry.collisionPairs[pair].second
        return Clearance(float(distance), f"{self._names[first]} and {self._names[second]}")
