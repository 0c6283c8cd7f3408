"""A way on which a frame goes with an object's joint: each posture the nearest to the one before, or random trees of them.

Where following greedily comes to an end (an arm at its limits, a body in the way, feet that would lift), the rest of the body may
be led elsewhere earlier on: a tree over pairs of (how far along, posture), each step of it brought to the goals of the next place
(Oriolo and Mongillo 2005, Motion Planning for Mobile Manipulators along Given End-effector Paths), each edge certified clear. What
is found is smoothed. The seed is fixed and effort is counted in steps: the same question has the same answer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from engines.planning import constraints
from engines.planning.collision.sweep import Sweep, lines
from engines.planning.ik.constraints import Constraint
from engines.planning.ik.solver import Solver
from engines.planning.plan import Infeasible
from engines.planning.waiting import go_on

Array = NDArray[np.float64]
Goals = Sequence[Constraint]

_BRANCHES = 60
"""of the tree, each led towards a random posture, then followed as far as it leads"""
_DEEPEST = 0.5
"""share of branches that begin in the furthest tenth; the others anywhere"""
_LED, _AWAY, _BEYOND = 10, 0.3, 1.5
"""steps that are led at most, rad (m) of one; what they are led to is drawn within so much about the posture"""
_PASSES = 8
"""of smoothing, at most"""
_TELL_EVERY = 5


class AlongWays:
    """Ways in one world that keep `held` beside the goals. Not for several threads at once."""

    def __init__(
        self, solver: Solver, sweep: Sweep, floors: Array, held: Goals, label: str, *,
        cancelled: Callable[[], bool], progress: Callable[[str], None],
    ):  # fmt: skip
        """`floors` (pairs,) m of clearance; `label`: what is gone along, for errors; `cancelled`, `progress` as of a planner."""
        self._solver, self._sweep, self._floors, self._held = solver, sweep, floors, list(held)
        self._label, self._cancelled, self._progress = label, cancelled, progress
        self._moving = sweep.world.moving
        mechanism = solver.mechanism
        rows = [mechanism.row(joint) for joint in self._moving]
        self._columns = mechanism.coordinate[rows]
        self._lower, self._upper = mechanism.lower[rows], mechanism.upper[rows]

    def way(self, start: Array, places: Sequence[tuple[float, Goals]]) -> list[Array]:
        """(nq,) each, from `start` through all places, (share of the way, goals) close together.

        :raises Infeasible: none was found; says how far the first try came, and what it missed there
        :raises Cancelled: as asked
        """
        self._progress(f"way along {self._label}")
        nodes: list[tuple[int, int, Array]] = [(0, -1, start)]
        last, missed = self._greedy(nodes, 0, places)
        generator, tried = np.random.default_rng(0), 0
        while missed is not None and tried < _BRANCHES:
            if tried % _TELL_EVERY == 0:
                self._progress(f"other ways along {self._label}: {tried} of {_BRANCHES} branches tried")
            tried += 1
            branch = self._branch(nodes, self._drawn(nodes, len(places), generator), places, generator)
            last, ended = self._greedy(nodes, branch, places)
            if ended is None:
                return self._smoothed(_to_root(nodes, last), places)
        if missed is not None:
            raise missed
        return _to_root(nodes, last)

    def _branch(
        self, nodes: list[tuple[int, int, Array]], at: int, places: Sequence[tuple[float, Goals]],
        generator: np.random.Generator,
    ) -> int:  # fmt: skip
        """Nodes after one of them that are led towards a random posture, as far as that leads; the last one's number."""
        towards = self._random(nodes[at][2], generator)
        for _ in range(int(generator.integers(1, _LED + 1))):
            step, _, q = nodes[at]
            if step == len(places):
                break
            away = towards - q
            nominal = q + away * min(1.0, _AWAY / max(float(np.abs(away).max()), 1e-9))
            share, goals = places[step]
            try:
                there = self._next(q, goals, share, nominal)
            except Infeasible:
                break
            nodes.append((step + 1, at, there))
            at = len(nodes) - 1
        return at

    def _greedy(
        self, nodes: list[tuple[int, int, Array]], at: int, places: Sequence[tuple[float, Goals]]
    ) -> tuple[int, Infeasible | None]:
        """Nodes after one of them, each the nearest posture; the last one's number, and what ended it before the end."""
        while nodes[at][0] < len(places):
            step, _, q = nodes[at]
            share, goals = places[step]
            try:
                there = self._next(q, goals, share, q)
            except Infeasible as problem:
                return at, problem
            nodes.append((step + 1, at, there))
            at = len(nodes) - 1
        return at, None

    def _next(self, q: Array, goals: Goals, share: float, nominal: Array) -> Array:
        """A posture at the next goals near `nominal`, a clear step from q (nq,). Raises Infeasible, Cancelled."""
        go_on(self._cancelled)
        where, step = f"{100 * share:.0f} % of the way along {self._label}", constraints.JOINT_STEP
        wanted = [*goals, *self._held]
        there = self._solver.solve(wanted, nominal, start=q, moving=self._moving, starts=1).require(where).q
        jump = float(np.abs(there - q).max())
        if jump > step.bound:
            raise Infeasible(step.name, jump - step.bound, step.unit, where, f"is {jump:.3g} {step.unit}")
        met = self._sweep.meeting(lines(np.array([q, there])), self._floors, self._cancelled)
        go_on(self._cancelled)
        if met is not None:
            floor = float(self._floors[met.pair])
            words = f"({met.between}) is {met.distance:.3g} m, at least {floor:g} allowed"
            raise Infeasible("clearance", max(floor - met.distance, 0.0), "m", where, words)
        return there

    def _drawn(self, nodes: Sequence[tuple[int, int, Array]], count: int, generator: np.random.Generator) -> int:
        """The number of a node to branch from, which is not at the end."""
        furthest = max(step for step, _, _ in nodes)
        least = 0.9 * furthest if generator.uniform() < _DEEPEST else 0.0
        among = [number for number, (step, _, _) in enumerate(nodes) if least <= step < count]
        return int(generator.choice(among))

    def _random(self, q: Array, generator: np.random.Generator) -> Array:
        """A posture about q (nq,)."""
        low = np.maximum(q[self._columns] - _BEYOND, self._lower)
        high = np.minimum(q[self._columns] + _BEYOND, self._upper)
        there = q.copy()
        there[self._columns] = generator.uniform(low, high)
        return there

    def _smoothed(self, rows: list[Array], places: Sequence[tuple[float, Goals]]) -> list[Array]:
        """Each pass as long as all stays clear and held: a random tree's corners go."""
        best = rows
        for _ in range(_PASSES):
            smooth = list(best)
            try:
                for k in range(1, len(best) - 1):
                    middle = 0.25 * smooth[k - 1] + 0.5 * best[k] + 0.25 * best[k + 1]
                    share, goals = places[k - 1]
                    smooth[k] = self._next(smooth[k - 1], goals, share, middle)
                smooth[-1] = self._next(smooth[-2], places[-1][1], 1.0, smooth[-1])
            except Infeasible:
                break
            best = smooth
        return best


def _to_root(nodes: Sequence[tuple[int, int, Array]], at: int) -> list[Array]:
    found = []
    while at >= 0:
        _, parent, q = nodes[at]
        found.append(q)
        at = parent
    return found[::-1]
