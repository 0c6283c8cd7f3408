"""One compiled call for all rows of a problem: values, Jacobian, and the quadratic program's bounds at a configuration.

Reads pinocchio's memory where the last kinematics pass left it: joint placements (rotation by columns, translation) and the joint
Jacobian in world axes (linear velocity of what is at the world's origin, angular velocity). A row's derivative is worked out only
for the velocities that move its frames. Formulas: Sola, Deray, Atchuthan 2018 (A micro Lie theory) for logarithms and their
Jacobians.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from handrail.compiled import compiled

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

POINT, COM, TURN, ANGLE, ALIGN, CONE, GAZE, DISTANCE, EDGE, POSTURE, PAIR = range(11)
"""Kinds of items. TURN has three rows, ALIGN two; ANGLE, CONE and GAZE have SIDES, all others one."""
SIDES = 6
"""rows of a bound on an angle: sides of a polygon about the cone, of a cube about the ball, the first where the angle itself is"""

_POINT, _TURN, _COM = range(3)
"""kinds of terms of a derivative"""
KIND, JOINT_A, JOINT_B, ROW = range(4)
INTEGERS = 4
"""columns of an item's integers"""
PLACE_A, PLACE_B, VECTOR, OTHER = 0, 12, 24, 36
NUMBERS = 48
"""columns of an item's numbers: frame A on its joint, frame B on its own (both rotation by columns, translation), vectors"""


@njit(error_model="numpy")
def _pose(placement: Array, joint: int, local: Array, at: int, pose: Array) -> None:
    """A frame in the world (12,): rotation by columns, translation."""
    for column in range(4):
        for a in range(3):
            total = placement[joint, 9 + a] if column == 3 else 0.0
            for b in range(3):
                total += placement[joint, 3 * b + a] * local[at + 3 * column + b]
            pose[3 * column + a] = total


@njit(error_model="numpy")
def _rotate(pose: Array, v: Array, at: int, out: Array) -> None:
    for a in range(3):
        out[a] = pose[a] * v[at] + pose[3 + a] * v[at + 1] + pose[6 + a] * v[at + 2]


@njit(error_model="numpy")
def _log(e: Array, log: Array) -> float:
    """Rotation vector of a rotation (3, 3), by its quaternion, which is sound up to π; returns its length."""
    trace = e[0, 0] + e[1, 1] + e[2, 2]
    if trace > 0.0:
        s = 2.0 * np.sqrt(1.0 + trace)
        w, x, y, z = 0.25 * s, (e[2, 1] - e[1, 2]) / s, (e[0, 2] - e[2, 0]) / s, (e[1, 0] - e[0, 1]) / s
    elif e[0, 0] > e[1, 1] and e[0, 0] > e[2, 2]:
        s = 2.0 * np.sqrt(1.0 + e[0, 0] - e[1, 1] - e[2, 2])
        w, x, y, z = (e[2, 1] - e[1, 2]) / s, 0.25 * s, (e[0, 1] + e[1, 0]) / s, (e[0, 2] + e[2, 0]) / s
    elif e[1, 1] > e[2, 2]:
        s = 2.0 * np.sqrt(1.0 + e[1, 1] - e[0, 0] - e[2, 2])
        w, x, y, z = (e[0, 2] - e[2, 0]) / s, (e[0, 1] + e[1, 0]) / s, 0.25 * s, (e[1, 2] + e[2, 1]) / s
    else:
        s = 2.0 * np.sqrt(1.0 + e[2, 2] - e[0, 0] - e[1, 1])
        w, x, y, z = (e[1, 0] - e[0, 1]) / s, (e[0, 2] + e[2, 0]) / s, (e[1, 2] + e[2, 1]) / s, 0.25 * s
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    length = np.sqrt(x * x + y * y + z * z)
    angle = 2.0 * np.arctan2(length, w)
    factor = 2.0 if length < 1e-9 else angle / length
    log[0], log[1], log[2] = factor * x, factor * y, factor * z
    return angle


