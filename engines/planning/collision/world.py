"""The one collision world of planners and inverse kinematics: a robot's links, what stands around it, and who may not meet whom."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable, Sequence
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from engines.planning.collision.obstacles import Obstacle
from engines.planning.ik.mechanism import Mechanism

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

_NEAR_IN_TREE = 2
"""links at most so many joints apart overlap at their joints, or can't meet within the joints' limits: never checked"""


class World:
    """Read only once made, and may be shared; whoever measures in it has geometry data of its own.

    :param obstacles: what stands around; it stands still
    :param allowed: pairs of names (of links, and of obstacles with or without what they are part of; with wildcards) that may touch
    :param with_self: whether the robot's own links count
    :param moving: the joints that move, which leaves out pairs that stand still to each other; None: all of them.
        Raises ValueError for one that the mechanism does not have.
    """

    def __init__(
        self, mechanism: Mechanism, obstacles: Sequence[Obstacle] = (), allowed: Iterable[tuple[str, str]] = (),
        *, with_self: bool = True, moving: Iterable[str] | None = None,
    ):  # fmt: skip
        self.mechanism = mechanism
        self.obstacles = tuple(obstacles)
        self.moving = tuple(mechanism.joints if moving is None else moving)
        """joints, of the mechanism's"""
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
            names.append(obstacle.label)
            joints.append(0)
        self.links = links
        """the first bodies, which are the robot's; the others are obstacles"""
        self.names = tuple(names)
        """of the bodies: a link's or an obstacle's; several bodies may share one"""
        self.joints: Integers = np.array(joints, np.int64)
        """the joint that carries each body; 0: the world"""
        plain = [*names[:links], *(obstacle.name for obstacle in self.obstacles)]
        supports = [set(model.supports[j]) - {0} for j in range(model.njoints)]
        moves = self._movers(moving)
        pairs, may_touch = [], _listed(mechanism, allowed)
        for second in range(len(names)):
            for first in range(min(second, links)):
                apart = supports[joints[first]] ^ supports[joints[second]]
                wanted = bool(apart & moves)
                if second < links:
                    wanted = wanted and with_self and len(apart) > _NEAR_IN_TREE
                if wanted and not (may_touch[names[first], names[second]] or may_touch[names[first], plain[second]]):
                    pairs.append((first, second))
        for first, second in pairs:
            self.geometry.addCollisionPair(pin.CollisionPair(first, second))
        self.pairs: Integers = np.array(pairs, np.int64).reshape(-1, 2)
        """bodies that may not meet; row k is the geometry's collision pair k"""
        centres, radii = [], []
        for body in self.geometry.geometryObjects:
            body.geometry.computeLocalAABB()
            centres.append(body.geometry.aabb_center)
            radii.append(body.geometry.aabb_radius)
        self.centres = np.array(centres).reshape(-1, 3)
        """(bodies, 3) m, of a ball about each, in the body's own frame"""
        self.radii = np.array(radii)

    def _movers(self, moving: Iterable[str] | None) -> set[int]:
        model = self.mechanism.model
        if moving is None:
            return set(range(1, model.njoints))
        for joint in self.moving:
            self.mechanism.row(joint)
        return {model.getJointId(joint) for joint in self.moving}

    @cached_property
    def _unasked(self) -> pin.GeometryData:
        return self.geometry.createData()

    def forget(self, scratch: pin.GeometryData) -> None:
        """Drop where coal ended with each pair, from where it would begin again: distances then depend on nothing before."""
        scratch.distanceRequests = self._unasked.distanceRequests

    def bodies_of(self, name: str) -> list[int]:
        """The bodies of a link or an obstacle. Raises ValueError when there is none."""
        found = [i for i, one in enumerate(self.names) if one == name]
        if not found:
            raise ValueError(f"link: got {name!r}; expected one with a shape: {', '.join(sorted(set(self.names)))}")
        return found

    def between(self, pair: int) -> str:
        """Who a pair is, in words."""
        first, second = self.pairs[pair]
        return f"{self.names[first]} and {self.names[second]}"

    @property
    def of_itself(self) -> NDArray[np.bool_]:
        """(pairs,) whether both bodies are the robot's."""
        return np.asarray(self.pairs[:, 1] < self.links)

    def touching(self, *pairs: tuple[str, str]) -> NDArray[np.bool_]:
        """(pairs,) those of these names, with wildcards as in `allowed`."""
        plain = [*self.names[: self.links], *(obstacle.name for obstacle in self.obstacles)]
        found = _Listed(pairs)
        return np.array(
            [found[self.names[i], self.names[j]] or found[self.names[i], plain[j]] for i, j in self.pairs.tolist()],
            bool,
        )


_KNOWN: WeakKeyDictionary[Mechanism, dict[tuple[tuple[str, str], ...], _Listed]] = WeakKeyDictionary()


def _listed(mechanism: Mechanism, pairs: tuple[tuple[str, str], ...]) -> _Listed:
    """What is found is kept: a robot's links are the same in every world."""
    return _KNOWN.setdefault(mechanism, {}).setdefault(pairs, _Listed(pairs))


class _Listed(dict[tuple[str, str], bool]):
    """Two names → whether they are one of the pairs, either way round; pairs may have wildcards."""

    def __init__(self, pairs: Iterable[tuple[str, str]]):
        super().__init__()
        self._pairs = tuple(pairs)

    def __missing__(self, names: tuple[str, str]) -> bool:
        a, b = names
        self[names] = found = any(
            (fnmatch.fnmatchcase(a, one) and fnmatch.fnmatchcase(b, other))
            or (fnmatch.fnmatchcase(b, one) and fnmatch.fnmatchcase(a, other))
            for one, other in self._pairs
        )
        return found
