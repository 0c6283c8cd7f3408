"""How near a robot's bodies come to each other if it brakes from now on: one compiled, pure function of what is commanded.

A body is convex (vertices, rounded by a radius) and hangs on a joint. Whoever brakes from q at speed q̇ runs on along q + s q̇, s
from 0 to S (the run-out, s of the present speed: see `judge`). Along any unit vector n the gap between two bodies is then at least

    min over A of n·a(s) − max over B of n·b(s) − radii,   n·a(s) ≥ n·(a + s v_a) − ½ s² Ω U,

v_a = v₀ + ω × a being the vertex' velocity against the last joint from which both bodies hang, Ω the sum of the speeds of the
joints between that one and the body, and U the same with each times the farthest that the body may be from the joint. The bound
is concave in s: 0 and S decide. n·(a + S v_a) = a·(n + S n × ω) + S n·v₀ costs no more than another direction's support.

The directions are those that GJK (Gilbert, Johnson and Keerthi 1988) goes through at s = 0 on its way to the closest points, from
the one that was left with in the cycle before; it ends with the first that shows that the pair keeps its margin. So who passes does
keep it, and who does not might, by little.

Most pairs need not be looked at in most cycles: while the joints move by Δq, no point of a body gets farther than Σ |Δq_j| U_j, so
a gap that was found remains, less the way that both bodies have gone since. Pairs on the same two joints lie side by side, and
are passed over together.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from daemon.wbc.memory import Memory, integers, matrix, vector
from handrail.compiled import compiled

MAX_TRIPS = 8
"""pairs that one cycle can tell of: it ends with the last"""
SELF, HALF_SPACE = 0, 1
"""kinds of pairs: two convex bodies; a body, and a point with the normal of the side that is free in the next row of `vertices`"""
PLACEMENT, AXIS = slice(0, 12), slice(12, 15)
REACH = 15
"""columns of `joints`: rotation and translation in the joint before, axis, m from it that anything which it carries may be"""
PLACED, _OMEGA, _TRAVEL, _WAY, _OWN_WAY = 22, 18, 19, 20, 21
"""columns of `placed`: 12 as of `joints`, ω, velocity at the world's origin; ΣΩ, ΣU; Σ |Δq| U ever since, and this joint's part"""
MARGIN, EXCUSED, CLEAR, DIRECTION, REMEMBERED = 0, 1, 2, 3, 6
"""columns of `memory`: m; 1 where it is; a gap that was found plus the way that both bodies had gone by then; along which vector"""
_STEPS = 32
_NEAR = 1e-7
"""m that the search for the closest points may be off"""
_CLOSING = 1e-3
"""m/s: an excused pair that comes closer no faster does not move: that is arithmetic, and noise"""
_ROOM = 0.005
"""m beyond its margin at which a pair is excused no longer"""
COMMANDED, EXCUSING, PUSHED = 0, 1, 2
"""ways of looking: at what is told; at that, and whoever is too near now is excused; at where stiff joints have been pushed to"""
PUSHED_BY = 0.03
"""rad that a joint which its drive holds may be away from its command without anybody's having pushed it there"""
_FAR = 1e6
"""rad: whoever goes so far in a cycle has left all gaps behind"""
_STILL = 0.02
"""rad/s: measured joints that are slower stand"""


NAMES = (
    "joints", "tree", "shapes", "bodies", "vertices", "pairs", "groups", "memory", "room", "placed", "moving", "trips",
)  # fmt: skip
"""What `judge` finds in its table, in this order; what is said of them stands there."""
_JOINTS, _TREE, _SHAPES, _BODIES, _VERTICES, _PAIRS, _GROUPS, _MEMORY, _ROOM_LEFT, _PLACED, _MOVING, _TRIPS = range(
    len(NAMES)
)