@njit(error_model="numpy")
def _cone(a: Array, d: Array, n: Array) -> float:
    """Angle from unit a to unit d, and the unit axis n of that turn; any axis across them where they are (anti)parallel."""
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        n[k] = a[i] * d[j] - a[j] * d[i]
    sine = np.sqrt(n[0] ** 2 + n[1] ** 2 + n[2] ** 2)
    cosine = a[0] * d[0] + a[1] * d[1] + a[2] * d[2]
    if sine < 1e-9:
        least = 0
        for k in range(1, 3):
            if abs(a[k]) < abs(a[least]):
                least = k
        i, j = (least + 1) % 3, (least + 2) % 3
        length = np.sqrt(a[i] ** 2 + a[j] ** 2)
        n[least], n[i], n[j] = 0.0, -a[j] / length, a[i] / length
    else:
        for k in range(3):
            n[k] /= sine
    return np.arctan2(sine, cosine)


@compiled(error_model="numpy")
def rows(
    integers: Integers, numbers: Array, relations: Array, placement: Array, jacobian: Array, com: Array, com_jacobian: Array,
    support: Integers, slot: Integers, coordinates: Array, value: Array, matrix: Array,
) -> None:  # fmt: skip
    """Values (rows,) and Jacobian (rows, columns) of all items, in metres and radians.

    `com_jacobian` (nv, 3); `coordinates` (nv,) of the joints, for `relations` (items, nv); `slot` (nv,): the column of each
    velocity, -1: it does not move. An item's derivative is a sum of terms, each n · (velocity of a point that goes with a joint),
    or n · (angular velocity of a joint's body), or n · (velocity of the centre of mass).
    """
    pose_a, pose_b = np.empty(12), np.empty(12)
    n, p, q, log = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    e = np.empty((3, 3))
    terms, where, basis = (
        np.empty((3 * SIDES, 6)),
        np.empty((3 * SIDES, 3), np.int64),
        np.empty((3, 3)),
    )  # [n, point], [row, joint, what]
    for item in range(integers.shape[0]):
        kind, ja, jb, r = integers[item, KIND], integers[item, JOINT_A], integers[item, JOINT_B], integers[item, ROW]
        x = numbers[item]
        count = 0
        if kind == POSTURE:
            total = 0.0
            for c in range(slot.shape[0]):
                total += relations[item, c] * coordinates[c]
                if slot[c] >= 0:
                    matrix[r, slot[c]] = relations[item, c]
            value[r] = total
            continue
        if (
            kind == PAIR
        ):  # two points in the world, on bodies: VECTOR, OTHER; from the first to the second along PLACE_A
            value[r] = x[PLACE_B]
            for a in range(3):
                terms[0, a], terms[0, 3 + a] = x[PLACE_A + a], x[OTHER + a]
                terms[1, a], terms[1, 3 + a] = -x[PLACE_A + a], x[VECTOR + a]
            where[0, 0], where[0, 1], where[0, 2] = r, jb, _POINT
            where[1, 0], where[1, 1], where[1, 2] = r, ja, _POINT
            count = 2
        else:
            _pose(placement, ja, x, PLACE_A, pose_a)
            _pose(placement, jb, x, PLACE_B, pose_b)
        if kind in (POINT, COM):
            _rotate(pose_b, x, VECTOR, n)
            total = 0.0
            for a in range(3):
                p[a] = com[a] if kind == COM else pose_a[9 + a]
                total += n[a] * (p[a] - pose_b[9 + a])
                terms[0, a], terms[0, 3 + a], terms[1, a], terms[1, 3 + a] = n[a], p[a], -n[a], p[a]
            value[r] = total
            where[0, 0], where[0, 1], where[0, 2] = r, ja, _COM if kind == COM else _POINT
            where[1, 0], where[1, 1], where[1, 2] = r, jb, _POINT
            count = 2
        elif kind in (TURN, ANGLE):
            for a in range(3):
                for b in range(3):
                    total = 0.0
                    for k in range(3):
                        total += pose_b[3 * a + k] * pose_a[3 * b + k]
                    e[a, b] = total
            angle = _log(e, log)
            # Rows of the inverse of the right Jacobian: I + [log]/2 + bend [log]², [log]² = log logᵀ − angle² I.
            bend = 1.0 / 12.0
            if angle > 1e-4:
                bend = 1.0 / angle**2 - 1.0 / (2.0 * angle * np.tan(angle / 2.0))
            if kind == ANGLE:
                _basis(log, basis)
            for i in range(3 if kind == TURN else SIDES):
                for j in range(3):
                    q[j] = (1.0 if i == j else 0.0) if kind == TURN else _side(basis, i, j)
                along = q[0] * log[0] + q[1] * log[1] + q[2] * log[2]
                for j in range(3):
                    k, m = (j + 1) % 3, (j + 2) % 3
                    p[j] = (
                        q[j] * (1.0 - bend * angle**2) + bend * along * log[j] + 0.5 * (q[k] * log[m] - q[m] * log[k])
                    )
                value[r + i] = along
                _rotate(pose_a, p, 0, n)
                for a in range(3):
                    terms[count, a], terms[count + 1, a] = n[a], -n[a]
                where[count, 0], where[count, 1], where[count, 2] = r + i, ja, _TURN
                where[count + 1, 0], where[count + 1, 1], where[count + 1, 2] = r + i, jb, _TURN
                count += 2
        elif kind in (ALIGN, CONE, GAZE):
            _rotate(pose_a, x, VECTOR, p)
            distance = 1.0
            if kind == GAZE:
                total = 0.0
                for a in range(3):
                    q[a] = pose_b[9 + a] - pose_a[9 + a]
                    total += q[a] ** 2
                distance = max(np.sqrt(total), 1e-6)
                for a in range(3):
                    q[a] /= distance
            else:
                _rotate(pose_b, x, OTHER, q)
            angle = _cone(p, q, n)
            # w = angle · n lies across q. Its coordinates on directions across q, which go with it: two of frame B's where w is to
            # be 0; where it is to be no longer than the cone is wide, its own and others around, so that a step that turns
            # it knows the cone's other sides.
            if kind == ALIGN:
                _across(pose_b, x, e)
            sine, cosine = np.sin(angle), np.cos(angle)
            stretch = 1.0 if sine < 1e-6 else angle / sine
            for i in range(2 if kind == ALIGN else SIDES):
                along, dot = 0.0, 0.0
                for a in range(3):
                    if kind == ALIGN:
                        log[a] = e[i, a]
                    else:
                        k, m = (a + 1) % 3, (a + 2) % 3
                        turn = 2.0 * np.pi * i / SIDES
                        log[a] = np.cos(turn) * n[a] + np.sin(turn) * (q[k] * n[m] - q[m] * n[k])
                    along += log[a] * n[a]
                    dot += log[a] * p[a]
                value[r + i] = angle * along
                # The sine's part: δ(a × d) = (ω × a) × d = a (ω·d) − ω (a·d); and how the stretch changes.
                change = 0.0 if sine < 1e-6 else (1.0 - stretch * cosine) * along
                for a in range(3):
                    terms[count, a] = stretch * (dot * q[a] - cosine * log[a]) - change * n[a]
                    terms[count + 1, a] = -terms[count, a]
                where[count, 0], where[count, 1], where[count, 2] = r + i, ja, _TURN
                where[count + 1, 0], where[count + 1, 1], where[count + 1, 2] = r + i, jb, _TURN
                count += 2
                if kind == GAZE:  # the direction turns as target and origin move across it: t · (q × v) = v · (t × q)
                    for a in range(3):
                        k, m = (a + 1) % 3, (a + 2) % 3
                        terms[count, a] = (terms[count - 2, k] * q[m] - terms[count - 2, m] * q[k]) / distance
                        terms[count - 1, a] = -terms[count, a]
                        terms[count - 1, 3 + a], terms[count, 3 + a] = pose_b[9 + a], pose_a[9 + a]
                    where[count - 1, 2] = _POINT
                    where[count, 0], where[count, 1], where[count, 2] = r + i, ja, _POINT
                    count += 1
        elif kind == DISTANCE:
            total = 0.0
            for a in range(3):
                q[a] = pose_b[9 + a] - pose_a[9 + a]
                total += q[a] ** 2
            distance = np.sqrt(total)
            value[r] = distance
            for a in range(3):
                terms[0, a] = q[a] / max(distance, 1e-9)
                terms[1, a] = -terms[0, a]
                terms[0, 3 + a], terms[1, 3 + a] = pose_b[9 + a], pose_a[9 + a]
            where[0, 0], where[0, 1], where[0, 2] = r, jb, _POINT
            where[1, 0], where[1, 1], where[1, 2] = r, ja, _POINT
            count = 2
        elif (
            kind == EDGE
        ):  # signed distance of the centre of mass, seen from above, to the left of the line from A to B
            dx, dy = pose_b[9] - pose_a[9], pose_b[10] - pose_a[10]
            length = max(np.sqrt(dx * dx + dy * dy), 1e-9)
            n[0], n[1], n[2] = -dy / length, dx / length, 0.0
            cx, cy = com[0] - pose_a[9], com[1] - pose_a[10]
            value[r] = n[0] * cx + n[1] * cy
            share = (cx * dx + cy * dy) / length**2
            for a in range(3):
                terms[0, a], terms[1, a], terms[2, a] = n[a], (share - 1.0) * n[a], -share * n[a]
                terms[1, 3 + a], terms[2, 3 + a] = pose_a[9 + a], pose_b[9 + a]
            where[0, 0], where[0, 1], where[0, 2] = r, 0, _COM
            where[1, 0], where[1, 1], where[1, 2] = r, ja, _POINT
            where[2, 0], where[2, 1], where[2, 2] = r, jb, _POINT
            count = 3
        last = -1
        for t in range(count):
            row, joint, what = where[t, 0], where[t, 1], where[t, 2]
            if row > last:
                for c in range(matrix.shape[1]):
                    matrix[row, c] = 0.0
                last = row
            n0, n1, n2 = terms[t, 0], terms[t, 1], terms[t, 2]
            if what == _COM:
                for c in range(slot.shape[0]):
                    if slot[c] >= 0:
                        matrix[row, slot[c]] += (
                            n0 * com_jacobian[c, 0] + n1 * com_jacobian[c, 1] + n2 * com_jacobian[c, 2]
                        )
                continue
            if what == _TURN:
                m0, m1, m2, n0, n1, n2 = n0, n1, n2, 0.0, 0.0, 0.0
            else:  # n · (v + ω × p) = n · v + (p × n) · ω
                p0, p1, p2 = terms[t, 3], terms[t, 4], terms[t, 5]
                m0, m1, m2 = p1 * n2 - p2 * n1, p2 * n0 - p0 * n2, p0 * n1 - p1 * n0
            for k in range(1, support[joint, 0] + 1):
                c = support[joint, k]
                if slot[c] >= 0:
                    linear = n0 * jacobian[c, 0] + n1 * jacobian[c, 1] + n2 * jacobian[c, 2]
                    angular = m0 * jacobian[c, 3] + m1 * jacobian[c, 4] + m2 * jacobian[c, 5]
                    matrix[row, slot[c]] += linear + angular


