"""Inverse kinematics in time: a smooth trajectory through knots that keeps constraints in their windows.

minimise Σ over knots of |q ⊖ nominal|² + velocity · |q̇|² + acceleration · |q̈|², each weighted as in `Solver.solve`, over the knots
of a cubic spline that begins and ends at rest (Fallon et al. 2015, §4.1). Constraints are rows at the knots within their windows,
whose ends become knots; what they miss between knots is measured by the checker at ten times the knots' density, and a knot is
added where that is too much.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from engines.planning.ik import kernels
from engines.planning.ik.checker import ANGLE, LENGTH
from engines.planning.ik.constraints import Constraint
from engines.planning.ik.mechanism import Mechanism
from engines.planning.ik.report import Measure
from engines.planning.ik.rows import Rows
from engines.planning.ik.solver import Solver
from engines.planning.ik.spline import Spline
from engines.planning.ik.sqp import INEQUALITY, Program, Settings, descend
from engines.planning.ik.table import Table, table_of
from engines.planning.plan import Infeasible
from engines.planning.waiting import go_on, never

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

DENSITY = 10
"""samples of the checker for each stretch between knots"""
_NO_BASE = np.zeros((0, 0))


@dataclass(frozen=True)
class Missed:
    """A figure that is out of bounds at a time."""

    time: float
    """s"""
    measure: Measure


@dataclass(frozen=True)
class Trajectory:
    """A spline of configurations, checked: feasible when nothing is violated."""

    mechanism: Mechanism
    times: Array
    """(k,) s of the knots"""
    knots: Array
    """(k, nv): tangent vectors from `reference` to each knot's configuration"""
    reference: Array
    """(nq,)"""
    cost: float
    violations: tuple[Missed, ...]
    """of each constraint's figure the time when it is worst; the worst first"""
    iterations: int
    starts: int

    @property
    def feasible(self) -> bool:
        """All constraints are kept in their windows, to what was tolerated between knots."""
        return not self.violations

    def at(self, when: Array) -> Array:
        """(n, nq) configurations at times (n,) s; at the ends before and after."""
        away = Spline(self.times).at(np.atleast_1d(when)) @ self.knots
        return np.array([pin.integrate(self.mechanism.model, self.reference, row) for row in away])

    def velocities(self, when: Array) -> Array:
        """(n, m) rad/s of the mechanism's joints at times (n,) s."""
        return (Spline(self.times).at(np.atleast_1d(when), 1) @ self.knots)[:, self.mechanism.v_rows]

    def require(self, where: str = "") -> Trajectory:
        """Itself. Raises Infeasible with the worst violation and its time when it is not feasible."""
        if self.violations:
            worst = self.violations[0]
            m = worst.measure
            words = f"({m.what}) is {m.value:.3g} {m.unit} at {worst.time:.3g} s"
            raise Infeasible(m.constraint, m.by, m.unit, where, words)
        return self


