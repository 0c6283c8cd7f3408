"""Sequential quadratic programming: linearise, solve the elastic program, step, until constraints and cost settle.

Every row is soft in the quadratic program (daqp), with a penalty so stiff that it is kept where it can be: a step that can't keep
all of them within the trust region keeps them as well as may be, and an infeasible problem ends at the least violation. The cost's
Hessian is exact; constraints' curvature is left out (Gauss-Newton).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import daqp
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Kinds = NDArray[np.int32]

INEQUALITY, EQUALITY, SOFT = 0, 5, 8
"""daqp's kinds of rows"""
_TRUST, _LEAST_TRUST = 0.6, 0.02
"""rad (m) that a step moves any coordinate"""
_CLOSE = 1e-2
"""violation from which on Newton's method on the constraints alone converges in a step or two"""
_SMALL = 2e-4
"""violation that a step may end with, whatever it was before: the next one takes it back"""
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

    point: Array
    violation: float
    """m, as in Settings"""
    cost: float
    iterations: int
    kept: bool


@dataclass
class Program:
    """The quadratic program of the next step: minimise ½ xᵀ hessian x + gradientᵀ x, below ≤ [x; matrix x] ≤ above."""

    hessian: Array
    """(n, n)"""
    gradient: Array
    """(n,)"""
    matrix: Array
    """(rows, n)"""
    below: Array
    """(n + rows,)"""
    above: Array
    kinds: Kinds
    """(n + rows,)"""
    violation: float
    cost: float


class Problem(Protocol):
    """What can be descended on."""

    def linearise(self, point: Array, trust: float) -> Program:
        """The program at a point, for steps of at most `trust` in any coordinate. Valid until the next call."""

    def step(self, point: Array, x: Array) -> Array:
        """The point a step x away."""


class _Quadratic:
    """Programs with one Hessian, one after the other: its factors are kept, most of the work of a large one."""

    def __init__(self) -> None:
        self._model, self._shape = daqp.Model(), (-1, -1)
        self._model.settings = {"rho_soft": _STIFF, "primal_tol": 1e-9}

    def solve(self, p: Program) -> Array | None:
        """The step, None when there is none."""
        if p.matrix.shape == self._shape:
            failed = self._model.update(None, p.gradient, p.matrix, p.above, p.below, p.kinds) < 0
        else:
            self._shape = p.matrix.shape
            failed = self._model.setup(p.hessian, p.gradient, p.matrix, p.above, p.below, p.kinds)[0] < 0
        if failed:
            return None
        x, _, flag, _ = self._model.solve()
        return x if flag > 0 and np.isfinite(x).all() else None


def descend(problem: Problem, start: Array, settings: Settings) -> Ending:
    """From a point within limits to the nearest end: all constraints kept at a settled cost, or the least violation."""
    point, trust, done = start, _TRUST, 0
    quadratic = _Quadratic()
    program = problem.linearise(point, trust)
    best: tuple[float, Array] | None = None
    least, idle = program.violation, 0
    while done < settings.iterations:
        done += 1
        x = quadratic.solve(program)
        if x is None:
            break
        violation, cost, share = program.violation, program.cost, 1.0
        while True:
            trial = problem.step(point, x if share == 1.0 else share * x)
            trust_then = min(_TRUST, 2.0 * trust) if share == 1.0 else max(_LEAST_TRUST, share * trust)
            program = problem.linearise(trial, trust_then)
            if program.violation <= max((1.0 - 0.01 * share) * violation, _SMALL) or share < 0.1:
                break
            share *= 0.5
        point, trust = trial, trust_then
        settled = abs(program.cost - cost) <= settings.settled * (1.0 + program.cost)
        if program.violation <= settings.tolerance:
            if best is None or program.cost < best[0]:
                best = (program.cost, point)
            if settled:
                break
        elif settled and program.violation <= _CLOSE:
            program.gradient[:] = 0.0  # what is left is the constraints': the least step keeps them, in quadratic order
        if program.violation < 0.9 * least:
            least, idle = program.violation, 0
        else:
            idle += 1
            if idle >= settings.patience:
                break
    if best is not None:
        return Ending(best[1], 0.0, best[0], done, True)
    return Ending(point, program.violation, program.cost, done, False)