@njit(error_model="numpy")
def _basis(log: Array, basis: Array) -> None:
    """Rows: the direction of a vector, and two across it."""
    length = np.sqrt(log[0] ** 2 + log[1] ** 2 + log[2] ** 2)
    for a in range(3):
        basis[0, a] = log[a] / length if length > 1e-12 else (1.0 if a == 0 else 0.0)
        basis[1, a] = 0.0
    d0, d1, d2 = basis[0, 0], basis[0, 1], basis[0, 2]
    if abs(d0) <= abs(d1) and abs(d0) <= abs(d2):
        basis[1, 1], basis[1, 2] = -d2, d1
    elif abs(d1) <= abs(d2):
        basis[1, 0], basis[1, 2] = d2, -d0
    else:
        basis[1, 0], basis[1, 1] = -d1, d0
    across = np.sqrt(basis[1, 0] ** 2 + basis[1, 1] ** 2 + basis[1, 2] ** 2)
    for a in range(3):
        basis[1, a] /= across
    for a in range(3):
        k, m = (a + 1) % 3, (a + 2) % 3
        basis[2, a] = basis[0, k] * basis[1, m] - basis[0, m] * basis[1, k]


@njit(error_model="numpy")
def _side(basis: Array, side: int, axis: int) -> float:
    """A coordinate of the side's normal: the basis' vectors, then those the other way."""
    return basis[side, axis] if side < 3 else -basis[side - 3, axis]


