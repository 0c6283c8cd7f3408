"""The rows of one table, and of what is near, at a configuration: values, bounds and Jacobian, in arrays that are kept."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from engines.planning.ik import kernels
from engines.planning.ik.mechanism import Mechanism
from engines.planning.ik.nearness import Nearness
from engines.planning.ik.sqp import EQUALITY, SOFT
from engines.planning.ik.table import Table
from handrail.robot.model_memory import placements

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


class Workspace:
    """pinocchio's data and arrays of one thread, kept between problems."""

    def __init__(self, mechanism: Mechanism):
        self.mechanism = mechanism
        self.data = mechanism.model.createData()
        pin.jacobianCenterOfMass(mechanism.model, self.data, pin.neutral(mechanism.model), False)
        self.placement = placements(self.data.oMi)
        self.jacobian, self.com_jacobian = self.data.J.T, self.data.Jcom.T
        self.com = self.data.com[0]
        self.coordinates = np.zeros(mechanism.nv)


class Rows:
    """After `at`, the arrays hold the first `count` rows, not yet weighted."""

    def __init__(
        self, workspace: Workspace, table: Table, near: list[Nearness], columns: Integers,
        soft: Collection[int] = (),
    ):  # fmt: skip
        """`columns`: the velocities that move, one column of the Jacobian each; `soft`: numbers of constraints that give way."""
        mechanism = workspace.mechanism
        self._workspace, self._near = workspace, near
        self._items, self.fixed = len(table.integers), table.rows
        items, rows = (n + sum(one.most for one in near) for n in (self._items, self.fixed))
        self._slot = np.full(mechanism.nv, -1, np.int64)
        self._slot[columns] = np.arange(len(columns))
        self._integers = np.zeros((items, kernels.INTEGERS), np.int64)
        self._numbers, self._relations = np.zeros((items, kernels.NUMBERS)), np.zeros((items, mechanism.nv))
        self.value, self.matrix = np.zeros(rows), np.zeros((rows, len(columns)))
        self.lower, self.upper, self.weight = np.zeros(rows), np.zeros(rows), np.zeros(rows)
        self.kinds = np.full(rows, SOFT, np.int32)
        self._integers[: self._items], self._numbers[: self._items] = table.integers, table.numbers
        self._relations[: self._items] = table.relations
        for mine, its in ((self.lower, table.lower), (self.upper, table.upper), (self.weight, table.weight)):
            mine[: self.fixed] = its
        self.weight[self.fixed :] = 1.0
        self.gives = np.zeros(rows, np.bool_)
        self.gives[: self.fixed] = [owner in soft for owner in table.owners]
        self.kinds[: self.fixed][table.lower == table.upper] |= EQUALITY
        self.most = rows

    def at(self, q: Array) -> int:
        """Evaluates everything at a configuration (nq,); how many rows there are."""
        w = self._workspace
        mechanism = w.mechanism
        pin.jacobianCenterOfMass(mechanism.model, w.data, q, False)
        w.coordinates[mechanism.v_rows] = q[mechanism.q_rows]
        items, rows = self._items, self.fixed
        for near in self._near:
            found = near.items(
                self._integers[items:], self._numbers[items:], self.lower[rows:], self.upper[rows:], rows
            )
            self.gives[rows : rows + found] = near.gives
            items, rows = items + found, rows + found
        kernels.rows(
            self._integers[:items], self._numbers[:items], self._relations[:items], w.placement, w.jacobian, w.com,
            w.com_jacobian, mechanism.support, self._slot, w.coordinates, self.value[:rows], self.matrix[:rows],
        )  # fmt: skip
        return rows
