"""A problem some of whose constraints give way: they cost what they are missed by, and the others hold first.

What a row gives is a variable of the quadratic program beside the step, at a price far above the posture's and far below the
penalty that keeps other rows: a row with less weight in the penalty alone is no softer where it is at odds with one that must hold.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from engines.planning.ik.rows import Rows
from engines.planning.ik.sqp import INEQUALITY, Problem, Program

Array = NDArray[np.float64]

_PRICE = 1e4
"""1/m²: of what gives, against a posture's squared distance in rad"""
_SHARE = 0.03
"""of a violation that what gives counts while steps are judged"""
_FAR = 1e6
"""m: what no row gives"""


class SoftenedProblem:
    """Of an inner problem, whose `rows` know which of them give."""

    def __init__(self, inner: Problem, rows: Rows):
        self._inner, self._rows, self._moving = inner, rows, 0

    def linearise(self, point: Array, trust: float) -> Program:
        """See Problem."""
        p = self._inner.linearise(point, trust)
        n, m = len(p.gradient), len(p.matrix)
        self._moving = n
        gives = self._rows.gives[:m]
        k = int(gives.sum())
        hessian = np.zeros((n + k, n + k))
        hessian[:n, :n] = p.hessian
        hessian[range(n, n + k), range(n, n + k)] = _PRICE
        matrix = np.zeros((m, n + k))
        matrix[:, :n] = p.matrix
        matrix[np.flatnonzero(gives), range(n, n + k)] = 1.0
        missed = np.maximum(np.maximum(p.below[n:], -p.above[n:]), 0.0)
        far = np.full(k, _FAR)
        return Program(
            hessian, np.concatenate((p.gradient, np.zeros(k))), matrix,
            np.concatenate((p.below[:n], -far, p.below[n:])), np.concatenate((p.above[:n], far, p.above[n:])),
            np.concatenate((p.kinds[:n], np.full(k, INEQUALITY, np.int32), p.kinds[n:])),
            float(np.linalg.norm(np.where(gives, _SHARE * missed, missed))), p.cost,
        )  # fmt: skip

    def step(self, point: Array, x: Array) -> Array:
        """See Problem."""
        return self._inner.step(point, x[: self._moving])
