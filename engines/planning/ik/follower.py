"""Inverse kinematics for goal after goal: neighbours on a line or an arc, hundreds a plan, all solved in one compiled call.

`Solver` finds the nearest answer to one hard question, most of its time in Python (constraints, their table, the check) around a
few compiled steps. Here the constraints become a table once, only where they are differs between goals, and
the descent is compiled whole, on the same rows (`kernels.rows`). It is a plainer one: Gauss-Newton on rows with a weak pull to a
reference posture, joint limits as bounds (joints at a bound that the step would cross leave the step, an active set, so that the
others make up for them). The pull resolves the redundancy the same way for neighbouring goals, which keeps a path on one branch.
Where a goal is out of reach the answer is the least miss and still next to its neighbours. Nothing is random.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from engines.planning.ik import constraints as kinds
from engines.planning.ik import kernels
from engines.planning.ik.constraints import Constraint
from engines.planning.ik.mechanism import Mechanism
from engines.planning.ik.table import table_of
from engines.planning.ik.tree import Tree, place, tree_of
from handrail.compiled import compiled

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

_PULL = 0.012
"""m/rad of the pull to the reference posture: a radian off costs as much as 12 mm of a frame, squared a ten-thousandth of it"""
_DAMPING = 1e-6
_STRETCH = 0.12
"""m, about a hand's breadth: what a linear step is good for; further misses are cut to it"""
_STEP = 0.4
"""rad (m) that a step moves any joint"""
_SETTLED = 1e-4
"""rad (m): steps below it have settled"""
COLD, WARM = 150, 25
"""iterations: from a start somewhere, from a neighbouring answer"""
_REFUSED = (kinds.CentreOfMass, kinds.Balance, kinds.Clearance, kinds.BodyDistance)


@dataclass(frozen=True)
class Followed:
    """Answers at k goals."""

    q: Array
    """(k, m) rad (m) of the joints that move"""
    missed: Array
    """(k, constraints) by how much each constraint is missed, m or rad (Euclidean, over its rows)"""


class Follower:
    """For constraints that are the same from goal to goal, but for where they are: each goal carries what they say of the world.

    They are of frames or joints, and exact: a row that comes and goes with its bound would make neighbours jump.
    """

    def __init__(
        self, mechanism: Mechanism, constraints: Sequence[Constraint], moving: Sequence[str],
        weights: Mapping[str, float] | None = None, factors: Sequence[float] | None = None,
    ):  # fmt: skip
        """
        :param factors: of each constraint, what it counts for against the others; None: all alike
        :param moving: all joints that move the constraints' frames, on a fixed base
        :param weights: joint → factor of its pull to the posture; 1 where left out
        :raises ValueError: a constraint that can't be meant, has bounds, is of the centre of mass or of bodies; a joint is missing
        """
        if mechanism.free:
            raise ValueError("mechanism: got one on a free base; expected a fixed one")
        for constraint in constraints:
            if isinstance(constraint, _REFUSED):
                raise ValueError(
                    f"{constraint.label}: got {type(constraint).__name__}; expected one of frames or joints"
                )
        rows = [mechanism.named("moving", joint) for joint in moving]
        self._tree = tree_of(mechanism, moving)
        table = table_of(mechanism, constraints, pin.neutral(mechanism.model))
        if (loose := np.flatnonzero(table.lower < table.upper)).size:
            label = constraints[table.owners[loose[0]]].label
            raise ValueError(f"{label}: got bounds; expected what is kept exactly, or is free (bounds are Solver's)")
        self._slot = np.full(mechanism.nv, -1, np.int64)
        self._slot[rows] = np.arange(len(rows))
        for item, (_, *joints, _) in enumerate(table.integers):
            moves = set(np.flatnonzero(table.relations[item]).tolist()).union(*(_moving(mechanism, j) for j in joints))
            if others := sorted(moves - set(rows)):
                raise ValueError(f"moving: got {', '.join(moving)}; expected {mechanism.joint_of(others[0])} as well")
        self.lower, self.upper = table.low[rows], table.high[rows]
        """(m,) of the joints that move, margins included"""
        self._pull = _PULL * mechanism.weights(weights)[rows]
        self._support, self._joints = mechanism.support, mechanism.model.njoints
        self._owners, self._constraints = np.array(table.owners, np.int64), len(constraints)
        weight = table.weight if factors is None else table.weight * np.array(factors, dtype=float)[self._owners]
        self._table = (table.integers, table.numbers, table.relations, table.lower, weight)

    def solve(self, starts: Array, goals: Array, posture: Array, iterations: int = WARM) -> Followed:
        """Answers in order, each from its own start or, once those are used up, from the answer before it.

        :param starts: (1 to k, m) rad (m)
        :param goals: (k, 12) rotation by columns, translation (m), that carry what constraints say of the world
        :param posture: (m,) rad (m), the reference
        """
        # Contiguous, because numba would compile anew for other layouts.
        within = np.ascontiguousarray(np.clip(starts, self.lower, self.upper))
        q, missed = _follow(
            self._tree, *self._table, self._owners, self._constraints, self._support, self._slot, self._joints, within,
            np.ascontiguousarray(goals), np.ascontiguousarray(posture, dtype=float), self._pull, self.lower, self.upper,
            iterations,
        )  # fmt: skip
        return Followed(q, missed)

    def joint_placements(self, q: Array) -> Array:
        """(k, joints, 12) rotation by columns and translation of all joints at q (k, m); joints that stay have zeros."""
        return _places(self._tree, self._joints, len(self._slot), np.ascontiguousarray(q))


