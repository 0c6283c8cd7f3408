"""Compiled: what each kind of task asks of x = (q̈, f), as rows and wanted values, from pinocchio's memory.

The equations stand at the tasks (tasks.py) and constraints (constraints.py) that these rows are of.
`plan` and `support` are as in layout.py and model.py.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from daemon.wbc import layout as at
from daemon.wbc.memory import fill, line, matrix, vector
from daemon.wbc.vectors import (
    FAST,
    add,
    by_columns,
    cross,
    dot,
    minus,
    nine,
    product,
    rotate,
    rotate_back,
    rotation_vector,
    three,
    times,
    transposed,
)
from handrail.compiled import compiled


@njit(fastmath=FAST, error_model="numpy")
def _point(table, joint, p):  # type: ignore[no-untyped-def]
    """(rotation, position, velocity, drift, angular velocity, angular drift) of a point `p` of a joint's body, world axes.

    Drift is the acceleration at q̈ = 0: of the point R (a + α × p + ω × (v + ω × p)) + g, with pinocchio's a holding −g.
    """
    place = line(table, at.PLACEMENT, joint)
    twist, drift = line(table, at.VELOCITY, joint), line(table, at.DRIFT, joint)
    r = by_columns(place)
    v, w = three(twist, 0), three(twist, 3)
    a, alpha = three(drift, 0), three(drift, 3)
    moved = add(v, cross(w, p))
    local = add(a, add(cross(alpha, p), cross(w, moved)))
    acceleration = rotate(r, local)
    gravity = vector(table, at.SETTINGS)[at.GRAVITY_Z]
    return (
        r,
        add(three(place, 9), rotate(r, p)),
        rotate(r, moved),
        (acceleration[0], acceleration[1], acceleration[2] + gravity),
        rotate(r, w),
        rotate(r, alpha),
    )


@njit(fastmath=FAST, error_model="numpy")
def _linear_row(jacobian, support, joint, point, axis, sign, row):  # type: ignore[no-untyped-def]
    """row += sign · axisᵀ ∂(velocity of the body's point at `point`)/∂v"""
    moment = cross(point, axis)
    for s in range(1, support[joint, 0] + 1):
        c = support[joint, s]
        row[c] += sign * (
            axis[0] * jacobian[c, 0]
            + axis[1] * jacobian[c, 1]
            + axis[2] * jacobian[c, 2]
            + moment[0] * jacobian[c, 3]
            + moment[1] * jacobian[c, 4]
            + moment[2] * jacobian[c, 5]
        )


@njit(fastmath=FAST, error_model="numpy")
def _angular_row(jacobian, support, joint, axis, sign, row):  # type: ignore[no-untyped-def]
    """row += sign · axisᵀ ∂(angular velocity of the body)/∂v"""
    for s in range(1, support[joint, 0] + 1):
        c = support[joint, s]
        row[c] += sign * (axis[0] * jacobian[c, 3] + axis[1] * jacobian[c, 4] + axis[2] * jacobian[c, 5])


@njit(fastmath=FAST, error_model="numpy")
def _pose_rows(table, plan, support, k, rows, wanted, first):  # type: ignore[no-untyped-def]
    """A frame's pose in another frame (0: the world), its axes; the mask says which of x y z and the rotation vector's."""
    jacobian, task = matrix(table, at.JACOBIAN), line(table, at.PARAMETERS, k)
    joint, base, mask = plan[k, at.JOINT], plan[k, at.BASE_JOINT], plan[k, at.MASK]
    r, p, v, a, w, alpha = _point(table, joint, three(task, at.FRAME_P))
    r = product(r, nine(task, at.FRAME_R))
    axes, origin = nine(task, at.BASE_R), three(task, at.BASE_P)
    velocity, drift, spin, spin_drift = v, a, w, alpha
    if base:
        rb, origin, vb, ab, wb, alpha_b = _point(table, base, origin)
        axes = product(rb, axes)
        arm = minus(p, origin)
        velocity = minus(minus(v, vb), cross(wb, arm))
        drift = minus(minus(a, ab), cross(alpha_b, arm))
        drift = minus(drift, cross(wb, add(cross(wb, arm), times(2.0, velocity))))
        spin = minus(w, wb)
        spin_drift = minus(minus(alpha, alpha_b), cross(wb, spin))
    at_row = first
    if mask & 7:
        here = rotate_back(axes, minus(p, origin))
        velocity, drift = rotate_back(axes, velocity), rotate_back(axes, drift)
        for i in range(3):
            if mask & (1 << i):
                axis = (axes[i], axes[3 + i], axes[6 + i])
                row = rows[at_row]
                fill(row, 0.0)
                _linear_row(jacobian, support, joint, p, axis, 1.0, row)
                if base:
                    _linear_row(jacobian, support, base, p, axis, -1.0, row)
                error = task[at.REF_P + i] - here[i]
                task[at.ERROR + i] = error
                wanted[at_row] = (
                    task[at.REF_A + i]
                    + task[at.KD + i] * (task[at.REF_V + i] - velocity[i])
                    + task[at.KP + i] * error
                    - drift[i]
                )
                at_row += 1
    if mask & 56:
        relative = product(transposed(axes), r)
        turn = rotation_vector(product(nine(task, at.REF_R), transposed(relative)))
        spin, spin_drift = rotate_back(axes, spin), rotate_back(axes, spin_drift)
        for i in range(3):
            if mask & (8 << i):
                axis = (axes[i], axes[3 + i], axes[6 + i])
                row = rows[at_row]
                fill(row, 0.0)
                _angular_row(jacobian, support, joint, axis, 1.0, row)
                if base:
                    _angular_row(jacobian, support, base, axis, -1.0, row)
                task[at.ERROR + 3 + i] = turn[i]
                wanted[at_row] = (
                    task[at.REF_A + 3 + i]
                    + task[at.KD + 3 + i] * (task[at.REF_V + 3 + i] - spin[i])
                    + task[at.KP + 3 + i] * turn[i]
                    - spin_drift[i]
                )
                at_row += 1


@njit(fastmath=FAST, error_model="numpy")
def _com_state(table, roots):  # type: ignore[no-untyped-def]
    """(position, velocity, drift) of the centre of mass: momentum over mass; total force at q̈ = 0 over mass, and gravity."""
    settings, momentum = vector(table, at.SETTINGS), matrix(table, at.MOMENTUM)
    place, force = matrix(table, at.PARENT_PLACEMENT), matrix(table, at.FORCE)
    v = line(table, at.STATE, 1)
    least = 1.0 / settings[at.MASS_TOTAL]
    velocity, total = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for c in range(v.shape[0]):
        velocity = add(velocity, times(v[c] * least, three(momentum[c], 0)))
    for j in roots:
        total = add(total, rotate(by_columns(place[j]), three(force[j], 0)))
    return (
        three(vector(table, at.COM), 0),
        velocity,
        (total[0] * least, total[1] * least, total[2] * least + settings[at.GRAVITY_Z]),
    )


@njit(fastmath=FAST, error_model="numpy")
def _com_rows(table, plan, roots, k, rows, wanted, first):  # type: ignore[no-untyped-def]
    task, momentum = line(table, at.PARAMETERS, k), matrix(table, at.MOMENTUM)
    least = 1.0 / vector(table, at.SETTINGS)[at.MASS_TOTAL]
    position, velocity, drift = _com_state(table, roots)
    at_row = first
    for i in range(3):
        if plan[k, at.MASK] & (1 << i):
            row = rows[at_row]
            fill(row, 0.0)
            for c in range(momentum.shape[0]):
                row[c] = momentum[c, i] * least
            error = task[at.REF_P + i] - position[i]
            task[at.ERROR + i] = error
            wanted[at_row] = (
                task[at.REF_A + i]
                + task[at.KD + i] * (task[at.REF_V + i] - velocity[i])
                + task[at.KP + i] * error
                - drift[i]
            )
            at_row += 1


@njit(fastmath=FAST, error_model="numpy")
def _gaze_rows(table, plan, support, k, rows, wanted, first):  # type: ignore[no-untyped-def]
    task, jacobian = line(table, at.PARAMETERS, k), matrix(table, at.JACOBIAN)
    joint, base = plan[k, at.JOINT], plan[k, at.BASE_JOINT]
    r, p, v, a, w, alpha = _point(table, joint, three(task, at.FRAME_P))
    local = add(three(task, at.BASE_P), rotate(nine(task, at.BASE_R), three(task, at.REF_P)))
    target, target_v, target_a = local, three(task, at.REF_V), three(task, at.REF_A)
    if base:
        _, target, target_v, target_a, _, _ = _point(table, base, local)
    sight = minus(target, p)
    distance = max(math.sqrt(dot(sight, sight)), 1e-3)
    toward = times(1.0 / distance, sight)
    swing_v, swing_a = minus(target_v, v), minus(target_a, a)
    # The line of sight turns by ω_d = d × ḋ, with ρ ḋ the part of the target's velocity across it.
    swing = times(1.0 / distance, cross(toward, swing_v))
    closing = dot(toward, swing_v)
    swing_drift = times(1.0 / distance, minus(cross(toward, swing_a), times(2.0 * closing, swing)))
    axis = rotate(r, three(task, at.EXTRA))
    side = cross(axis, toward)
    sine = math.sqrt(dot(side, side))
    angle = math.atan2(sine, dot(axis, toward))
    for i in range(2):
        across = rotate(r, three(task, at.EXTRA + 3 + 3 * i))
        error = angle / sine * dot(across, side) if sine > 1e-9 else (angle if i == 0 else 0.0)
        task[at.ERROR + i] = error
        row = rows[first + i]
        fill(row, 0.0)
        # (ω + d × v / ρ) · across: turning the axis, and moving the eye.
        lever = times(1.0 / distance, cross(across, toward))
        _angular_row(jacobian, support, joint, across, 1.0, row)
        _linear_row(jacobian, support, joint, p, lever, 1.0, row)
        if base:
            _linear_row(jacobian, support, base, target, lever, -1.0, row)
        rate = dot(across, minus(w, swing))
        turned = dot(cross(w, across), swing)
        wanted[first + i] = task[at.KP] * error - task[at.KD] * rate - dot(across, minus(alpha, swing_drift)) + turned


@njit(fastmath=FAST, error_model="numpy")
def nearest(a0, a1, b0, b1):  # type: ignore[no-untyped-def]
    """Nearest points of two segments, as shares of the way from a0 to a1 and from b0 to b1 (Ericson 2005, §5.1.9)."""
    u, v, r = minus(a1, a0), minus(b1, b0), minus(a0, b0)
    uu, vv, vr = dot(u, u), dot(v, v), dot(v, r)
    if uu < 1e-12 and vv < 1e-12:
        return 0.0, 0.0
    if uu < 1e-12:
        return 0.0, min(max(vr / vv, 0.0), 1.0)
    ur = dot(u, r)
    if vv < 1e-12:
        return min(max(-ur / uu, 0.0), 1.0), 0.0
    uv = dot(u, v)
    apart = uu * vv - uv * uv
    s = min(max((uv * vr - ur * vv) / apart, 0.0), 1.0) if apart > 1e-12 * uu * vv else 0.5
    t = (uv * s + vr) / vv
    if t < 0.0:
        return min(max(-ur / uu, 0.0), 1.0), 0.0
    if t > 1.0:
        return min(max((uv - ur) / uu, 0.0), 1.0), 1.0
    return s, t


@njit(fastmath=FAST, error_model="numpy")
def _gap(table, plan, support, k, row):  # type: ignore[no-untyped-def]
    """(distance, its rate, its drift) between a capsule of a frame and one of another (or a plane); its row into `row`."""
    task, jacobian = line(table, at.PARAMETERS, k), matrix(table, at.JACOBIAN)
    joint, base = plan[k, at.JOINT], plan[k, at.BASE_JOINT]
    ra, pa = by_columns(line(table, at.PLACEMENT, joint)), three(line(table, at.PLACEMENT, joint), 9)
    rb, pb = by_columns(line(table, at.PLACEMENT, base)), three(line(table, at.PLACEMENT, base), 9)
    la0, la1 = three(task, at.EXTRA), three(task, at.EXTRA + 3)
    lb0, lb1 = three(task, at.EXTRA + 6), three(task, at.EXTRA + 9)
    a0, a1 = add(pa, rotate(ra, la0)), add(pa, rotate(ra, la1))
    b0, b1 = add(pb, rotate(rb, lb0)), add(pb, rotate(rb, lb1))
    if plan[k, at.SLOT] == 1:  # a plane through b0, its normal from b0 to b1
        normal = minus(b1, b0)
        low = dot(normal, minus(a0, b0)) <= dot(normal, minus(a1, b0))
        s = 0.0 if low else 1.0
        near_a = a0 if low else a1
        near_b = minus(near_a, times(dot(normal, minus(near_a, b0)), normal))
        length = dot(normal, minus(near_a, b0))
    else:
        s, t = nearest(a0, a1, b0, b1)
        near_a, near_b = add(a0, times(s, minus(a1, a0))), add(b0, times(t, minus(b1, b0)))
        apart = minus(near_a, near_b)
        length = math.sqrt(dot(apart, apart))
        normal = times(1.0 / length, apart) if length > 1e-9 else (0.0, 0.0, 1.0)
    _, _, va, aa, _, _ = _point(table, joint, rotate_back(ra, minus(near_a, pa)))
    _, _, vb, ab, _, _ = _point(table, base, rotate_back(rb, minus(near_b, pb)))
    apart_v = minus(va, vb)
    rate = dot(normal, apart_v)
    bend = 0.0
    if plan[k, at.SLOT] != 1:
        bend = max(dot(apart_v, apart_v) - rate * rate, 0.0) / max(length, 1e-2)
    fill(row, 0.0)
    _linear_row(jacobian, support, joint, near_a, normal, 1.0, row)
    if base:
        _linear_row(jacobian, support, base, near_b, normal, -1.0, row)
    return length - task[at.EXTRA + 12], rate, dot(normal, minus(aa, ab)) + bend


@njit(fastmath=FAST, error_model="numpy")
def _clearance_rows(table, plan, support, k, rows, wanted, first):  # type: ignore[no-untyped-def]
    task = line(table, at.PARAMETERS, k)
    distance, rate, drift = _gap(table, plan, support, k, rows[first])
    least, reach = task[at.EXTRA + 13], task[at.EXTRA + 14]
    task[at.ERROR] = distance - least
    u = min(max(2.0 * (reach - distance) / max(reach - least, 1e-6), 0.0), 1.0)
    task[at.SHARE] = u * u * (3.0 - 2.0 * u)
    wanted[first] = task[at.KP] * (reach - distance) - task[at.KD] * min(rate, 0.0) - drift


@njit(fastmath=FAST, error_model="numpy")
def _posture_wanted(posture, slot, state, c):  # type: ignore[no-untyped-def]
    """q̈_d + d (q̇_d − q̇) + k (q_d − q) of one joint."""
    row = 6 * slot
    return (
        posture[row + 2, c]
        + posture[row + 4, c] * (posture[row + 1, c] - state[1, c])
        + posture[row + 3, c] * (posture[row, c] - state[0, c])
    )


@njit(fastmath=FAST, error_model="numpy")
def _posture_rows(table, plan, k, rows, wanted, first):  # type: ignore[no-untyped-def]
    posture, state, slot = matrix(table, at.POSTURE), matrix(table, at.STATE), plan[k, at.SLOT]
    at_row = first
    for c in range(state.shape[1]):
        if posture[6 * slot + 5, c] > 0.0:
            fill(rows[at_row], 0.0)
            rows[at_row, c] = 1.0
            wanted[at_row] = _posture_wanted(posture, slot, state, c)
            at_row += 1


@njit(fastmath=FAST, error_model="numpy")
def posture_accelerations(table, slot, out):  # type: ignore[no-untyped-def]
    """Wanted q̈ (nv,) of a posture; 0 where it wants nothing."""
    posture, state = matrix(table, at.POSTURE), matrix(table, at.STATE)
    for c in range(state.shape[1]):
        out[c] = _posture_wanted(posture, slot, state, c) if posture[6 * slot + 5, c] > 0.0 else 0.0


@njit(fastmath=FAST, error_model="numpy")
def _wrench_rows(table, plan, nv, k, rows, wanted, first):  # type: ignore[no-untyped-def]
    task = line(table, at.PARAMETERS, k)
    at_row, coordinate = first, nv + plan[k, at.FORCE_FIRST]
    for i in range(6):
        if plan[k, at.MASK] & (1 << i):
            fill(rows[at_row], 0.0)
            # What a contact has more than the task asks for lies between: a contact's coordinates are x y z and moments.
            rows[at_row, coordinate + (i if plan[k, at.SLOT] else at_row - first)] = -1.0
            task[at.ERROR + i] = task[at.REF_V + i] - task[at.REF_A + i]
            wanted[at_row] = task[at.REF_V + i] + task[at.KP + i] * task[at.ERROR + i]
            at_row += 1


@njit(fastmath=FAST, error_model="numpy")
def _given_rows(table, plan, n, k, rows, wanted, first):  # type: ignore[no-untyped-def]
    given, slot = matrix(table, at.GIVEN), plan[k, at.SLOT]
    for i in range(plan[k, at.COUNT]):
        for c in range(n):
            rows[first + i, c] = given[slot + i, c]
        wanted[first + i] = given[slot + i, n]


@njit(fastmath=FAST, error_model="numpy")
def _transmission_rows(table, plan, k, rows, wanted, first):  # type: ignore[no-untyped-def]
    task, state = line(table, at.PARAMETERS, k), matrix(table, at.STATE)
    leader, follower = plan[k, at.JOINT], plan[k, at.BASE_JOINT]
    ratio = task[at.EXTRA]
    fill(rows[first], 0.0)
    rows[first, follower], rows[first, leader] = 1.0, -ratio
    task[at.ERROR] = ratio * state[0, leader] + task[at.EXTRA + 1] - state[0, follower]
    wanted[first] = task[at.KP] * task[at.ERROR] - task[at.KD] * (state[1, follower] - ratio * state[1, leader])


@compiled(fastmath=FAST, error_model="numpy")
def task_rows(table, plan, support, roots, nv, n, k, rows, wanted, first):  # type: ignore[no-untyped-def]
    """The rows of task k (an equality's or a level's) into `rows`, `wanted` from `first` on."""
    kind = plan[k, at.KIND]
    if kind == at.POSE_KIND:
        _pose_rows(table, plan, support, k, rows, wanted, first)
    elif kind == at.COM_KIND:
        _com_rows(table, plan, roots, k, rows, wanted, first)
    elif kind == at.POSTURE_KIND:
        _posture_rows(table, plan, k, rows, wanted, first)
    elif kind == at.GAZE_KIND:
        _gaze_rows(table, plan, support, k, rows, wanted, first)
    elif kind == at.CLEARANCE_KIND:
        _clearance_rows(table, plan, support, k, rows, wanted, first)
    elif kind == at.WRENCH_KIND:
        _wrench_rows(table, plan, nv, k, rows, wanted, first)
    elif kind == at.GIVEN_KIND:
        _given_rows(table, plan, n, k, rows, wanted, first)
    elif kind == at.TRANSMISSION_KIND:
        _transmission_rows(table, plan, k, rows, wanted, first)


@njit(fastmath=FAST, error_model="numpy")
def force_rows(table, plan, support, tasks):  # type: ignore[no-untyped-def]
    """J (nf, nv) of every force coordinate: a contact's in the frame's own axes, a wrench's in its base frame's."""
    out, jacobian = matrix(table, at.FORCE_ROWS), matrix(table, at.JACOBIAN)
    for k in range(tasks):
        kind = plan[k, at.KIND]
        coordinate = plan[k, at.FORCE_FIRST]
        if coordinate < 0 or not (kind == at.POSE_KIND or (kind == at.WRENCH_KIND and not plan[k, at.SLOT])):
            continue
        task, joint = line(table, at.PARAMETERS, k), plan[k, at.JOINT]
        place = matrix(table, at.PLACEMENT)
        body = by_columns(place[joint])
        point = add(three(place[joint], 9), rotate(body, three(task, at.FRAME_P)))
        if kind == at.POSE_KIND:
            axes = product(body, nine(task, at.FRAME_R))
        else:
            axes = product(by_columns(place[plan[k, at.BASE_JOINT]]), nine(task, at.BASE_R))
        for i in range(6):
            if plan[k, at.MASK] & (1 << i):
                row = out[coordinate]
                fill(row, 0.0)
                axis = (axes[i % 3], axes[3 + i % 3], axes[6 + i % 3])
                if i < 3:
                    _linear_row(jacobian, support, joint, point, axis, 1.0, row)
                else:
                    _angular_row(jacobian, support, joint, axis, 1.0, row)
                coordinate += 1


@njit(fastmath=FAST, error_model="numpy")
def bounded_rows(table, plan, support, roots, nv, k, lower, upper):  # type: ignore[no-untyped-def]
    """Rows and bounds of an inequality of the constraints that is not on single joints."""
    rows, task = matrix(table, at.BOUNDED), line(table, at.PARAMETERS, k)
    kind, first, count = plan[k, at.KIND], plan[k, at.FIRST], plan[k, at.COUNT]
    if kind == at.FRICTION_KIND:
        normal = nv + plan[k, at.FORCE_FIRST] + 2
        for i in range(first, first + count):
            fill(rows[i], 0.0)
        rows[first, normal] = 1.0
        lower[first], upper[first] = task[at.EXTRA], task[at.EXTRA + 1]
        others = (count - 1) // 2
        for i in range(others):
            coordinate = normal + (i - 2 if i < 2 else i - 1)
            for side in range(2):
                row = first + 1 + 2 * i + side
                rows[row, coordinate] = 1.0 if side == 0 else -1.0
                rows[row, normal] = -task[at.EXTRA + 2 + i]
                lower[row], upper[row] = -np.inf, 0.0
    elif kind == at.BALANCE_KIND:
        momentum, settings = matrix(table, at.MOMENTUM), vector(table, at.SETTINGS)
        position, velocity, drift = _com_state(table, roots)
        least, rate = 1.0 / settings[at.MASS_TOTAL], task[at.EXTRA + 1]
        lever = (position[2] - task[at.EXTRA]) / -settings[at.GRAVITY_Z]
        for i in range(count):
            edge = three(task, at.EXTRA + 2 + 3 * i)
            row = rows[first + i]
            fill(row, 0.0)
            room = edge[2] - edge[0] * position[0] - edge[1] * position[1]
            moved = edge[0] * velocity[0] + edge[1] * velocity[1]
            pulled = edge[0] * drift[0] + edge[1] * drift[1]
            scale = -lever if plan[k, at.SLOT] == 0 else 1.0
            for c in range(nv):
                row[c] = scale * least * (edge[0] * momentum[c, 0] + edge[1] * momentum[c, 1])
            lower[first + i] = -np.inf
            if plan[k, at.SLOT] == 0:
                upper[first + i] = room - scale * pulled
            else:
                upper[first + i] = rate * rate * room - 2.0 * rate * moved - pulled
    elif kind == at.CLEARANCE_KIND:
        distance, moved, drift = _gap(table, plan, support, k, rows[first])
        rate = task[at.EXTRA + 15]
        room = distance - task[at.EXTRA + 13]
        task[at.ERROR] = room
        lower[first], upper[first] = -rate * rate * room - 2.0 * rate * moved - drift, np.inf
