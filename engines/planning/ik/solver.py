"""Inverse kinematics for one configuration: constraints in, the checked configuration nearest to a nominal one out.

minimise ½ Σ weight · (q ⊖ nominal)², subject to all constraints and the joints' limits (Fallon et al. 2015, §4.1): from the start
that is given (else the nominal configuration) first, then from others around it. The same question has the same answer; `seed`
draws other starts.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from engines.planning.collision.world import World
from engines.planning.ik import constraints as kinds
from engines.planning.ik.checker import Checker
from engines.planning.ik.constraints import Constraint
from engines.planning.ik.goals import goals_inside
from engines.planning.ik.mechanism import Mechanism
from engines.planning.ik.nearness import Bodies, Nearness
from engines.planning.ik.posture import PostureProblem
from engines.planning.ik.relaxation import granted, stages
from engines.planning.ik.report import Answer
from engines.planning.ik.rows import Rows, Workspace
from engines.planning.ik.softened import SoftenedProblem
from engines.planning.ik.sqp import Ending, Problem, Settings, descend
from engines.planning.ik.table import Table, table_of

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

_BASE_WEIGHT = 0.1
"""a free base moves that much more willingly than a joint"""
_SPREAD = np.array([0.25, 0.5, 0.75, 1.0])
"""of the joints' ranges, that starts after the first are drawn from"""