def _moving(mechanism: Mechanism, joint: int) -> set[int]:
    return set(mechanism.support[joint, 1 : 1 + mechanism.support[joint, 0]].tolist())


@compiled
def _places(tree: Tree, joints: int, nv: int, q: Array) -> Array:
    found, jacobian = np.zeros((q.shape[0], joints, 12)), np.empty((nv, 6))
    for k in range(q.shape[0]):
        place(tree, q[k], found[k], jacobian)
    return found


@compiled(error_model="numpy")
def _follow(
    tree: Tree, integers: Integers, numbers: Array, relations: Array, wanted: Array, weight: Array,
    owners: Integers, constraints: int, support: Integers, slot: Integers, joints: int, starts: Array, goals: Array,
    posture: Array, pull: Array, lower: Array, upper: Array, iterations: int,
) -> tuple[Array, Array]:  # fmt: skip
    """Damped Gauss-Newton for each goal, rows weighed against a pull."""
    k, m, count, nv = goals.shape[0], starts.shape[1], wanted.shape[0], slot.shape[0]
    placement, jacobian, coordinates = np.zeros((joints, 12)), np.zeros((nv, 6)), np.zeros(nv)
    com, com_jacobian = np.zeros(3), np.zeros((nv, 3))
    value, matrix, miss = np.zeros(count), np.zeros((count, m)), np.zeros(count)
    hessian, gradient, step, reference = np.empty((m, m)), np.empty(m), np.empty(m), np.empty(m)
    found, missed = np.empty((k, m)), np.zeros((k, constraints))
    for goal in range(k):
        q = found[goal]
        q[:] = starts[goal] if goal < starts.shape[0] else found[goal - 1]
        reference[:] = posture
        refined, last = 0, False
        placement[0] = goals[goal]  # all that is said of the world goes with the goal
        for iteration in range(iterations + 1):
            place(tree, q, placement, jacobian)
            for i in range(m):
                coordinates[tree.velocities[i]] = q[tree.order[i]]
            kernels.rows(
                integers, numbers, relations, placement, jacobian, com, com_jacobian, support, slot, coordinates, value,
                matrix,
            )  # fmt: skip
            size = 0.0
            for r in range(count):
                miss[r] = wanted[r] - value[r]
                size += (weight[r] * miss[r]) ** 2
            if last or iteration == iterations:
                break
            cut = min(1.0, _STRETCH / max(np.sqrt(size), 1e-12))
            for i in range(m):
                gradient[i] = pull[i] ** 2 * (reference[i] - q[i])
                for j in range(i + 1):
                    hessian[i, j] = pull[i] ** 2 + _DAMPING if i == j else 0.0
            for r in range(count):
                for i in range(m):
                    slope = weight[r] ** 2 * matrix[r, i]
                    gradient[i] += slope * cut * miss[r]
                    for j in range(i + 1):
                        hessian[i, j] += slope * matrix[r, j]
            _bounded_step(hessian, gradient, q, lower, upper, step)
            largest = 0.0
            for j in range(m):
                largest = max(largest, abs(step[j]))
            for j in range(m):
                q[j] = min(max(q[j] + step[j] * min(1.0, _STEP / max(largest, 1e-9)), lower[j]), upper[j])
            if largest < _SETTLED:
                last = refined == 2
                # Near the least of both costs the pull still biases a frame by a millimetre. Pulling to where we are instead
                # takes the bias away along the shortest way, so that neighbours stay neighbours.
                refined += 1
                reference[:] = q
        for r in range(count):
            missed[goal, owners[r]] += miss[r] ** 2
    return found, np.sqrt(missed)


@compiled
def _bounded_step(hessian: Array, gradient: Array, q: Array, lower: Array, upper: Array, step: Array) -> None:
    """The Newton step of the joints that are not pushed into their bounds; the others stand still. Reads the lower triangle."""
    m = q.shape[0]
    free = np.ones(m, np.bool_)
    factor = np.empty((m, m))
    for _ in range(4):
        for i in range(m):  # Cholesky, a blocked joint's row and column replaced by the identity's
            for j in range(i + 1):
                total = hessian[i, j] if free[i] and free[j] else (1.0 if i == j else 0.0)
                for k in range(j):
                    total -= factor[i, k] * factor[j, k]
                factor[i, j] = np.sqrt(total) if i == j else total / factor[j, j]
        for i in range(m):
            step[i] = gradient[i] if free[i] else 0.0
            for k in range(i):
                step[i] -= factor[i, k] * step[k]
            step[i] /= factor[i, i]
        for i in range(m - 1, -1, -1):
            for k in range(i + 1, m):
                step[i] -= factor[k, i] * step[k]
            step[i] /= factor[i, i]
        more = False
        for j in range(m):
            at_upper = q[j] >= upper[j] - 1e-9 and step[j] > 0.0
            at_lower = q[j] <= lower[j] + 1e-9 and step[j] < 0.0
            if free[j] and (at_upper or at_lower):
                free[j] = False
                more = True
        if not more:
            break
