"""Whether a motion keeps clear all along it, not at samples, and how near whom it comes.

A stretch of the motion is judged at a configuration in its middle: what coal measures there, less how far the joints can bring
two bodies nearer over the stretch (`sweep_kernels`), is a lower bound of their distance. Pairs for which that is not enough are
looked at in both halves (adaptive dynamic collision checking: Schwarzer, Saha, Latombe 2005). A motion is (k, c, nq) control
points: k pieces that follow each other, each a Bézier curve with c points; all of a piece lies within their hull.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from engines.planning.collision.sweep_kernels import near_in_stretch
from engines.planning.collision.world import World
from handrail.robot.model_memory import placements

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Chosen = NDArray[np.bool_]

FINEST = 2e-4
"""m: bodies that come so close to what is allowed count as too near, without looking closer"""


@dataclass(frozen=True)
class Nearest:
    """The smallest distance, between whom, and where. Negative: penetration."""

    distance: float
    """m; infinite where there is nothing to meet"""
    between: str
    pair: int
    """of the world's; -1 where there is none"""
    q: Array
    """(nq,)"""
    piece: int = 0
    """of the motion"""


def lines(rows: Array) -> Array:
    """(k − 1, 2, nq): straight from one configuration (k, nq) to the next; a single one stays where it is."""
    rows = np.asarray(rows, dtype=float)
    return np.stack([rows[:-1], rows[1:]], axis=1) if len(rows) > 1 else rows[:, None, :]


def cubics(times: Array, rows: Array, rates: Array) -> Array:
    """(k − 1, 4, nq): the cubic Hermite pieces between knots, s, (k, nq) and (k, nq) a second."""
    third = np.diff(times)[:, None] / 3.0
    return np.stack([rows[:-1], rows[:-1] + third * rates[:-1], rows[1:] - third * rates[1:], rows[1:]], axis=1)


