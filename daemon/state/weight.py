"""Compiled: the torques that carry a robot's weight, in one walk from the root to the leaves and back."""

from __future__ import annotations

import pinocchio as pin

from daemon.wbc import dynamics
from daemon.wbc.dynamics import AXIS, FIRST, JOINT, LEVER, ON_P, ON_R, PARENT, TURNS, WEIGHS, turned
from daemon.wbc.memory import Array, Integers, Memory, fill, matrix, vector
from daemon.wbc.vectors import FAST, add, cross, dot, minus, nine, product, put, rotate, three, times
from handrail.compiled import compiled

_NAMES = ("body", "gravity", "placed", "weight")
_BODY, _GRAVITY, _PLACED, _WEIGHT = range(len(_NAMES))


class Weight:
    """Of one robot's model, whose gravity may change."""

    def __init__(self, model: pin.Model, rows: Integers):
        """`rows` (n,): which velocity each of the robot's joints has."""
        self._memory = Memory(_NAMES)
        self._memory.hold(model)
        self._memory.put("body", dynamics.bodies(model))
        self._memory.put("gravity", model.gravity.linear.reshape(1, 3))
        self._memory.make("placed", model.njoints, 12)
        self._memory.make("weight", model.njoints, 4)
        self._tree = dynamics.tree(model, rows)

    def carry(self, q: Array, torque: Array) -> None:
        """`torque` (n,) ← N·m, N that hold the joints still at a configuration."""
        _carry(q, self._memory.table, self._tree, torque)


@compiled(fastmath=FAST, error_model="numpy")
def _carry(q, table, tree, torque):  # type: ignore[no-untyped-def]
    """By joint, in the world's axes: −g · (a × (Σ m c − p Σ m)) over all that it carries, or −g · a Σ m along its axis."""
    body, placed, weight = matrix(table, _BODY), matrix(table, _PLACED), matrix(table, _WEIGHT)
    down = times(-1.0, three(vector(table, _GRAVITY), 0))
    put(placed[0], 0, (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0))
    put(placed[0], 9, (0.0, 0.0, 0.0))
    fill(weight[0], 0.0)
    for j in range(1, tree.shape[0]):
        known, above, angle = body[j], placed[tree[j, PARENT]], q[tree[j, FIRST]]
        up, axis = nine(above, 0), three(known, AXIS)
        r, p = product(up, nine(known, ON_R)), add(three(above, 9), rotate(up, three(known, ON_P)))
        if known[TURNS] > 0.0:
            r = product(r, turned(axis, angle))
        else:
            p = add(p, rotate(r, times(angle, axis)))
        put(placed[j], 0, r)
        put(placed[j], 9, p)
        weight[j, 0] = known[WEIGHS]
        put(weight[j], 1, times(known[WEIGHS], add(p, rotate(r, three(known, LEVER)))))
    for j in range(tree.shape[0] - 1, 0, -1):
        known, place, mine, above, i = body[j], placed[j], weight[j], weight[tree[j, PARENT]], tree[j, JOINT]
        if i >= 0:
            axis, mass, moment = rotate(nine(place, 0), three(known, AXIS)), mine[0], three(mine, 1)
            if known[TURNS] > 0.0:
                torque[i] = dot(down, cross(axis, minus(moment, times(mass, three(place, 9)))))
            else:
                torque[i] = mass * dot(down, axis)
        for k in range(4):
            above[k] += mine[k]
