"""A clear way from one configuration to another: straight in joint space where that is clear, else by random trees.

RRT-Connect (Kuffner and LaValle 2000), shortened and with rounded corners. Every edge, shortcut and corner is certified along its
whole length (`sweep`). The seed is fixed and effort is counted in edges: the same question has the same answer, unless time
runs out. OMPL has this too, but its 2.0.1 for Python leaks each plan's checks, and seeds one generator for the whole process.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from engines.planning.collision.margins import Margins
from engines.planning.collision.sweep import Nearest, Sweep, lines
from engines.planning.collision.world import World
from engines.planning.plan import Infeasible
from engines.planning.waiting import go_on, never, quiet

Array = NDArray[np.float64]

SPACING = 0.06
"""rad (m) between the rows of a way, in the joint that moves most"""
_STEP = 0.5
"""rad that a tree grows at once"""
_MARGIN_BEYOND = 1.0
"""rad beyond start and goal that half of the samples are drawn from: ways around an object rarely lead far"""
_HALF_TURN = np.pi
"""rad beyond both that a joint without limits is looked for at most"""
_SPARE = 2e-3
"""m of clearance more than is asked for: what is done to the way afterwards (a spline through its rows) needs some"""
_CORNER = 0.35
"""of its shorter edge that a corner is rounded from, at most"""
_IDLE, _GAIN = 8, 0.03
"""shortcuts in a row that fail, or would gain less than that share of the way, before shortening ends: to certify one takes longer
than such a gain is worth"""
_TELL_EVERY = 100


@dataclass(frozen=True)
class Budget:
    """When to give up looking."""

    seconds: float = 10.0
    edges: int = 4000
    """that trees tried to grow by"""
    shortcuts: int = 60
    """that are tried on what was found"""


class Connector:
    """Ways in one world, with the memory that measuring takes. Not for several threads at once."""

    def __init__(
        self, world: World, *, margins: Margins | None = None, touching: tuple[tuple[str, str], ...] = (),
        limit_margin: float = 0.0, cancelled: Callable[[], bool] = never, sweep: Sweep | None = None,
    ):  # fmt: skip
        """What ways keep, and with what they are measured.

        :param margins: None: the defaults
        :param touching: pairs of names (wildcards) that may touch, besides those the world allows
        :param limit_margin: rad (m) from joint limits, but for the ways' ends
        :param cancelled: asked at every edge; Cancelled is raised soon after it says True
        :param sweep: of the world, if there is one already
        """
        mechanism = world.mechanism
        self.world, self.sweep = world, sweep or Sweep(world)
        self.floors = (margins or Margins()).floors(world, touching)
        """(pairs,) m that are kept"""
        self._roomy = self.floors + _SPARE
        rows = np.array([mechanism.row(joint) for joint in world.moving], np.int64)
        self._columns = mechanism.coordinate[rows]
        self._lower, self._upper = mechanism.lower[rows] + limit_margin, mechanism.upper[rows] - limit_margin
        self._limit_margin = limit_margin
        self._cancelled = cancelled

    def way(
        self, start: Array, goal: Array, *, budget: Budget | None = None, seed: int = 0,
        progress: Callable[[str], None] = quiet,
    ) -> Array:  # fmt: skip
        """(k, nq) a clear way close together, its corners rounded: straight lines between rows keep the margins for certain.

        :param start: (nq,) of the world's mechanism; joints that the world does not name as moving stay there
        :param goal: (nq,); where other joints are elsewhere than at the start, a ValueError
        :param progress: told in a few words what is being done
        :raises Infeasible: the start or the goal is out of limits or too near to something (named, with by how much), or no way was
            found within the budget (named: what the straight way meets)
        :raises Cancelled: as asked
        :raises ValueError: not a configuration, or joints that may not move
        """
        budget, mechanism = budget or Budget(), self.world.mechanism
        start, goal = mechanism.check_configuration("start", start), mechanism.check_configuration("goal", goal)
        self._refuse_others(start, goal)
        self._refuse_end("start", start)
        self._refuse_end("goal", goal)
        progress("straight way")
        meeting = self._meeting(np.array([start, goal]))
        if meeting is None:
            return _through([start, goal])
        end = time.monotonic() + budget.seconds
        generator = np.random.default_rng(seed)
        corners = self._grown(start, goal, budget, end, generator, progress)
        if corners is None:
            words = f"({meeting.between}) on the straight way is {meeting.distance:.3g} m, and no way around was found"
            raise Infeasible("clearance", self.floors[meeting.pair] - meeting.distance, "m", "free way", words)
        progress("shortening the way")
        corners = self._shortened(corners, budget.shortcuts, end, generator)
        return self._rounded(corners)

    def _refuse_others(self, start: Array, goal: Array) -> None:
        others = np.delete(np.abs(goal - start), self._columns)
        if others.max(initial=0.0) > 1e-6:
            raise ValueError(
                f"goal: got {others.max():.3g} away from the start in a joint that may not move; "
                f"expected only {', '.join(self.world.moving)} elsewhere"
            )

    def _refuse_end(self, name: str, q: Array) -> None:
        """Raises Infeasible where the way would have to begin or end out of limits or too near to something."""
        x = q[self._columns]
        out = np.maximum(self._lower - x, x - self._upper) - self._limit_margin
        worst = int(out.argmax()) if len(out) else 0
        if len(out) and out[worst] > 1e-6:
            unit = self.world.mechanism.unit_of(self.world.mechanism.row(self.world.moving[worst]))
            raise Infeasible("joint limits", float(out[worst]), unit, name, f"({self.world.moving[worst]})")
        meeting = self.sweep.meeting(q[None, None], self.floors)
        if meeting is not None:
            floor = self.floors[meeting.pair]
            words = f"({meeting.between}) is {meeting.distance:.3g} m, at least {floor:g} allowed"
            raise Infeasible("clearance", float(floor - meeting.distance), "m", name, words)

    def _meeting(self, rows: Array, *, roomy: bool = False) -> Nearest | None:
        """Where straight lines through rows come too near."""
        go_on(self._cancelled)
        meeting = self.sweep.meeting(lines(rows), self._roomy if roomy else self.floors, self._cancelled)
        go_on(self._cancelled)
        return meeting

    # --------------------------------------------------------------------------------------------------------------- trees

    def _grown(
        self, start: Array, goal: Array, budget: Budget, end: float, generator: np.random.Generator,
        progress: Callable[[str], None],
    ) -> list[Array] | None:  # fmt: skip
        """Corners of a clear way by two trees that grow towards each other."""
        columns = self._columns
        one, other = _Tree(start), _Tree(goal)
        least, most = np.minimum(start, goal)[columns], np.maximum(start, goal)[columns]
        lower = np.where(np.isfinite(self._lower), self._lower, least - _HALF_TURN)
        upper = np.where(np.isfinite(self._upper), self._upper, most + _HALF_TURN)
        low, high = np.clip(least - _MARGIN_BEYOND, lower, upper), np.clip(most + _MARGIN_BEYOND, lower, upper)
        tried = 0
        while tried < budget.edges and time.monotonic() < end:
            if tried // _TELL_EVERY != (tried - 1) // _TELL_EVERY:
                progress(f"way around: {tried} of {budget.edges} edges tried")
            target = start.copy()
            near = generator.random() < 0.5
            target[columns] = generator.uniform(low if near else lower, high if near else upper)
            tried += 1
            grown = self._extended(one, target)
            if grown is not None:
                target = one.nodes[grown]
                while tried < budget.edges:
                    tried += 1
                    reached = self._extended(other, target)
                    if reached is None:
                        break
                    if other.nodes[reached] is target:
                        way = [*reversed(one.to_root(grown)), *other.to_root(reached)[1:]]
                        return way if way[0] is start else way[::-1]
            one, other = other, one
        return None

    def _extended(self, tree: _Tree, target: Array) -> int | None:
        """The number of a new node one step towards the target, None when the way there is not clear."""
        near = tree.nearest(target)
        way = target - tree.nodes[near]
        length = float(np.linalg.norm(way))
        new = target if length <= _STEP else tree.nodes[near] + way * (_STEP / length)
        # The ends of the way need not have room to spare: whatever leaves them has to do with what is asked for.
        if self._meeting(np.array([tree.nodes[near], new]), roomy=near != 0) is not None:
            return None
        return tree.add(new, near)

    # ----------------------------------------------------------------------------------------------------------- finishing

    def _shortened(self, corners: list[Array], most: int, end: float, generator: np.random.Generator) -> list[Array]:
        """Without the detours that straight lines between two places of the way replace: first between corners, then anywhere."""
        corners, idle = self._skipped(corners), 0
        for _ in range(most):
            if len(corners) < 3 or idle > _IDLE or time.monotonic() > end:
                break
            idle += 1
            lengths = [float(np.linalg.norm(b - a)) for a, b in pairwise(corners)]
            along = np.concatenate([[0.0], np.cumsum(lengths)])
            first, last = sorted(generator.uniform(0.0, along[-1], 2))
            i, j = (int(np.searchsorted(along, s, side="right")) - 1 for s in (first, last))
            i, j = min(i, len(lengths) - 1), min(j, len(lengths) - 1)
            if i == j:
                continue
            a, b = (
                corners[k] + (s - along[k]) / lengths[k] * (corners[k + 1] - corners[k])
                for k, s in ((i, first), (j, last))
            )
            gain = 1.0 - (float(np.linalg.norm(b - a)) + along[-1] - (last - first)) / along[-1]
            if gain > _GAIN and self._meeting(np.array([a, b]), roomy=True) is None:
                idle = 0
                corners = [*corners[: i + 1], a, b, *corners[j + 1 :]]
        return _straightened(corners)

    def _skipped(self, corners: list[Array]) -> list[Array]:
        """From each corner on to the furthest that is found in a straight line, of those after it by halves."""
        kept, here, last = [corners[0]], 0, len(corners) - 1
        while here < last:
            there = last
            while there > here + 1 and self._meeting(np.array([corners[here], corners[there]]), roomy=True) is not None:
                there = here + 1 + (there - here - 1) // 2
            kept.append(corners[there])
            here = there
        return kept

    def _rounded(self, corners: list[Array]) -> Array:
        """The way with each corner replaced by a parabola that is clear, as wide as may be."""
        rows = [corners[0][None]]
        for before, corner, after in zip(corners, corners[1:], corners[2:], strict=False):
            share = _CORNER
            while share > 0.02:
                bend = np.array([corner + share * (before - corner), corner, corner + share * (after - corner)])
                s = np.linspace(0.0, 1.0, _count(bend[0], bend[2], SPACING / 2.0))[:, None]
                curve = (1 - s) ** 2 * bend[0] + 2 * s * (1 - s) * bend[1] + s**2 * bend[2]
                if self._meeting(curve, roomy=True) is None:
                    rows.append(curve)
                    break
                share /= 2.0
            else:
                rows.append(corner[None])
        rows.append(corners[-1][None])
        return _through(list(np.vstack(rows)))


class _Tree:
    def __init__(self, root: Array):
        self.nodes, self.parents = [root], [-1]
        self._rows = np.empty((64, len(root)))
        self._rows[0] = root

    def nearest(self, target: Array) -> int:
        away = self._rows[: len(self.nodes)] - target
        return int(np.einsum("ij,ij->i", away, away).argmin())

    def add(self, node: Array, parent: int) -> int:
        count = len(self.nodes)
        if count == len(self._rows):
            self._rows = np.vstack([self._rows, np.empty_like(self._rows)])
        self._rows[count] = node
        self.nodes.append(node)
        self.parents.append(parent)
        return count

    def to_root(self, node: int) -> list[Array]:
        way = []
        while node >= 0:
            way.append(self.nodes[node])
            node = self.parents[node]
        return way


def _straightened(corners: list[Array]) -> list[Array]:
    """Without corners that lie on the line through their neighbours, or on them."""
    kept = corners[:1]
    for corner, after in pairwise([*corners[1:], corners[-1]]):
        if corner is after:
            break
        one, other = corner - kept[-1], after - corner
        lengths = np.linalg.norm(one) * np.linalg.norm(other)
        if np.linalg.norm(one) > 1e-9 and not (lengths > 0.0 and one @ other > (1.0 - 1e-12) * lengths):
            kept.append(corner)
    return [*kept, corners[-1]]


def _count(a: Array, b: Array, spacing: float) -> int:
    return max(2, int(np.ceil(np.abs(b - a).max() / spacing)) + 1)


def _through(corners: list[Array]) -> Array:
    """Straight lines through corners, rows close together."""
    pieces = [a + np.linspace(0.0, 1.0, _count(a, b, SPACING))[1:, None] * (b - a) for a, b in pairwise(corners)]
    return np.vstack([corners[0][None], *pieces])
