"""Compiled: one pass over a model at a state, into pinocchio's own memory: what its composite-rigid-body algorithm in world axes
and its Newton-Euler at zero acceleration leave there, together and without a call of either.

Velocities, accelerations and forces are in each joint's own axes, as pinocchio has them; Jacobian and composite inertias in the
world's, these about its origin, where they add up. Featherstone 2008, chapters 5, 6.
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
from numba import njit

from daemon.wbc.memory import Array, Integers, fill, line, matrix, vector
from daemon.wbc.vectors import (
    FAST,
    add,
    by_columns,
    cross,
    dot,
    minus,
    nine,
    product,
    put,
    rotate,
    rotate_back,
    three,
    times,
)
from handrail.compiled import compiled

NAMES = (
    "mass", "bias", "jacobian", "momentum", "placement", "parent_placement", "velocity", "drift", "force", "com", "state",
    "q", "v", "body", "composite",
)  # fmt: skip
"""What a pass leaves behind, in its table's order: pinocchio's M, nle, J, Ag, oMi, liMi, v, a_gf, f, oYcrb[0].lever; where it was,
(2, nv). What it takes: pinocchio's q (1, nq), v (1, nv), and `bodies`. Scratch: (joints, INERTIA_WIDTH)."""
(
    MASS, BIAS, JACOBIAN, MOMENTUM, PLACEMENT, PARENT_PLACEMENT, VELOCITY, DRIFT, FORCE, COM, STATE, Q, V, BODY, COMPOSITE,
) = range(len(NAMES))  # fmt: skip
ON_R, ON_P, AXIS, TURNS, WEIGHS, LEVER, INERTIA, ARMATURE, BODY_WIDTH = 0, 9, 12, 15, 16, 17, 20, 26, 27
"""Columns of a body: where its joint is on its parent, the joint's axis, 1 where it turns about it; the body's mass, where its
centre is, its inertia about that (xx xy yy xz yz zz); the motor's. The world's row begins with gravity."""
PARENT, FIRST, JOINT, CHAIN = 0, 1, 2, 3
"""Columns of a tree: a joint's parent, its first velocity, its place among the robot's joints (−1: none), then how many velocities
move its body, and which, from the root on."""
INERTIA_WIDTH = 10
"""mass, mass times centre, inertia about the world's origin (xx xy yy xz yz zz)"""
_FREE = 6


def bodies(model: pin.Model) -> Array:
    """(joints, BODY_WIDTH) of a model."""
    table = np.zeros((model.njoints, BODY_WIDTH))
    table[0, :3] = model.gravity.linear
    for j in range(1, model.njoints):
        row, i = table[j], model.idx_vs[j]
        put_body(row, model.jointPlacements[j], model.inertias[j])
        if model.nvs[j] == 1:
            motion = np.asarray(model.joints[j].createData().S).ravel()
            row[TURNS] = motion[3:].any()
            row[AXIS : AXIS + 3] = motion[3:] if row[TURNS] else motion[:3]
            row[ARMATURE] = model.armature[i]
    return table


def put_body(row: Array, placement: pin.SE3, inertia: pin.Inertia) -> None:
    """A body's columns but those of its axis: where its joint is on its parent, and what it weighs."""
    row[ON_R : ON_R + 9], row[ON_P : ON_P + 3] = placement.rotation.ravel(), placement.translation
    row[WEIGHS], row[LEVER : LEVER + 3] = inertia.mass, inertia.lever
    row[INERTIA : INERTIA + 6] = inertia.inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]


def tree(model: pin.Model, rows: Integers) -> Integers:
    """(joints, CHAIN + 1 + nv) of a model; rows (n,): which velocity each of the robot's joints has."""
    table = np.zeros((model.njoints, CHAIN + 1 + model.nv), np.int64)
    for j in range(1, model.njoints):
        chain = [c for i in model.supports[j] if i for c in range(model.idx_vs[i], model.idx_vs[i] + model.nvs[i])]
        places = np.flatnonzero(rows == model.idx_vs[j])
        table[j, :CHAIN] = model.parents[j], model.idx_vs[j], places[0] if len(places) else -1
        table[j, CHAIN], table[j, CHAIN + 1 : CHAIN + 1 + len(chain)] = len(chain), chain
    return table


@compiled(fastmath=FAST, error_model="numpy")
def place(position, velocity, base_pose, base_twist, table, tree):  # type: ignore[no-untyped-def]
    """Take a state, and make the pass: see `WholeBodyModel.place`. tree[0, FIRST]: 1 where the base is free."""
    state, q, v = matrix(table, STATE), vector(table, Q), vector(table, V)
    free, joints = tree[0, FIRST] > 0, tree.shape[0]
    first = 2 if free else 1
    ahead = q.shape[0] - v.shape[0]
    if free:
        for i in range(7):
            q[i] = base_pose[i]
        for i in range(6):
            v[i] = state[1, i] = base_twist[i]
    for j in range(first, joints):
        c, i = tree[j, FIRST], tree[j, JOINT]
        q[c + ahead] = state[0, c] = position[i]
        v[c] = state[1, c] = velocity[i]
    _outwards(table, tree, q, v, free, ahead)
    _inwards(table, tree)