class Kept:
    """What `judge` keeps from call to call, and what it tells, beside what it knows of the bodies."""

    def __init__(self, bodies: Mapping[str, NDArray[Any]], margins: NDArray[np.float64], n: int):
        """`bodies`: arrays by their NAMES; `margins`: (p,) m, of the pairs; `n`: commanded joints."""
        known = Memory(NAMES)
        for name, array in bodies.items():
            if array.dtype == np.int64:
                known.put_integers(name, np.ascontiguousarray(array))
            else:
                known.put(name, np.ascontiguousarray(array))
        self.memory = known.make("memory", len(margins), REMEMBERED)
        self.memory[: len(margins), MARGIN], self.memory[:, CLEAR] = margins, -np.inf
        self.room = known.make("room", 1, len(bodies["groups"]))[0]
        self.room[:] = -np.inf
        known.make("placed", len(bodies["joints"]), PLACED)
        self.moving, self.trips = known.make("moving", 3, n), known.make("trips", MAX_TRIPS, 3)
        self._known, self.table = known, known.table


@njit(error_model="numpy")
def _segment(w, i, j, v):  # type: ignore[no-untyped-def]
    """v: the point of the segment w[i] w[j] closest to the origin; bits of the corners that it needs."""
    up, length = 0.0, 0.0
    for c in range(3):
        d = w[j, c] - w[i, c]
        up -= w[i, c] * d
        length += d * d
    if up <= 0.0 or length == 0.0:
        for c in range(3):
            v[c] = w[i, c]
        return 1 << i
    if up >= length:
        for c in range(3):
            v[c] = w[j, c]
        return 1 << j
    for c in range(3):
        v[c] = w[i, c] + up / length * (w[j, c] - w[i, c])
    return 1 << i | 1 << j


@njit(error_model="numpy")
def _triangle(w, i, j, k, v, u):  # type: ignore[no-untyped-def]
    """Likewise of a triangle: its inside, or else the closest of its edges. `u` (3,) is scratch."""
    ax, ay, az = w[j, 0] - w[i, 0], w[j, 1] - w[i, 1], w[j, 2] - w[i, 2]
    bx, by, bz = w[k, 0] - w[i, 0], w[k, 1] - w[i, 1], w[k, 2] - w[i, 2]
    nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    size = nx * nx + ny * ny + nz * nz
    if size > 1e-24:
        # Barycentric coordinates of the origin's projection (Ericson 2004, 3.4).
        px, py, pz = -w[i, 0], -w[i, 1], -w[i, 2]
        s = ((py * bz - pz * by) * nx + (pz * bx - px * bz) * ny + (px * by - py * bx) * nz) / size
        t = ((ay * pz - az * py) * nx + (az * px - ax * pz) * ny + (ax * py - ay * px) * nz) / size
        if s >= 0.0 and t >= 0.0 and s + t <= 1.0:
            h = (w[i, 0] * nx + w[i, 1] * ny + w[i, 2] * nz) / size
            v[0], v[1], v[2] = h * nx, h * ny, h * nz
            return 1 << i | 1 << j | 1 << k
    used, least = 0, np.inf
    for edge in range(3):
        one, other = (i, j) if edge == 0 else ((i, k) if edge == 1 else (j, k))
        bits = _segment(w, one, other, u)
        far = u[0] * u[0] + u[1] * u[1] + u[2] * u[2]
        if far < least:
            used, least = bits, far
            v[0], v[1], v[2] = u[0], u[1], u[2]
    return used