class Sweep:
    """Measures in one world. Not for several threads at once."""

    def __init__(self, world: World):
        mechanism = world.mechanism
        model = mechanism.model
        self.world = world
        self._model, self._data, self._scratch = model, model.createData(), world.geometry.createData()
        pin.forwardKinematics(model, self._data, pin.neutral(model))
        pin.updateGeometryPlacements(model, self._data, world.geometry, self._scratch)
        self._joint_places = placements(self._data.oMi)
        self._body_places = placements(self._scratch.oMg) if len(self._scratch.oMg) else np.empty((0, 12))
        self._rows, self._columns = mechanism.q_rows, mechanism.v_rows
        self._axes, self._turns = np.zeros((model.nv, 3)), np.zeros(model.nv, np.bool_)
        self._column_joints = np.zeros(model.nv, np.int64)
        for joint in range(1, model.njoints):
            first, size = model.idx_vs[joint], model.nvs[joint]
            self._column_joints[first : first + size] = joint
            if size == 1:
                motion = np.asarray(model.joints[joint].createData().S).reshape(-1)
                self._turns[first] = bool(motion[3:].any())
                self._axes[first] = motion[3:] if self._turns[first] else motion[:3]
        support = mechanism.support
        chains = [support[j, 1 : support[j, 0] + 1].tolist() for j in world.joints]
        self._shared = np.array([_common(chains[a], chains[b]) for a, b in world.pairs.tolist()], np.int64)
        self._all = np.arange(len(world.pairs))
        self._still = np.zeros(model.nv)
        bodies = len(world.names)
        self._balls, self._moved = np.empty((bodies, 3)), np.zeros((bodies, model.nv + 1))
        self._found, self._travel = np.empty(len(self._all), np.int64), np.empty(len(self._all))

    def forget(self) -> None:
        """As if it had not measured anything yet."""
        self.world.forget(self._scratch)

    def nearest(self, q: Array, chosen: Chosen | None = None, *, within: float = np.inf, guess: int = -1) -> Nearest:
        """At one configuration (nq,), among the chosen pairs (all), those further apart than `within` m left out.

        `guess`: one of them that is likely near (the nearest one nearby), which saves looking at many.
        """
        active = self._all if chosen is None else self._all[chosen]
        best = Nearest(within, "", -1, q)
        self._place(q)
        if guess >= 0:
            best = min(best, Nearest(self._distance(guess), self.world.between(guess), guess, q), key=_distance_of)
        near = self._near_placed(self._still, active, np.full(len(self._all), best.distance))
        pair, distance = best.pair, best.distance
        for k, bound in self._by_gap(self._found[:near], self._travel[:near]):
            if bound >= distance:
                break
            if (here := self._distance(int(self._found[k]))) < distance:
                pair, distance = int(self._found[k]), here
        return best if pair == best.pair else Nearest(distance, self.world.between(pair), pair, q)

    def meeting(self, motion: Array, floors: Array, cancelled: Callable[[], bool] | None = None) -> Nearest | None:
        """Where a motion brings a pair nearer than its floor (pairs,) m; None: nowhere along it, for certain.

        Pairs with a floor of −inf may do as they like. Where `cancelled` says True, None as well: ask it again.
        Raises ValueError where a base moves.
        """
        self._refuse_moving_base(motion)
        world, active = self.world, self._all[floors > -np.inf]
        queue = deque([(motion, 0, active)])
        while queue:
            if cancelled is not None and cancelled():
                return None
            part, first, active = queue.popleft()
            q, excursion, middle = self._refer(part)
            near = self._near(q, excursion, active, floors)
            left = []
            for k in range(near):
                pair, travel = int(self._found[k]), self._travel[k]
                distance = self._distance(pair)
                if distance < floors[pair] or (distance - travel < floors[pair] and travel < FINEST):
                    return Nearest(distance, world.between(pair), pair, q, first + middle)
                if distance - travel < floors[pair]:
                    left.append(pair)
            if left:
                waiting = np.array(left, np.int64)
                queue.extend((half, first + offset, waiting) for half, offset in _halves(part))
        return None

    def _refuse_moving_base(self, motion: Array) -> None:
        other = np.delete(motion, self._rows, axis=2)
        if other.size and np.ptp(other, axis=(0, 1)).any():
            raise ValueError(
                "motion: got one of the base or of joints without limits; expected one of limited joints only"
            )

    def _refer(self, part: Array) -> tuple[Array, Array, int]:
        """A configuration in the middle of a part, how far the others are from it (nv,), and the piece that it is in."""
        k = len(part)
        middle = k // 2
        q = part[middle, 0] if k > 1 else _at_half(part[0])
        away = np.abs(part - q).max(axis=(0, 1))
        excursion = np.zeros(self._model.nv)
        excursion[self._columns] = away[self._rows]
        return q, excursion, middle

    def _distance(self, pair: int) -> float:
        """m, of a pair where it has been placed; negative: penetration."""
        return float(pin.computeDistance(self.world.geometry, self._scratch, pair).min_distance)

    def _place(self, q: Array) -> None:
        pin.forwardKinematics(self._model, self._data, q)
        pin.updateGeometryPlacements(self._model, self._data, self.world.geometry, self._scratch)

    def _near(self, q: Array, excursion: Array, active: Integers, floors: Array) -> int:
        self._place(q)
        return self._near_placed(excursion, active, floors)

    def _near_placed(self, excursion: Array, active: Integers, floors: Array) -> int:
        """How many of the active pairs may come within their floors; which, in `_found`, and by how much nearer, in `_travel`."""
        world = self.world
        near: int = near_in_stretch(
            self._joint_places, self._body_places, world.centres, world.radii, world.joints,
            world.mechanism.support, self._column_joints, self._axes, self._turns, excursion, world.pairs, self._shared,
            active, floors, self._balls, self._moved, self._found, self._travel,
        )  # fmt: skip
        return near

    def _by_gap(self, found: Integers, travel: Array) -> Iterator[tuple[int, float]]:
        """Positions in `found` with a bound of their distance in a stretch by their balls, m; the lowest bound first."""
        one, other = self.world.pairs[found].T
        gaps = np.linalg.norm(self._balls[one] - self._balls[other], axis=1)
        gaps -= self.world.radii[one] + self.world.radii[other] + travel
        order = np.argsort(gaps, kind="stable")
        yield from zip(order.tolist(), gaps[order].tolist(), strict=True)


def _halves(part: Array) -> list[tuple[Array, int]]:
    """Both halves of a part of a motion, and at which piece of it they begin."""
    k = len(part)
    if k > 1:
        return [(part[: k // 2], 0), (part[k // 2 :], k // 2)]
    (points,) = part
    left, right = [points[0]], [points[-1]]
    while len(points) > 1:  # de Casteljau at one half
        points = (points[:-1] + points[1:]) / 2.0
        left.append(points[0])
        right.append(points[-1])
    return [(np.array(left)[None], 0), (np.array(right[::-1])[None], 0)]


def _distance_of(one: Nearest) -> float:
    return one.distance


def _at_half(points: Array) -> Array:
    while len(points) > 1:
        points = (points[:-1] + points[1:]) / 2.0
    return points[0]


def _common(a: list[int], b: list[int]) -> int:
    same = 0
    for one, other in zip(a, b, strict=False):
        if one != other:
            break
        same += 1
    return same
