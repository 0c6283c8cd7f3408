"""Rows that keep bodies apart: the pairs that are near at a configuration, their witness points and the normal between them.

The balls about the bodies leave few pairs; coal finds those pairs' distances. The derivative of a distance is the normal times the
difference of the two points' velocities, exact where the closest points are unique (Schulman et al. 2014, TrajOpt, §IV).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from engines.planning.collision.world import World
from engines.planning.ik import kernels
from engines.planning.ik.constraints import BodyDistance, Clearance
from engines.planning.ik.mechanism import Mechanism
from handrail.robot.model_memory import placements

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

REACH = 0.15
"""m beyond what is asked for: pairs further apart have no row in a step"""
MOST = 24
"""rows of one constraint: the nearest"""


class Bodies:
    """The bodies of one scene as one solver sees them: all its pairs, or those of two links."""

    def __init__(self, mechanism: Mechanism, data: pin.Data, scene: World, *links: str):
        self.model, self.data = mechanism.model, data
        self.joints, self.centres, self.radii = scene.joints, scene.centres, scene.radii
        self.geometry, self.pairs = _only(scene, *links) if links else (scene.geometry, scene.pairs)
        self.scratch = self.geometry.createData()
        self.placements = placements(self.scratch.oMg) if len(self.scratch.oMg) else np.empty((0, 12))
        self.balls = np.empty((len(self.radii), 3))
        self.found = np.empty(len(self.pairs), np.int64)

    def within(self, constraint: Clearance | BodyDistance, *, gives: bool = False) -> Nearness:
        """With the constraint's bounds."""
        if isinstance(constraint, Clearance):
            return Nearness(self, constraint.floors, np.inf, gives)
        return Nearness(self, np.full(len(self.pairs), constraint.lower), constraint.upper, gives)


@dataclass(frozen=True)
class Nearness:
    """One constraint between bodies, as a solver evaluates it."""

    bodies: Bodies
    lower: Array
    """(pairs,) m"""
    upper: float
    gives: bool
    """whether it may give way"""

    @property
    def most(self) -> int:
        """Rows that there can be."""
        return min(MOST, len(self.bodies.pairs))

    def items(self, integers: Integers, numbers: Array, lower: Array, upper: Array, first: int) -> int:
        """Writes the near pairs' items, whose rows count from `first`, and their bounds; how many.

        After a kinematics pass on the solver's data.
        """
        b = self.bodies
        pin.updateGeometryPlacements(b.model, b.data, b.geometry, b.scratch)
        bounded = self.upper < np.inf
        reach = np.inf if bounded else float(self.lower.max(initial=0.0)) + REACH
        near = kernels.near_pairs(b.placements, b.centres, b.radii, b.pairs, reach, b.balls, b.found)
        found = []
        for pair in b.found[:near].tolist():
            result = pin.computeDistance(b.geometry, b.scratch, pair)
            if result.min_distance < reach:
                found.append((result.min_distance, pair, result))
        if len(found) > MOST:
            found = sorted(found, key=lambda one: one[:2])[:MOST]
        least = min((one[0] for one in found), default=0.0)
        for k, (distance, pair, result) in enumerate(found):
            one, other = b.pairs[pair]
            integers[k] = kernels.PAIR, b.joints[one], b.joints[other], first + k
            numbers[k, kernels.PLACE_A : kernels.PLACE_A + 3] = result.normal
            numbers[k, kernels.PLACE_B] = distance
            numbers[k, kernels.VECTOR : kernels.VECTOR + 3] = result.getNearestPoint1()
            numbers[k, kernels.OTHER : kernels.OTHER + 3] = result.getNearestPoint2()
            lower[k] = self.lower[pair]
            upper[k] = self.upper if distance == least else np.inf
        return len(found)


def _only(scene: World, link: str, other: str) -> tuple[pin.GeometryModel, Integers]:
    geometry = pin.GeometryModel(scene.geometry)
    geometry.removeAllCollisionPairs()
    pairs = [(min(i, j), max(i, j)) for i in scene.bodies_of(link) for j in scene.bodies_of(other)]
    for first, second in pairs:
        geometry.addCollisionPair(pin.CollisionPair(first, second))
    return geometry, np.array(pairs, np.int64).reshape(-1, 2)