@njit(error_model="numpy")
def _closest(w, count, v, u):  # type: ignore[no-untyped-def]
    """v: the point of the simplex of `count` corners closest to the origin; `w` keeps the corners that it needs; how many."""
    used = 1
    if count == 1:
        v[0], v[1], v[2] = w[0, 0], w[0, 1], w[0, 2]
    elif count == 2:
        used = _segment(w, 0, 1, v)
    elif count == 3:
        used = _triangle(w, 0, 1, 2, v, u)
    else:
        t = np.empty(3)
        inside, least = True, np.inf
        for face in range(4):
            i, j, k = 0 if face else 1, 1 if face > 1 else 2, 2 if face > 2 else 3
            ax, ay, az = w[j, 0] - w[i, 0], w[j, 1] - w[i, 1], w[j, 2] - w[i, 2]
            bx, by, bz = w[k, 0] - w[i, 0], w[k, 1] - w[i, 1], w[k, 2] - w[i, 2]
            nx, ny, nz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
            here = -(w[i, 0] * nx + w[i, 1] * ny + w[i, 2] * nz)
            there = (w[face, 0] - w[i, 0]) * nx + (w[face, 1] - w[i, 1]) * ny + (w[face, 2] - w[i, 2]) * nz
            if here * there > 0.0:
                continue  # the origin is on the fourth corner's side
            inside = False
            bits = _triangle(w, i, j, k, t, u)
            far = t[0] * t[0] + t[1] * t[1] + t[2] * t[2]
            if far < least:
                used, least = bits, far
                v[0], v[1], v[2] = t[0], t[1], t[2]
        if inside:
            v[0], v[1], v[2] = 0.0, 0.0, 0.0
            return 4
    kept = 0
    for i in range(count):
        if used >> i & 1:
            for c in range(3):
                w[kept, c] = w[i, c]
            kept += 1
    return kept


@njit(error_model="numpy")
def _gap(vertices, bodies, placed, a, b, base, x, y, z, s):  # type: ignore[no-untyped-def]
    """m between two bodies along (x, y, z), roundings left out, after `s` s of their present velocity against joint `base`; and the
    rows of the vertices between which it is."""
    gap, rows, sign = 0.0, (0, 0), 1.0
    for side in range(2):
        body = bodies[a] if side == 0 else bodies[b]
        o = placed[body[0]]
        wx, wy, wz = o[12] - placed[base, 12], o[13] - placed[base, 13], o[14] - placed[base, 14]
        vx, vy, vz = o[15] - placed[base, 15], o[16] - placed[base, 16], o[17] - placed[base, 17]
        # The direction in which the vertices are looked at, n + s n × ω, then in the joint's frame.
        nx, ny, nz = (
            sign * (x + s * (y * wz - z * wy)),
            sign * (y + s * (z * wx - x * wz)),
            sign * (z + s * (x * wy - y * wx)),
        )
        lx, ly, lz = (
            o[0] * nx + o[3] * ny + o[6] * nz,
            o[1] * nx + o[4] * ny + o[7] * nz,
            o[2] * nx + o[5] * ny + o[8] * nz,
        )
        best, least = body[1], np.inf
        for i in range(body[1], body[2]):
            d = vertices[i, 0] * lx + vertices[i, 1] * ly + vertices[i, 2] * lz
            if d < least:
                best, least = i, d
        gap += least + o[9] * nx + o[10] * ny + o[11] * nz + sign * s * (x * vx + y * vy + z * vz)
        rows, sign = (rows[1], best), -1.0
    return gap, rows[0], rows[1]