class TrajectorySolver:
    """For the mechanism of a solver, with its memory. One question at a time."""

    def __init__(self, solver: Solver, settings: Settings | None = None):
        self._solver, self.mechanism = solver, solver.mechanism
        self._settings = settings or Settings(iterations=60)

    def solve(
        self, constraints: Sequence[Constraint], start: Array, times: Sequence[float], *, nominal: Array | None = None,
        moving: Sequence[str] | None = None, base_moves: bool = True, weights: Mapping[str, float] | None = None,
        velocity: float = 0.05, acceleration: float = 0.01, between: float = 20.0, most_knots: int = 20, starts: int = 3,
        seed: int = 0, cancelled: Callable[[], bool] = never,
    ) -> Trajectory:  # fmt: skip
        """The smoothest way from `start` (nq,) that keeps all constraints; if none was found, the one that misses least.

        :param times: s of the knots, the first when the robot is at `start`
        :param nominal: (nq,), which knots are drawn to; None: `start`
        :param velocity: s², weight of squared velocities against squared distances
        :param acceleration: s⁴, of accelerations
        :param between: what may be missed between knots, as a multiple of what is tolerated at them (0.1 mm, 1 mrad)
        :param most_knots: knots are added between others up to so many, where more than that is missed
        :param starts: ways to begin from until one leads to an answer: standing still, then by configurations for the last knot
        :param cancelled: asked often; Cancelled is raised soon after it says True
        :raises ValueError: a question that can't be meant
        :raises Cancelled: as asked
        """
        mechanism, solver = self.mechanism, self._solver
        start = mechanism.within_limits(mechanism.check_configuration("start", start))
        nominal = start if nominal is None else mechanism.check_configuration("nominal", nominal)
        knots = np.asarray(times, dtype=float)
        if knots.ndim != 1 or len(knots) < 2 or not np.isfinite(knots).all() or not (np.diff(knots) > 0.0).all():
            raise ValueError(f"times: got {list(times)}; expected two or more finite times, each after the one before")
        for name, value in {"velocity": velocity, "acceleration": acceleration}.items():
            if not 0.0 <= value < np.inf:
                raise ValueError(f"{name}: got {value}; expected a finite number, 0 or more")
        knots = _with_windows(knots, constraints)
        columns, cost = solver.columns(moving, base_moves), solver.cost(weights)
        weighting = (velocity, acceleration)
        best: Trajectory | None = None
        iterations = 0
        for number in range(starts):
            refined, begin = knots, self._begin(constraints, start, knots, number, seed, moving, base_moves)
            while True:
                go_on(cancelled)
                problem = TrajectoryProblem(solver, constraints, start, refined, nominal, cost, columns, weighting)
                ending = descend(problem, begin, self._settings)
                iterations += ending.iterations
                found = Trajectory(
                    mechanism, refined, problem.away(ending.point), start, ending.cost, (), iterations, number + 1
                )
                found = replace(found, violations=self._check(found, constraints, between))
                if best is None or _missing(found) < _missing(best):
                    best = found
                if not found.violations:
                    return found
                if not ending.kept or len(refined) >= most_knots:
                    break
                worst = int(
                    np.clip(np.searchsorted(refined, found.violations[0].time, "right") - 1, 0, len(refined) - 2)
                )
                finer = np.insert(refined, worst + 1, (refined[worst] + refined[worst + 1]) / 2)
                begin = (Spline(refined).at(finer) @ found.knots)[1:][:, columns].ravel()
                refined = finer
        assert best is not None
        return replace(best, iterations=iterations, starts=starts)

    def _begin(
        self, constraints: Sequence[Constraint], start: Array, times: Array, number: int, seed: int,
        moving: Sequence[str] | None, base_moves: bool,
    ) -> Array:  # fmt: skip
        """Knots after the first, flat: standing still; then evenly to a configuration that keeps what holds at the end."""
        columns = self._solver.columns(moving, base_moves)
        if number == 0:
            return np.zeros((len(times) - 1) * len(columns))
        last = [c for c in constraints if c.window[0] <= times[-1] <= c.window[1]]
        end = self._solver.solve(
            last, start, moving=moving, base_moves=base_moves, starts=2 + number, seed=seed + number
        ).q
        away = pin.difference(self.mechanism.model, start, end)[columns]
        share = (times[1:] - times[0]) / (times[-1] - times[0])
        return np.outer(share, away).ravel()

    def _check(self, found: Trajectory, constraints: Sequence[Constraint], between: float) -> tuple[Missed, ...]:
        """What is missed, measured by the checker at the knots and ten times as often."""
        inside = [np.linspace(a, b, DENSITY + 1)[1:] for a, b in zip(found.times[:-1], found.times[1:], strict=True)]
        when = np.unique(np.concatenate([found.times[:1], *inside]))
        knots = set(found.times.tolist())
        worst: dict[tuple[str, str], Missed] = {}
        for time, q in zip(when.tolist(), found.at(when), strict=True):
            active = [c for c in constraints if c.window[0] <= time <= c.window[1]]
            slack = 1.0 if time in knots else between
            for m in self._solver.checker.measures(active, q):
                if not m.by <= slack * (ANGLE if m.unit == "rad" else LENGTH):  # not finite: missed
                    key = (m.constraint, m.what)
                    if key not in worst or m.by > worst[key].measure.by:
                        worst[key] = Missed(time, m)
        return tuple(sorted(worst.values(), key=_size))


def _with_windows(times: Array, constraints: Sequence[Constraint]) -> Array:
    """Times with those at which a window opens or closes. Raises ValueError for a window outside."""
    edges = []
    for constraint in constraints:
        first, last = constraint.window
        if first > times[-1] or last < times[0]:
            raise ValueError(
                f"{constraint.label}: window: got {constraint.window}; expected one that meets {times[0]:g} to {times[-1]:g} s"
            )
        edges += [t for t in (first, last) if times[0] < t < times[-1] and np.abs(times - t).min() > 1e-9]
    return np.unique(np.concatenate([times, edges]))