@njit(fastmath=FAST, error_model="numpy")
def _outwards(table, tree, q, v, free, ahead):  # type: ignore[no-untyped-def]
    """Placements, velocities, drift, the forces that they take, columns of the Jacobian, and each body's own inertia."""
    body, jacobian, composite = matrix(table, BODY), matrix(table, JACOBIAN), matrix(table, COMPOSITE)
    velocities, drifts = matrix(table, VELOCITY), matrix(table, DRIFT)
    fill(velocities[0], 0.0)
    fill(composite[0], 0.0)
    fill(drifts[0], 0.0)
    put(drifts[0], 0, times(-1.0, three(body[0], 0)))
    for j in range(1, tree.shape[0]):
        known, parent, c = body[j], tree[j, PARENT], tree[j, FIRST]
        r, p, axis, turns = nine(known, ON_R), three(known, ON_P), three(known, AXIS), known[TURNS] > 0.0
        if free and j == 1:
            r, p = product(r, _turn_of(q[3], q[4], q[5], q[6])), add(p, rotate(r, (q[0], q[1], q[2])))
        elif turns:
            r = product(r, turned(axis, q[c + ahead]))
        else:
            p = add(p, rotate(r, times(q[c + ahead], axis)))
        on_parent, place = line(table, PARENT_PLACEMENT, j), line(table, PLACEMENT, j)
        put_placement(on_parent, r, p)
        above = velocities[parent]
        linear, angular = three(above, 0), three(above, 3)
        linear, angular = rotate_back(r, add(linear, cross(angular, p))), rotate_back(r, angular)
        above = drifts[parent]
        drift, spin = three(above, 0), three(above, 3)
        drift, spin = rotate_back(r, add(drift, cross(spin, p))), rotate_back(r, spin)
        if parent:
            above = line(table, PLACEMENT, parent)
            up = by_columns(above)
            r, p = product(up, r), add(three(above, 9), rotate(up, p))
        put_placement(place, r, p)
        if free and j == 1:
            linear, angular = (v[0], v[1], v[2]), (v[3], v[4], v[5])
            for i in range(3):
                side = (r[i], r[3 + i], r[6 + i])
                put(jacobian[i], 0, side)
                put(jacobian[i], 3, (0.0, 0.0, 0.0))
                put(jacobian[3 + i], 0, cross(p, side))
                put(jacobian[3 + i], 3, side)
        else:
            own, along = times(v[c], axis), rotate(r, axis)
            if turns:
                drift, spin = add(drift, cross(linear, own)), add(spin, cross(angular, own))
                angular = add(angular, own)
                put(jacobian[c], 0, cross(p, along))
                put(jacobian[c], 3, along)
            else:
                drift = add(drift, cross(angular, own))
                linear = add(linear, own)
                put(jacobian[c], 0, along)
                put(jacobian[c], 3, (0.0, 0.0, 0.0))
        put(velocities[j], 0, linear)
        put(velocities[j], 3, angular)
        put(drifts[j], 0, drift)
        put(drifts[j], 3, spin)
        put_force(line(table, FORCE, j), known, linear, angular, drift, spin)
        _put_inertia(composite[j], known, r, p)


@njit(fastmath=FAST, error_model="numpy")
def _inwards(table, tree):  # type: ignore[no-untyped-def]
    """Bias and mass matrix: forces and inertias added up from the leaves to the root."""
    body, jacobian, momentum = matrix(table, BODY), matrix(table, JACOBIAN), matrix(table, MOMENTUM)
    mass, bias, composite = matrix(table, MASS), vector(table, BIAS), matrix(table, COMPOSITE)
    forces = matrix(table, FORCE)
    for j in range(tree.shape[0] - 1, 0, -1):
        known, parent, c, chain = body[j], tree[j, PARENT], tree[j, FIRST], tree[j, CHAIN]
        force, moment = three(forces[j], 0), three(forces[j], 3)
        last = c + 1
        if tree[j, JOINT] < 0:  # a free base
            last = c + _FREE
            put(bias, c, force)
            put(bias, c + 3, moment)
        else:
            bias[c] = dot(three(known, AXIS), moment if known[TURNS] > 0.0 else force)
        if parent:
            on_parent, above = line(table, PARENT_PLACEMENT, j), forces[parent]
            r = by_columns(on_parent)
            force = rotate(r, force)
            moment = add(rotate(r, moment), cross(three(on_parent, 9), force))
            put(above, 0, add(three(above, 0), force))
            put(above, 3, add(three(above, 3), moment))
        inertia = composite[j]
        for i in range(c, last):
            row, column = momentum[i], jacobian[i]
            _put_momentum(row, inertia, three(column, 0), three(column, 3))
            for s in range(1, chain - last + i + 2):
                k = tree[j, CHAIN + s]
                mass[i, k] = dot(three(jacobian[k], 0), three(row, 0)) + dot(three(jacobian[k], 3), three(row, 3))
        if last == c + 1:
            mass[c, c] += known[ARMATURE]
        above = composite[parent]
        for i in range(10):
            above[i] += inertia[i]
    whole = composite[0]
    com = times(1.0 / whole[0], three(whole, 1))
    put(vector(table, COM), 0, com)
    for i in range(momentum.shape[0]):  # from the world's origin to the centre of mass
        row = momentum[i]
        put(row, 3, minus(three(row, 3), cross(com, three(row, 0))))