@njit(error_model="numpy")
def _place(moving, joints, tree, placed):  # type: ignore[no-untyped-def]
    """Forward kinematics, and how far each joint has brought what it carries since the last call: rows of `placed`."""
    for i in range(joints.shape[0]):
        row, parent = tree[i, 1], tree[i, 0]
        f = joints[i]
        if parent < 0:
            for c in range(12):
                placed[i, c] = f[c]
            for c in range(12, PLACED):
                placed[i, c] = 0.0
            continue
        p, o = placed[parent], placed[i]
        for r in range(3):
            for c in range(3):
                o[3 * r + c] = p[3 * r] * f[c] + p[3 * r + 1] * f[3 + c] + p[3 * r + 2] * f[6 + c]
            o[9 + r] = p[9 + r] + p[3 * r] * f[9] + p[3 * r + 1] * f[10] + p[3 * r + 2] * f[11]
        q, speed = moving[0, row], moving[1, row]
        x, y, z = f[12], f[13], f[14]
        ax, ay, az = o[0] * x + o[1] * y + o[2] * z, o[3] * x + o[4] * y + o[5] * z, o[6] * x + o[7] * y + o[8] * z
        for c in range(12, _WAY):
            o[c] = p[c]
        o[_OWN_WAY] += moving[2, row] * (1.0 if tree[i, 2] else f[REACH])
        o[_WAY] = p[_WAY] + o[_OWN_WAY]
        if tree[i, 2]:
            o[9], o[10], o[11] = o[9] + q * ax, o[10] + q * ay, o[11] + q * az
            o[15], o[16], o[17] = o[15] + speed * ax, o[16] + speed * ay, o[17] + speed * az
            o[_TRAVEL] += 2.0 * abs(speed)  # twice, since the bound on the acceleration needs it
            continue
        sine, rest = math.sin(q), 1.0 - math.cos(q)
        for r in range(3):
            # R (1 + sin q [a] + (1 − cos q) [a]²), a row at a time (Rodrigues)
            a, b, c = o[3 * r], o[3 * r + 1], o[3 * r + 2]
            dx, dy, dz = b * z - c * y, c * x - a * z, a * y - b * x
            ex, ey, ez = dy * z - dz * y, dz * x - dx * z, dx * y - dy * x
            o[3 * r], o[3 * r + 1], o[3 * r + 2] = (
                a + sine * dx + rest * ex,
                b + sine * dy + rest * ey,
                c + sine * dz + rest * ez,
            )
        o[12], o[13], o[14] = o[12] + speed * ax, o[13] + speed * ay, o[14] + speed * az
        o[15] += speed * (o[10] * az - o[11] * ay)
        o[16] += speed * (o[11] * ax - o[9] * az)
        o[17] += speed * (o[9] * ay - o[10] * ax)
        o[_OMEGA] += abs(speed)
        o[_TRAVEL] += abs(speed) * f[REACH]


@njit(error_model="numpy")
def _take(wanted, last, measured, limits, period, moving, look):  # type: ignore[no-untyped-def]
    """`moving` (3, n): positions and speeds that count, and rad since the last call. Of a joint that its drive holds, what it is
    told; of a soft one, what is measured of it. Returns how long braking takes, s, and whether somebody has pushed a joint away."""
    n, pushed = wanted.shape[1], False
    for j in range(n):
        before = moving[0, j]
        if wanted[3, j] < limits[n + 2, j]:
            speed = measured[1, j]
            moving[0, j], moving[1, j] = measured[0, j], speed if abs(speed) > _STILL else 0.0
        else:
            moving[0, j], moving[1, j] = wanted[0, j], (wanted[0, j] - last[0, j]) / period
            off = measured[0, j] - wanted[0, j]
            if abs(off) > PUSHED_BY:
                pushed = True
                if look == PUSHED:
                    moving[0, j] += off - PUSHED_BY if off > 0.0 else off + PUSHED_BY
        way = abs(moving[0, j] - before)
        moving[2, j] = way if way < _FAR else _FAR  # NaN, too: then nothing is known any more
    time = 0.0
    for j in range(n):
        momentum = 0.0
        for k in range(n):
            momentum += limits[j, k] * abs(moving[1, k])
        time = max(time, 1.5 * momentum / limits[n, j], math.sqrt(6.0 * momentum / limits[n + 1, j]))
    return time, pushed


@njit(error_model="numpy")
def _centre(shapes, bodies, placed, body):  # type: ignore[no-untyped-def]
    p, x, y, z = placed[bodies[body, 0]], shapes[body, 0], shapes[body, 1], shapes[body, 2]
    return (
        p[0] * x + p[1] * y + p[2] * z + p[9],
        p[3] * x + p[4] * y + p[5] * z + p[10],
        p[6] * x + p[7] * y + p[8] * z + p[11],
    )


