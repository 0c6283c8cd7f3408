"""Sequential quadratic programming from one start: linearise, solve the elastic program, step, until constraints and cost settle.

Every row is soft in the quadratic program (daqp), with a penalty so stiff that it is kept where it can be: a step that can't keep
all of them within the trust region keeps them as well as may be, and an infeasible problem ends at the least violation. The cost is
the distance to the nominal configuration, whose Hessian is exact in the tangent space; constraints' curvature is left out
(Gauss-Newton).
"""

from __future__ import annotations

from dataclasses import dataclass

import daqp
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from engines.planning.ik import kernels
from engines.planning.ik.mechanism import Mechanism
from engines.planning.ik.nearness import Nearness
from engines.planning.ik.table import Table
from handrail.robot.model_memory import placements

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

_EQUALITY, _SOFT = 5, 8
"""daqp's kinds of rows"""
_TRUST, _LEAST_TRUST, _MOST_TRUST = 0.6, 0.02, 1.2
"""rad (m) that a step moves any coordinate"""
_CLOSE = 1e-2
"""violation from which on Newton's method on the constraints alone converges in a step or two"""
_STIFF = 1e-8
"""what a row's penalty is divided by"""


@dataclass(frozen=True)
class Settings:
    """When to stop. A violation is the Euclidean norm over rows, m, an angle counting ANGLE_WEIGHT m/rad."""

    iterations: int = 40
    tolerance: float = 1e-5
    """violation at which all constraints are kept"""
    settled: float = 1e-3
    """of 1 + cost: what an iteration still gains when the cost has settled"""
    patience: int = 4
    """iterations without a tenth of the violation gone, after which a start is given up"""


@dataclass(frozen=True)
class Ending:
    """Where a descent ended."""

    q: Array
    violation: float
    """m, as in Settings"""
    cost: float
    iterations: int
    kept: bool


class Workspace:
    """pinocchio's data and arrays of one thread, kept between problems."""

    def __init__(self, mechanism: Mechanism):
        self.mechanism = mechanism
        self.data = mechanism.model.createData()
        pin.jacobianCenterOfMass(mechanism.model, self.data, pin.neutral(mechanism.model), False)
        self.placement = placements(self.data.oMi)
        self.jacobian, self.com_jacobian = self.data.J.T, self.data.Jcom.T
        self.com = self.data.com[0]
        self._buffers: dict[tuple[int, int, int], Buffers] = {}

    def buffers(self, items: int, rows: int, columns: int) -> Buffers:
        """Arrays for that many; the same ones for the same numbers."""
        key = (items, rows, columns)
        if key not in self._buffers:
            if len(self._buffers) > 50:
                self._buffers.clear()
            self._buffers[key] = Buffers(items, rows, columns, self.mechanism.nv)
        return self._buffers[key]


class Buffers:
    """What an evaluation writes."""

    def __init__(self, items: int, rows: int, columns: int, nv: int):
        self.integers = np.zeros((items, kernels.INTEGERS), np.int64)
        self.numbers = np.zeros((items, kernels.NUMBERS))
        self.relations = np.zeros((items, nv))
        self.lower, self.upper, self.weight = np.zeros(rows), np.zeros(rows), np.zeros(rows)
        self.value, self.matrix = np.zeros(rows), np.zeros((rows, columns))
        self.below, self.above = np.zeros(columns + rows), np.zeros(columns + rows)
        self.gradient = np.zeros(columns)
        self.sense = np.zeros(columns + rows, np.int32)
        self.full = np.zeros(nv)
        self.coordinates = np.zeros(nv)