@njit(error_model="numpy")
def _across(pose_b: Array, x: Array, e: Array) -> None:
    """Two unit vectors across the direction OTHER of frame B, in the world: rows 0 and 1 of e. They go with B."""
    basis = np.empty((3, 3))
    _basis(x[OTHER : OTHER + 3], basis)
    for i in range(2):
        _rotate(pose_b, basis[i + 1], 0, e[i])


@compiled(error_model="numpy")
def program(
    value: Array, lower: Array, upper: Array, weight: Array, matrix: Array, coordinates: Array, low: Array, high: Array,
    columns: Integers, away: Array, cost: Array, trust: float, gradient: Array, below: Array, above: Array,
) -> tuple[float, float]:  # fmt: skip
    """Rows times their weight (in place), the step's bounds [columns, rows] and the cost's gradient; (violation, cost).

    Violation: the Euclidean norm over rows of what bounds are missed by, times weight. Cost: ½ Σ cost · away². `low`, `high`,
    `coordinates`, `away`, `cost` are (nv,).
    """
    n, m = columns.shape[0], value.shape[0]
    total, spent = 0.0, 0.0
    for k in range(n):
        c = columns[k]
        gradient[k] = cost[c] * away[c]
        spent += 0.5 * cost[c] * away[c] ** 2
        below[k] = max(-trust, min(low[c] - coordinates[c], 0.0))
        above[k] = min(trust, max(high[c] - coordinates[c], 0.0))
    for r in range(m):
        w = weight[r]
        total += (w * max(lower[r] - value[r], value[r] - upper[r], 0.0)) ** 2
        below[n + r] = w * (lower[r] - value[r])
        above[n + r] = w * (upper[r] - value[r])
        for k in range(n):
            matrix[r, k] *= w
    return np.sqrt(total), spent


