"""A clear way on which constraints hold all along: straight where that leads there, else by random trees on what they leave free.

CBiRRT (Berenson, Srinivasa and Kuffner 2011, Task Space Regions): RRT-Connect whose every step is brought back to the
constraints, here by the inverse kinematics engine, its edges certified clear (`collision/sweep.py`). What is found is
shortened, then smoothed, in the same way. The seed is fixed and effort is counted in steps: the same question has the same
answer, unless time runs out.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from engines.planning.collision.connect import Budget
from engines.planning.collision.sweep import Sweep, lines
from engines.planning.ik.constraints import Constraint
from engines.planning.ik.mechanism import Mechanism
from engines.planning.ik.solver import Solver
from engines.planning.plan import Infeasible
from engines.planning.waiting import go_on, never, quiet

Array = NDArray[np.float64]

_STEP = 0.1
"""rad (m) of a step in the joint that moves most"""
_GAIN = 0.3
"""of a step that it must bring nearer to where it leads: what is given back to the constraints is lost"""
_BEYOND = 0.8
"""rad (m) beyond start and goal that samples are drawn from"""
_STRIDE = 12
"""steps that a tree grows at once"""
_SPARE, _NEAR_END = 2e-3, 0.3
"""m of clearance more than is asked for, as smoothing and a spline through the rows need some; but not so near an end, rad (m)"""
_PASSES = 6
"""of smoothing, at most"""
_ROWS = 41
"""of a way"""
_TELL_EVERY = 20


class HeldConnector:
    """Ways in one world that keep `held`. Not for several threads at once."""

    def __init__(
        self, solver: Solver, sweep: Sweep, floors: Array, held: Sequence[Constraint], *,
        cancelled: Callable[[], bool] = never,
    ):  # fmt: skip
        """`floors` (pairs,) m of clearance; `held` along the whole way.

        :param cancelled: asked at every step; Cancelled is raised soon after it says True
        """
        self._solver, self._sweep, self._floors, self._held = solver, sweep, floors, list(held)
        self._cancelled = cancelled
        self._moving = sweep.world.moving
        mechanism: Mechanism = solver.mechanism
        rows = np.array([mechanism.row(joint) for joint in self._moving], np.int64)
        self._columns = mechanism.coordinate[rows]
        self._lower, self._upper = mechanism.lower[rows], mechanism.upper[rows]
        self._ends: tuple[Array, ...] = ()

    def way(
        self, start: Array, goal: Array, *, budget: Budget | None = None, seed: int = 0,
        progress: Callable[[str], None] = quiet,
    ) -> Array:  # fmt: skip
        """(k, nq) from `start` to `goal` (nq,), which keep what is held.

        :raises Infeasible: no way was found within the budget
        :raises Cancelled: as asked
        """
        budget, self._ends = budget or Budget(), (start, goal)
        end = time.monotonic() + budget.seconds
        generator = np.random.default_rng(seed)
        progress("straight way that keeps what is held")
        found = self._grown(start, goal, budget, end, generator, progress)
        if found is None:
            nearest = self._straight_meets(start, goal)
            raise Infeasible(
                "clearance", nearest[0], "m", "free way", f"{nearest[1]}no way around was found that keeps the rest"
            )
        progress("shortening and smoothing the way")
        found = self._shortened(found, budget.shortcuts, end, generator)
        return self._smoothed(found)

    def _straight_meets(self, start: Array, goal: Array) -> tuple[float, str]:
        met = self._sweep.meeting(lines(np.array([start, goal])), self._floors, self._cancelled)
        if met is None:
            return 0.0, ""
        return float(
            self._floors[met.pair] - met.distance
        ), f"({met.between}) on the straight way is {met.distance:.3g} m, and "

    def _held_at(self, q: Array) -> Array | None:
        """What keeps all that is held, near q (nq,)."""
        answer = self._solver.solve(self._held, q, start=q, moving=self._moving, starts=1)
        return answer.q if answer.feasible else None

    def _clear(self, rows: Array) -> bool:
        go_on(self._cancelled)
        near = any(np.abs(rows - end).max(axis=1).min() < _NEAR_END for end in self._ends)
        met = self._sweep.meeting(lines(rows), self._floors if near else self._floors + _SPARE, self._cancelled)
        go_on(self._cancelled)
        return met is None

    def _towards(self, here: Array, target: Array, most: int) -> tuple[list[Array], bool]:
        """Configurations after `here` by steps towards another that keeps what is held; whether it was reached."""
        rows: list[Array] = []
        for _ in range(most):
            away = target - here
            left = float(np.abs(away).max())
            if left <= _STEP:
                if not self._clear(np.array([here, target])):
                    return rows, False
                return [*rows, target], True
            there = self._held_at(here + away * (_STEP / left))
            if there is None or np.abs(there - here).max() > 2.0 * _STEP:
                return rows, False
            gain = float(np.linalg.norm(away) - np.linalg.norm(target - there))
            if gain < _GAIN * float(np.linalg.norm(away)) * _STEP / left or not self._clear(np.array([here, there])):
                return rows, False
            rows.append(there)
            here = there
        return rows, False

    def _grown(
        self, start: Array, goal: Array, budget: Budget, end: float, generator: np.random.Generator,
        progress: Callable[[str], None],
    ) -> list[Array] | None:  # fmt: skip
        """Rows from start to goal by two trees that grow towards each other."""
        rows, reached = self._towards(start, goal, 10 * _STRIDE)
        if reached:
            return [start, *rows]
        columns = self._columns
        low = np.maximum(np.minimum(start, goal)[columns] - _BEYOND, self._lower)
        high = np.minimum(np.maximum(start, goal)[columns] + _BEYOND, self._upper)
        one, other = ([start], [-1]), ([goal], [-1])
        _grow(one, 0, rows)
        tried = 0
        while tried < budget.edges and time.monotonic() < end:
            if tried % _TELL_EVERY == 0:
                progress(f"way around that keeps what is held: {tried} of {budget.edges} edges tried")
            go_on(self._cancelled)
            tried += 1
            drawn = start.copy()
            drawn[columns] = generator.uniform(low, high)
            target = self._held_at(drawn)
            if target is not None:
                near = _nearest(one, target)
                last = _grow(one, near, self._towards(one[0][near], target, _STRIDE)[0])
                meant = one[0][last]
                near = _nearest(other, meant)
                rows, reached = self._towards(other[0][near], meant, 10 * _STRIDE)
                there = _grow(other, near, rows)
                if reached:
                    way = [*reversed(_to_root(one, last)), *_to_root(other, there)[1:]]
                    return way if way[0] is start else way[::-1]
            one, other = other, one
        return None

    def _shortened(self, rows: list[Array], most: int, end: float, generator: np.random.Generator) -> list[Array]:
        for _ in range(most):
            if len(rows) < 4 or time.monotonic() > end:
                break
            first, last = sorted(generator.choice(len(rows), 2, replace=False).tolist())
            if last - first < 2:
                continue
            between, reached = self._towards(rows[first], rows[last], 10 * _STRIDE)
            if reached and _length([rows[first], *between]) < 0.98 * _length(rows[first : last + 1]):
                rows = [*rows[: first + 1], *between, *rows[last + 1 :]]
        return rows

    def _smoothed(self, rows: list[Array]) -> Array:
        """Rows evenly apart, each pass as long as all stays clear and held: corners go."""
        along = np.concatenate([[0.0], np.cumsum([np.linalg.norm(b - a) for a, b in pairwise(rows)])])
        even = np.linspace(0.0, along[-1], max(_ROWS, len(rows)))
        q = np.array(rows)
        best = np.column_stack([np.interp(even, along, column) for column in q.T])
        best[0], best[-1] = rows[0], rows[-1]
        for _ in range(_PASSES):
            smooth = best.copy()
            for k in range(1, len(best) - 1):
                go_on(self._cancelled)
                there = self._held_at(0.25 * smooth[k - 1] + 0.5 * best[k] + 0.25 * best[k + 1])
                if there is None:
                    return best
                smooth[k] = there
            if not all(self._clear(smooth[k : k + 2]) for k in range(len(smooth) - 1)):
                break
            best = smooth
        return best


_Tree = tuple[list[Array], list[int]]
"""nodes, and the number of each one's parent"""


def _nearest(tree: _Tree, target: Array) -> int:
    return int(np.linalg.norm(np.array(tree[0]) - target, axis=1).argmin())


def _grow(tree: _Tree, parent: int, rows: Sequence[Array]) -> int:
    """The number of the last of new nodes, each after the one before."""
    for row in rows:
        tree[0].append(row)
        tree[1].append(parent)
        parent = len(tree[0]) - 1
    return parent


def _to_root(tree: _Tree, node: int) -> list[Array]:
    found = []
    while node >= 0:
        found.append(tree[0][node])
        node = tree[1][node]
    return found


def _length(rows: Sequence[Array]) -> float:
    return sum(float(np.linalg.norm(b - a)) for a, b in pairwise(rows))