@compiled(error_model="numpy")
def judge(wanted, last, measured, limits, table, period, look):  # type: ignore[no-untyped-def]
    """Which pairs would come nearer than they may if the robot braked after this cycle: (how many, s that braking takes, whether a
    joint that its drive holds has been pushed away from its command).

    `wanted`, `last`, `measured`: JointCommand.table (5, n) of this cycle and the one before, JointState.table (4, n).
    `limits` (n + 3, n): |M(q)|, then N·m and N·m/s that are left for braking, then the stiffness below which a joint
    is soft. Braking scales the present speeds by 1 − 3u² + 2u³, u = t/T: for all joints the same T, the longest of their bounds
    1.5 |M||q̇| / τ and √(6 |M||q̇| / τ̇). So the run-out S is T/2, and what is run through v²/2a with a = 2τ / 3M.
    `table`: of a `Kept`.
    `joints` (k, 16), `tree` (k, 3: joint before, row, whether it slides): the first is the base. `shapes` (m, 5: sphere around it
    in its joint's frame, rounding), `bodies` (m, 3: joint, first and last vertex), `vertices` (·, 3) m. `pairs` (p, 4: two bodies,
    the last joint from which both hang, kind), in `groups` (g, 5: two joints, that last one, first and last pair).
    What is kept from call to call: `memory` (p, REMEMBERED) of each pair, `room` (g,) m that a group has beyond its margins,
    `placed` (k, PLACED), `moving` (3, n). `trips` (MAX_TRIPS, 3: pair, distance, what would be left of it, m) is written.
    `look`: at COMMANDED; EXCUSING pairs that are within their margin now: they may be so near, and go away from each other, but not
    come nearer; PUSHED, with what somebody has pushed a stiff joint away by beyond PUSHED_BY: then every such pair is excused.
    """
    joints, tree, shapes = matrix(table, _JOINTS), integers(table, _TREE), matrix(table, _SHAPES)
    bodies, vertices = integers(table, _BODIES), matrix(table, _VERTICES)
    pairs, groups = integers(table, _PAIRS), integers(table, _GROUPS)
    memory, room, placed = matrix(table, _MEMORY), vector(table, _ROOM_LEFT), matrix(table, _PLACED)
    moving, trips = matrix(table, _MOVING), matrix(table, _TRIPS)
    time, pushed = _take(wanted, last, measured, limits, period, moving, look)
    excuse = look == EXCUSING
    run_out = 0.0 if excuse else 0.5 * time
    w, v, u = np.empty((4, 3)), np.empty(3), np.empty(3)
    _place(moving, joints, tree, placed)
    found = 0
    for group in range(groups.shape[0]):
        ja, jb, base = groups[group, 0], groups[group, 1], groups[group, 2]
        travel_a, travel_b = placed[ja, _TRAVEL] - placed[base, _TRAVEL], placed[jb, _TRAVEL] - placed[base, _TRAVEL]
        way = placed[ja, _WAY] + placed[jb, _WAY] - 2.0 * placed[base, _WAY]
        if not excuse and room[group] - way >= run_out * (travel_a + travel_b):
            continue
        bend = (
            0.5
            * run_out
            * run_out
            * (
                (placed[ja, _OMEGA] - placed[base, _OMEGA]) * travel_a
                + (placed[jb, _OMEGA] - placed[base, _OMEGA]) * travel_b
            )
        )
        pa, pb = placed[ja], placed[jb]
        room[group] = np.inf
        for number in range(groups[group, 3], groups[group, 4]):
            a, b, kind, about = pairs[number, 0], pairs[number, 1], pairs[number, 3], memory[number]
            margin, excused = about[MARGIN], about[EXCUSED] > 0.5
            need = margin + run_out * (travel_a + travel_b)
            if excused or excuse:
                need = max(need, margin + _ROOM)
            if about[CLEAR] - way >= need:
                about[EXCUSED] = 0.0
                room[group] = min(room[group], about[CLEAR] - margin)
                continue
            ax, ay, az = _centre(shapes, bodies, placed, a)
            bx, by, bz = _centre(shapes, bodies, placed, b)
            x, y, z = ax - bx, ay - by, az - bz
            if kind == HALF_SPACE:
                first = bodies[b, 1]
                mx, my, mz = vertices[first + 1, 0], vertices[first + 1, 1], vertices[first + 1, 2]
                nx, ny, nz = (
                    pb[0] * mx + pb[1] * my + pb[2] * mz,
                    pb[3] * mx + pb[4] * my + pb[5] * mz,
                    pb[6] * mx + pb[7] * my + pb[8] * mz,
                )
                rough = x * nx + y * ny + z * nz
                x, y, z = nx, ny, nz
            else:
                rough = math.sqrt(x * x + y * y + z * z)
            rough -= shapes[a, 3] + shapes[b, 3]
            if rough >= need:
                about[EXCUSED], about[CLEAR] = 0.0, rough + way
                room[group] = min(room[group], about[CLEAR] - margin)
                continue
            round_off = shapes[a, 4] + shapes[b, 4]
            v[0], v[1], v[2] = x, y, z
            if kind == SELF and about[DIRECTION] ** 2 + about[DIRECTION + 1] ** 2 + about[DIRECTION + 2] ** 2 > 0.5:
                v[0], v[1], v[2] = about[DIRECTION], about[DIRECTION + 1], about[DIRECTION + 2]
            count, safe, now, then = 0, False, 0.0, 0.0
            size = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
            for step in range(_STEPS):
                if size > 1e-9:
                    x, y, z = v[0] / size, v[1] / size, v[2] / size
                gap, i, k = _gap(vertices, bodies, placed, a, b, base, x, y, z, 0.0)
                now = gap - round_off
                if now >= need:
                    about[EXCUSED] = 0.0
                    safe = True
                    break
                if now >= margin:
                    then = _gap(vertices, bodies, placed, a, b, base, x, y, z, run_out)[0] - round_off - bend
                    if then >= margin:
                        safe = True
                        break
                if kind == HALF_SPACE or size <= 1e-9 or (step and size - gap <= _NEAR):
                    break
                for r in range(3):
                    w[count, r] = (
                        pa[3 * r] * vertices[i, 0]
                        + pa[3 * r + 1] * vertices[i, 1]
                        + pa[3 * r + 2] * vertices[i, 2]
                        + pa[9 + r]
                    ) - (
                        pb[3 * r] * vertices[k, 0]
                        + pb[3 * r + 1] * vertices[k, 1]
                        + pb[3 * r + 2] * vertices[k, 2]
                        + pb[9 + r]
                    )
                count = _closest(w, count + 1, v, u)
                size = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
                if count == 4 or size <= 1e-9:  # they overlap: along the line between their middles
                    x, y, z = ax - bx, ay - by, az - bz
                    size = max(math.sqrt(x * x + y * y + z * z), 1e-9)
                    x, y, z = x / size, y / size, z / size
                    now = -round_off
                    break
            about[CLEAR], about[DIRECTION], about[DIRECTION + 1], about[DIRECTION + 2] = now + way, x, y, z
            if safe:
                if about[EXCUSED] > 0.5:
                    room[group] = -np.inf
                else:
                    room[group] = min(room[group], about[CLEAR] - margin)
                continue
            room[group] = -np.inf
            if excuse:
                about[EXCUSED] = 1.0 if now < margin else 0.0
                continue
            excused = excused or (look == PUSHED and now < margin)
            ahead = period if excused else run_out
            then = _gap(vertices, bodies, placed, a, b, base, x, y, z, ahead)[0] - round_off
            if not excused:
                then -= bend
            elif then - now >= -_CLOSING * period:
                continue
            trips[found, 0], trips[found, 1], trips[found, 2] = number, now, min(now, then)
            found += 1
            if found == MAX_TRIPS:
                return found, time, pushed
    return found, time, pushed