@compiled(error_model="numpy")
def block(
    value: Array, lower: Array, upper: Array, weight: Array, rows: Array, count: int, change: Array, matrix: Array,
    first: int, column: int, below: Array, above: Array, size: int,
) -> float:  # fmt: skip
    """One knot's rows (count, n) times their weight, as rows of a trajectory's matrix from `first` on and columns from `column` on.

    `change` (b, b) turns the first b columns' velocities into what they are there; bounds go behind those of the `size` columns.
    Returns the sum of the squares of what bounds are missed by, times weight.
    """
    n, b, total = rows.shape[1], change.shape[0], 0.0
    for r in range(count):
        w, here = weight[r], first + r
        total += (w * max(lower[r] - value[r], value[r] - upper[r], 0.0)) ** 2
        below[size + here] = w * (lower[r] - value[r])
        above[size + here] = w * (upper[r] - value[r])
        for c in range(matrix.shape[1]):
            matrix[here, c] = 0.0
        for c in range(b):
            entry = 0.0
            for k in range(b):
                entry += rows[r, k] * change[k, c]
            matrix[here, column + c] = w * entry
        for c in range(b, n):
            matrix[here, column + c] = w * rows[r, c]
    return total


@compiled(error_model="numpy")
def near_pairs(
    placement: Array, centres: Array, radii: Array, pairs: Integers, reach: float, balls: Array, found: Integers
) -> int:
    """How many pairs' balls are within `reach` m; their numbers in `found`. `balls` (bodies, 3) is scratch."""
    for body in range(centres.shape[0]):
        for a in range(3):
            balls[body, a] = placement[body, 9 + a]
            for b in range(3):
                balls[body, a] += placement[body, 3 * b + a] * centres[body, b]
    count = 0
    for pair in range(pairs.shape[0]):
        a, b = pairs[pair, 0], pairs[pair, 1]
        apart = (balls[a, 0] - balls[b, 0]) ** 2 + (balls[a, 1] - balls[b, 1]) ** 2 + (balls[a, 2] - balls[b, 2]) ** 2
        limit = radii[a] + radii[b] + reach
        if limit > 0.0 and apart < limit * limit:
            found[count] = pair
            count += 1
    return count
