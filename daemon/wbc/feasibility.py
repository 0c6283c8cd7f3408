"""Where to start when the kernel knows no point that keeps all bounds, and what to do when there is none (daqp).

The nearest point to standing still that keeps them is one small quadratic program. When it has no answer, the constraints exclude
each other: then the bounds are moved as little as they must be (least squares, weighed as the kinetic energy that they stand for),
those that had to move are named, and the levels are solved within what is left.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import daqp
import numpy as np

from daemon.wbc import kernels
from daemon.wbc import layout as at
from daemon.wbc.memory import Array
from daemon.wbc.result import Blocked

if TYPE_CHECKING:
    from daemon.wbc.hierarchy import WholeBody

_INFINITE = 1e30
_NEGLIGIBLE = 1e-6
"""of a bound's unit length: it gave way by more than this"""
_ROOM = 1e-9
_SOFTLY = 1e-6
"""what distance costs beside giving way"""


class Feasibility:
    """Solves a WholeBody's cycle from where its kernel has given up."""

    def __init__(self, body: WholeBody):
        self._body = body

    def solve(self, status: int) -> None:
        """Fill in the body's result, whatever it takes; finite, always."""
        body = self._body
        result, memory, sizes = body.result, body.memory, body.sizes
        result.blocked, result.active = (), 0
        if status == at.NOT_FINITE:
            self._give_up("the state or a reference is no finite number, or the mass matrix is not positive")
            return
        if status == at.CONTRADICTION:
            title = body.equality_title(int(sizes[at.CULPRIT]))
            self._give_up(f"{title} contradicts the constraints before it")
            return
        rows, lower, upper = self._bounds()
        start, owned = memory["y"][3].copy(), memory["basis"][: int(sizes[at.FIXED]), : int(sizes[at.N])]
        try:
            y, gave = self._nearest(rows, lower, upper, start, owned)
        except ArithmeticError as problem:
            self._give_up(str(problem))
            return
        memory["y"][4] = y
        if gave.any():
            moved = np.abs(gave) * self._length + _ROOM
            bound = memory["bound"]
            bound[0, gave < 0.0] -= moved[gave < 0.0]
            bound[1, gave > 0.0] += moved[gave > 0.0]
        status = kernels.descend(*body.arguments)
        if status != at.SOLVED or not np.isfinite(memory["out"]).all():
            self._give_up("the levels have no answer that keeps the bounds in finite precision")
            return
        result.active = int(sizes[at.ACTIVE_COUNT])
        result.blocked = self._blocked(gave)
        result.solved = not result.blocked
        result.why = f"constraints exclude each other: {result.blocked[0]}" if result.blocked else ""

    def _give_up(self, why: str) -> None:
        """Torque against gravity as far as it is known, nothing else."""
        body, result = self._body, self._body.result
        held = body.model.gravity_torque()
        if not np.isfinite(held).all():
            held = np.zeros_like(held)
        most = body.memory["limits"][4]
        result.torque[:] = np.clip(held, -most, most)
        result.torque[: body.model.base] = 0.0
        result.acceleration[:], result.force[:] = 0.0, 0.0
        result.solved, result.why = False, why
        body.sizes[at.ACTIVE_COUNT] = 0

    def _bounds(self) -> tuple[Array, Array, Array]:
        """(rows of y (m, n), lower, upper (m,)): every bound, rows of unit length."""
        body = self._body
        memory, n = body.memory, int(body.sizes[at.N])
        total = 2 * body.model.nv + int(body.sizes[at.BOUNDED_ROWS])
        rows, about = np.zeros((total, n)), np.zeros((2, total))
        kernels.all_bound_rows(memory.table, body.plan, body.sizes, rows, about)
        constant, self._length = about
        length = np.where(self._length > 0.0, self._length, 1.0)
        bound = memory["bound"][:, :total]
        none = self._length == 0.0
        lower, upper = ((bound[side] - constant) / length for side in range(2))
        return rows, np.where(none, -np.inf, lower), np.where(none, np.inf, upper)

    def _nearest(self, rows: Array, lower: Array, upper: Array, start: Array, owned: Array) -> tuple[Array, Array]:
        """(y, by how much (m,) each bound is exceeded there, negative below the lower): nearest to `start` in what is free."""
        free = _complement(owned)
        here, a = rows @ start, rows @ free
        keep = np.isfinite(lower) | np.isfinite(upper)
        gave, size, m = np.zeros(len(lower)), free.shape[1], int(keep.sum())
        below, above = (lower - here)[keep], (upper - here)[keep]
        if size:
            u, flag = _program(np.eye(size), a[keep], below, above)
            if flag > 0:
                return start + free @ u, gave
        # a u + s within the bounds, least s: −s is how far a u is beyond them.
        weight = np.diag(np.concatenate((np.full(size, _SOFTLY), np.ones(m))))
        z, flag = _program(weight, np.hstack((a[keep], np.eye(m))), below, above)
        if flag <= 0 or not np.isfinite(z).all():
            raise ArithmeticError("no least violation of the constraints was found")
        gave[keep] = -z[size:]
        return start + free @ z[:size], np.where(np.abs(gave) > _NEGLIGIBLE, gave, 0.0)

    def _blocked(self, gave: Array) -> tuple[Blocked, ...]:
        """What had to give, the worst of each constraint, in order of how much that is to the robot."""
        found: dict[str, Blocked] = {}
        for i in np.argsort(-np.abs(gave)):
            if gave[i] == 0.0:
                break
            title, unit = self._body.bound_title(int(i))
            found.setdefault(title, Blocked(title, float(abs(gave[i]) * self._length[i]), unit))
        return tuple(found.values())


def _complement(basis: Array) -> Array:
    """(n, n − k): an orthonormal basis of what k orthonormal rows leave."""
    if not len(basis):
        return np.eye(basis.shape[1])
    q, _ = np.linalg.qr(basis.T, mode="complete")
    return q[:, len(basis) :]


def _program(h: Array, a: Array, lower: Array, upper: Array) -> tuple[Array, int]:
    """(x, daqp's flag, positive where it is solved) of min ½ xᵀ h x, lower ≤ a x ≤ upper."""
    x, _, flag, _ = daqp.solve(
        h,
        np.zeros(len(h)),
        np.ascontiguousarray(a),
        np.clip(upper, -_INFINITE, _INFINITE),
        np.clip(lower, -_INFINITE, _INFINITE),
        np.zeros(len(lower), np.int32),
        primal_tol=1e-10,
    )
    return x, flag