class Solver:
    """For one mechanism; keeps its scratch memory between questions. One question at a time."""

    def __init__(self, mechanism: Mechanism, settings: Settings | None = None):
        self.mechanism = mechanism
        self._settings = settings or Settings()
        self._workspace = Workspace(mechanism)
        self.checker = Checker(mechanism)
        self._bodies: WeakKeyDictionary[World, dict[tuple[str, ...], Bodies]] = WeakKeyDictionary()

    def solve(
        self, constraints: Sequence[Constraint], nominal: Array, *, start: Array | None = None,
        moving: Sequence[str] | None = None, base_moves: bool = True, weights: Mapping[str, float] | None = None,
        starts: int = 5, seed: int = 0, relax: bool = False,
    ) -> Answer:  # fmt: skip
        """The configuration nearest to `nominal` (nq,) that keeps all constraints; if none was found, the one that misses least.

        :param start: (nq,), where to begin; None: at `nominal`
        :param moving: joints that may move; None: all. The others stay where `start` has them
        :param base_moves: whether a free base may
        :param weights: joint → factor of its squared distance to nominal; 1 where left out
        :param starts: configurations to begin from until one leads to an answer
        :param seed: of the starts after the first
        :param relax: whether constraints with a priority above 0 give way when there is no answer: the largest number first, as
            little as possible; `Answer.given` says how much each gave
        :raises ValueError: a question that can't be meant, naming constraint, field, value and what was expected
        """
        mechanism = self.mechanism
        nominal = mechanism.within_limits(mechanism.check_configuration("nominal", nominal))
        if start is not None:
            start = mechanism.within_limits(mechanism.check_configuration("start", start))
        if starts < 1:
            raise ValueError(f"starts: got {starts}; expected 1 or more")
        columns = self.columns(moving, base_moves)
        cost = self.cost(weights)
        first = nominal if start is None else start
        table = table_of(mechanism, constraints, first)
        problem = self._problem(table, nominal, cost, columns)
        first = self._within(first, table, columns)
        best, answer = self._search(problem, constraints, table, columns, first, starts, seed)
        if answer.feasible:
            return answer
        if relax:
            answer = self._relax(constraints, best, answer, nominal, cost, columns)
        if answer.feasible:
            return answer
        return replace(answer, violations=(*goals_inside(constraints), *answer.violations))

    def forget(self, scene: World) -> None:
        """As if nothing had been asked about a scene yet."""
        for links, bodies in list(self._bodies.get(scene, {}).items()):
            if links:
                del self._bodies[scene][links]
            else:
                scene.forget(bodies.scratch)

    def _problem(
        self, table: Table, nominal: Array, cost: Array, columns: Integers, soft: Collection[int] = ()
    ) -> Problem:
        """`soft`: numbers of the constraints that give way."""
        rows = self.rows(table, columns, soft)
        problem = PostureProblem(self._workspace, rows, table, nominal, cost, columns)
        return SoftenedProblem(problem, rows) if soft else problem

    def rows(self, table: Table, columns: Integers, soft: Collection[int] = ()) -> Rows:
        """The rows of a table; they know which are of `soft` constraints."""
        near = [self._nearness(c, gives=number in soft) for number, c in table.bodies]
        return Rows(self._workspace, table, near, columns, soft)

    def _search(
        self, problem: Problem, constraints: Sequence[Constraint], table: Table, columns: Integers, first: Array,
        starts: int, seed: int,
    ) -> tuple[Ending, Answer]:  # fmt: skip
        iterations, best, answer = 0, None, None
        for number, begin in enumerate(self._starts(first, table, columns, starts, seed), 1):
            ending = descend(problem, begin, self._settings)
            iterations += ending.iterations
            if ending.kept or best is None or ending.violation < best.violation:
                q = self._within(ending.point, table, columns)  # a step to a limit ends a rounding error beyond it
                violations = self.checker.violations(constraints, q)
                answer = Answer(q, ending.cost, violations, (), iterations, number)
                best = ending
                if not violations:
                    return best, answer
        assert best is not None and answer is not None
        return best, replace(answer, iterations=iterations, starts=starts)

    def _relax(
        self,
        constraints: Sequence[Constraint],
        best: Ending,
        answer: Answer,
        nominal: Array,
        cost: Array,
        columns: Integers,
    ) -> Answer:
        """Ever more priorities made soft, from where the search ended; then what they gave is granted, and the cost made least."""
        iterations = answer.iterations
        for soft in stages(constraints):
            table = table_of(self.mechanism, constraints, best.point)
            patient = replace(self._settings, patience=12)
            ending = descend(self._problem(table, nominal, cost, columns, soft), best.point, patient)
            reached = self._within(ending.point, table, columns)
            loosened = granted(constraints, soft, lambda c, q=reached: self.checker.measures([c], q))  # type: ignore[misc]
            table = table_of(self.mechanism, loosened, reached)
            final = descend(self._problem(table, nominal, cost, columns), reached, self._settings)
            iterations += ending.iterations + final.iterations
            q = self._within(final.point, table, columns)
            violations = self.checker.violations([c for n, c in enumerate(constraints) if n not in soft], q)
            if not violations:
                given = self.checker.violations([constraints[number] for number in sorted(soft)], q)
                return Answer(q, final.cost, (), given, iterations, answer.starts, tuple(loosened))
        return replace(answer, iterations=iterations)

    def _starts(self, first: Array, table: Table, columns: Integers, starts: int, seed: int) -> Iterator[Array]:
        """The first, then others drawn about it, further and further away. Only what moves differs."""
        yield first
        mechanism = self.mechanism
        generator = np.random.default_rng(seed)
        moved = np.array([c for c in columns if c >= mechanism.base], np.int64)
        low, high = np.maximum(table.low, -np.pi)[moved], np.minimum(table.high, np.pi)[moved]
        for number in range(starts - 1):
            step = np.zeros(mechanism.nv)
            drawn = generator.uniform(low, high)
            have = mechanism.coordinate[moved] >= 0
            step[moved[have]] = _SPREAD[number % len(_SPREAD)] * (
                drawn[have] - first[mechanism.coordinate[moved[have]]]
            )
            yield pin.integrate(mechanism.model, first, step)

    def _within(self, q: Array, table: Table, columns: Integers) -> Array:
        """q with the joints that move within their limits, margins included."""
        mechanism, q = self.mechanism, q.copy()
        moved = columns[mechanism.coordinate[columns] >= 0]
        rows = mechanism.coordinate[moved]
        q[rows] = np.minimum(np.maximum(q[rows], table.low[moved]), table.high[moved])
        return q

    def columns(self, moving: Sequence[str] | None, base_moves: bool) -> Integers:
        """The velocities that move. Raises ValueError when none does."""
        mechanism = self.mechanism
        base = list(range(mechanism.base)) if base_moves else []
        if moving is None:
            rows = base + list(range(mechanism.base, mechanism.nv))
        else:
            rows = base + [mechanism.named("moving", joint) for joint in moving]
        if not rows:
            raise ValueError(f"moving: got {moving}; expected a joint, or a base, that moves")
        return np.array(rows, np.int64)

    def cost(self, weights: Mapping[str, float] | None) -> Array:
        """(nv,) weights of squared distances. Raises ValueError."""
        cost = self.mechanism.weights(weights)
        cost[: self.mechanism.base] = _BASE_WEIGHT
        return cost

    def _nearness(self, constraint: kinds.Clearance | kinds.BodyDistance, *, gives: bool) -> Nearness:
        """Of a scene that was asked about before it is kept: making one copies its geometry."""
        links = () if isinstance(constraint, kinds.Clearance) else (constraint.link, constraint.other)
        kept = self._bodies.setdefault(constraint.scene, {})
        if links not in kept:
            kept[links] = Bodies(self.mechanism, self._workspace.data, constraint.scene, *links)
        return kept[links].within(constraint, gives=gives)