@njit(fastmath=FAST, error_model="numpy")
def turned(axis, angle):  # type: ignore[no-untyped-def]
    """exp(angle · axis), of a unit axis (Rodrigues)."""
    s, c = math.sin(angle), math.cos(angle)
    x, y, z = axis
    d = 1.0 - c
    return (
        c + d * x * x, d * x * y - s * z, d * x * z + s * y,
        d * x * y + s * z, c + d * y * y, d * y * z - s * x,
        d * x * z - s * y, d * y * z + s * x, c + d * z * z,
    )  # fmt: skip


@njit(fastmath=FAST, error_model="numpy")
def _turn_of(x, y, z, w):  # type: ignore[no-untyped-def]
    """A unit quaternion's rotation."""
    return (
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y),
        2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x),
        2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y),
    )  # fmt: skip


@njit(fastmath=FAST, error_model="numpy")
def put_placement(row, r, p):  # type: ignore[no-untyped-def]
    for i in range(3):
        row[i], row[3 + i], row[6 + i] = r[3 * i], r[3 * i + 1], r[3 * i + 2]
    put(row, 9, p)


@njit(fastmath=FAST, error_model="numpy")
def _symmetric(row, first, w):  # type: ignore[no-untyped-def]
    """S w, S by its xx xy yy xz yz zz."""
    xx, xy, yy, xz, yz, zz = row[first], row[first + 1], row[first + 2], row[first + 3], row[first + 4], row[first + 5]
    return (
        xx * w[0] + xy * w[1] + xz * w[2],
        xy * w[0] + yy * w[1] + yz * w[2],
        xz * w[0] + yz * w[1] + zz * w[2],
    )


@njit(fastmath=FAST, error_model="numpy")
def put_force(row, known, linear, angular, drift, spin):  # type: ignore[no-untyped-def]
    """I a + v ×* I v of a body, about its joint's origin."""
    mass, lever = known[WEIGHS], three(known, LEVER)
    push = times(mass, add(linear, cross(angular, lever)))
    turn = add(_symmetric(known, INERTIA, angular), cross(lever, push))
    force = times(mass, add(drift, cross(spin, lever)))
    moment = add(_symmetric(known, INERTIA, spin), cross(lever, force))
    put(row, 0, add(force, cross(angular, push)))
    put(row, 3, add(moment, add(cross(angular, turn), cross(linear, push))))


@njit(fastmath=FAST, error_model="numpy")
def _put_inertia(row, known, r, p):  # type: ignore[no-untyped-def]
    """A body's mass, mass times centre, and inertia about the world's origin, its axes: R I Rᵀ + m (c·c 1 − c cᵀ)."""
    mass = known[WEIGHS]
    c = add(p, rotate(r, three(known, LEVER)))
    x = rotate(r, _symmetric(known, INERTIA, (r[0], r[1], r[2])))
    y = rotate(r, _symmetric(known, INERTIA, (r[3], r[4], r[5])))
    z = rotate(r, _symmetric(known, INERTIA, (r[6], r[7], r[8])))
    square = mass * dot(c, c)
    h = times(mass, c)
    row[0] = mass
    put(row, 1, h)
    row[4], row[5], row[6] = x[0] + square - h[0] * c[0], x[1] - h[0] * c[1], y[1] + square - h[1] * c[1]
    row[7], row[8], row[9] = x[2] - h[0] * c[2], y[2] - h[1] * c[2], z[2] + square - h[2] * c[2]


@njit(fastmath=FAST, error_model="numpy")
def _put_momentum(row, inertia, linear, angular):  # type: ignore[no-untyped-def]
    """Of a composite inertia that moves, about the world's origin."""
    h = three(inertia, 1)
    put(row, 0, minus(times(inertia[0], linear), cross(h, angular)))
    put(row, 3, add(cross(h, linear), _symmetric(inertia, 4, angular)))
