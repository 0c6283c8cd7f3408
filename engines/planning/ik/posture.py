"""The problem of one configuration: the least distance to a nominal one, subject to rows and limits."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from engines.planning.ik import kernels
from engines.planning.ik.rows import Rows, Workspace
from engines.planning.ik.sqp import INEQUALITY, Program
from engines.planning.ik.table import Table

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


class PostureProblem:
    """Points are configurations (nq,), steps (columns,) velocities of what moves."""

    def __init__(
        self, workspace: Workspace, rows: Rows, table: Table, nominal: Array, cost: Array, columns: Integers
    ):  # fmt: skip
        """`cost` (nv,) weights the squared distance to `nominal` (nq,); `columns`: the velocities that move."""
        self._workspace, self._rows, self._table = workspace, rows, table
        self._model = workspace.mechanism.model
        self._nominal, self._cost, self._columns = nominal, cost, columns
        n = len(columns)
        self._hessian = np.diag(cost[columns])
        self._gradient, self._full = np.zeros(n), np.zeros(workspace.mechanism.nv)
        self._below, self._above = np.zeros(n + rows.most), np.zeros(n + rows.most)
        self._kinds = np.concatenate((np.full(n, INEQUALITY, np.int32), rows.kinds))

    def linearise(self, point: Array, trust: float) -> Program:
        """See Problem."""
        rows, table = self._rows, self._table
        m = rows.at(point)
        size = len(self._columns) + m
        matrix = rows.matrix[:m]
        violation, cost = kernels.program(
            rows.value[:m], rows.lower[:m], rows.upper[:m], rows.weight[:m], matrix, self._workspace.coordinates,
            table.low, table.high, self._columns, pin.difference(self._model, self._nominal, point), self._cost, trust,
            self._gradient, self._below, self._above,
        )  # fmt: skip
        return Program(
            self._hessian, self._gradient, matrix, self._below[:size], self._above[:size], self._kinds[:size], violation, cost
        )  # fmt: skip

    def step(self, point: Array, x: Array) -> Array:
        """See Problem."""
        self._full[self._columns] = x
        return pin.integrate(self._model, point, self._full)