def _size(missed: Missed) -> float:
    return -missed.measure.size


def _missing(found: Trajectory) -> float:
    return -_size(found.violations[0]) if found.violations else 0.0


class TrajectoryProblem:
    """Points are the moving coordinates of all knots after the first, flat; steps are differences of them."""

    def __init__(
        self, solver: Solver, constraints: Sequence[Constraint], start: Array, times: Array, nominal: Array, cost: Array,
        columns: Integers, weighting: tuple[float, float],
    ):  # fmt: skip
        mechanism = solver.mechanism
        self._model, self._start, self._columns, self._nv = mechanism.model, start, columns, mechanism.nv
        self._base = mechanism.base if (columns < mechanism.base).any() else 0
        n, free = len(columns), len(times) - 1
        spline, (velocity, acceleration) = Spline(times), weighting
        over = np.eye(len(times)) + velocity * spline.velocity.T @ spline.velocity
        over += acceleration * spline.acceleration.T @ spline.acceleration
        self._hessian: Array = np.asarray(np.kron(over[1:, 1:], np.diag(cost[columns])), dtype=float)
        # The first knot stands still at 0, so only the nominal configuration draws on the others beside themselves.
        drawn = np.outer(np.ones(free), pin.difference(self._model, start, nominal)[columns] * cost[columns])
        self._drawn = drawn.ravel()
        self._constant = 0.5 * float((drawn**2 / cost[columns]).sum())
        self._rows: list[Rows] = []
        low, high = np.full((free, mechanism.nv), -np.inf), np.full((free, mechanism.nv), np.inf)
        at = np.zeros(mechanism.nv)
        at[mechanism.v_rows] = start[mechanism.q_rows]
        shared: dict[tuple[int, ...], tuple[Table, Rows]] = {}
        for knot, time in enumerate(times[1:].tolist()):
            numbers = tuple(number for number, c in enumerate(constraints) if c.window[0] <= time <= c.window[1])
            if numbers not in shared:  # knots at which the same holds take turns with one set of rows
                table = table_of(mechanism, [constraints[number] for number in numbers], start)
                shared[numbers] = table, solver.rows(table, columns)
            table, rows = shared[numbers]
            low[knot], high[knot] = table.low - at, table.high - at
            self._rows.append(rows)
        self._low, self._high = low[:, columns].ravel(), high[:, columns].ravel()
        size, most = free * n, sum(rows.most for rows in self._rows)
        self._matrix = np.zeros((most, size))
        self._below, self._above = np.zeros(size + most), np.zeros(size + most)
        self._kinds = np.full(size + most, INEQUALITY, np.int32)

    def away(self, point: Array) -> Array:
        """(knots, nv) tangent vectors from the start to all knots, the first among them."""
        found = np.zeros((len(self._rows) + 1, self._nv))
        found[1:, self._columns] = point.reshape(len(self._rows), -1)
        return found

    def linearise(self, point: Array, trust: float) -> Program:
        """See Problem."""
        n, size = len(self._columns), len(point)
        total, first = 0.0, 0
        for knot, (rows, away) in enumerate(zip(self._rows, self.away(point)[1:], strict=True)):
            m = rows.at(pin.integrate(self._model, self._start, away))
            # Rows are by velocities, knots are tangent vectors at the start: for a base that turns not the same.
            change = pin.Jexp6(pin.Motion(away[: self._base])) if self._base else _NO_BASE
            total += kernels.block(
                rows.value, rows.lower, rows.upper, rows.weight, rows.matrix, m, change, self._matrix, first, knot * n,
                self._below, self._above, size,
            )  # fmt: skip
            self._kinds[size + first : size + first + m] = rows.kinds[:m]
            first += m
        self._below[:size] = np.maximum(-trust, np.minimum(self._low - point, 0.0))
        self._above[:size] = np.minimum(trust, np.maximum(self._high - point, 0.0))
        pull = self._hessian @ point
        end = size + first
        return Program(
            self._hessian, pull - self._drawn, self._matrix[:first], self._below[:end], self._above[:end], self._kinds[:end],
            float(np.sqrt(total)), float(0.5 * point @ pull - point @ self._drawn) + self._constant,
        )  # fmt: skip

    def step(self, point: Array, x: Array) -> Array:
        """See Problem."""
        return point + x