class Descent:
    """One problem, ready to start anywhere."""

    def __init__(
        self, workspace: Workspace, table: Table, near: list[tuple[int, Nearness]], nominal: Array, cost: Array,
        columns: Integers, settings: Settings,
    ):  # fmt: skip
        """`cost` (nv,) weights the squared distance to `nominal` (nq,); `columns`: the velocities that move."""
        self._mechanism, self._workspace = workspace.mechanism, workspace
        self._table, self._near, self._settings = table, near, settings
        self._nominal, self._cost, self._columns = nominal, cost, columns
        self._slot = np.full(self._mechanism.nv, -1, np.int64)
        self._slot[columns] = np.arange(len(columns))
        self._hessian = np.diag(cost[columns])
        more = sum(one.most for _, one in near)
        items, self._fixed = len(table.integers), table.rows
        self._b = b = workspace.buffers(items + more, table.rows + more, len(columns))
        b.integers[:items], b.numbers[:items], b.relations[:items] = table.integers, table.numbers, table.relations
        b.lower[: self._fixed], b.upper[: self._fixed] = table.lower, table.upper
        b.weight[: self._fixed] = table.weight
        b.weight[self._fixed :] = 1.0
        b.sense[:] = _SOFT
        b.sense[: len(columns)] = 0
        b.sense[len(columns) : len(columns) + self._fixed][table.lower == table.upper] |= _EQUALITY
        self._items, self._rows = items, self._fixed
        self.owners: list[int] = []
        """constraint numbers of the rows after the table's, as of the last evaluation"""

    def run(self, start: Array) -> Ending:
        """From a configuration (nq,) within limits."""
        model, settings, b = self._mechanism.model, self._settings, self._b
        n = len(self._columns)
        q, trust = start, _TRUST
        violation, cost = self._evaluate(q, trust)
        best: tuple[float, Array] | None = None
        least, idle = violation, 0
        done = 0
        while done < settings.iterations:
            done += 1
            m = self._rows
            x, _, flag, _ = daqp.solve(
                self._hessian, b.gradient, b.matrix[:m], b.above[: n + m], b.below[: n + m], b.sense[: n + m],
                rho_soft=_STIFF, primal_tol=1e-9,
            )  # fmt: skip
            if flag <= 0 or not np.isfinite(x).all():
                break
            before, spent, share = violation, cost, 1.0
            step = b.full
            step[self._columns] = x
            while True:
                trial = pin.integrate(model, q, share * step if share < 1.0 else step)
                next_trust = max(_LEAST_TRUST, share * trust)
                violation, cost = self._evaluate(trial, next_trust)
                if violation <= max((1.0 - 0.01 * share) * before, 1e-3) or share < 0.2:
                    break
                share *= 0.5
            q, trust = trial, next_trust
            settled = abs(cost - spent) <= settings.settled * (1.0 + cost)
            if violation <= settings.tolerance:
                if best is None or cost < best[0]:
                    best = (cost, q)
                if settled:
                    break
            elif (
                settled and violation <= _CLOSE
            ):  # what is left is the constraints' alone: the least step keeps them, in quadratic order
                b.gradient[:] = 0.0
            if violation < 0.9 * least:
                least, idle = violation, 0
            else:
                idle += 1
                if idle >= settings.patience:
                    break
        if best is not None:
            return Ending(best[1], 0.0, best[0], done, True)
        return Ending(q, violation, cost, done, False)

    def linearised(self, q: Array) -> tuple[Array, Array]:
        """(rows,) weighted values and (rows, columns) their Jacobian at a configuration."""
        self._evaluate(q, _TRUST)
        return self._b.weight[: self._rows] * self._b.value[: self._rows], self._b.matrix[: self._rows].copy()

    def _evaluate(self, q: Array, trust: float) -> tuple[float, float]:
        """Everything about q: (violation, cost), and the quadratic program of the next step."""
        mechanism, workspace, b = self._mechanism, self._workspace, self._b
        pin.jacobianCenterOfMass(mechanism.model, workspace.data, q, False)
        b.coordinates[mechanism.v_rows] = q[mechanism.q_rows]
        items = rows = 0
        if self._near:
            self.owners = []
            for owner, near in self._near:
                at, row = self._items + items, self._fixed + rows
                found = near.items(b.integers[at:], b.numbers[at:], b.lower[row:], b.upper[row:], row)
                self.owners += [owner] * found
                items, rows = items + found, rows + found
        items, m = items + self._items, rows + self._fixed
        self._rows = m
        kernels.rows(
            b.integers[:items], b.numbers[:items], b.relations[:items], workspace.placement, workspace.jacobian,
            workspace.com, workspace.com_jacobian, mechanism.support, self._slot, b.coordinates, b.value[:m],
            b.matrix[:m],
        )  # fmt: skip
        away = pin.difference(mechanism.model, self._nominal, q)
        return kernels.program(  # type: ignore[no-any-return]
            b.value[:m], b.lower[:m], b.upper[:m], b.weight[:m], b.matrix[:m], b.coordinates, self._table.low,
            self._table.high, self._columns, away, self._cost, trust, b.gradient, b.below, b.above,
        )  # fmt: skip
