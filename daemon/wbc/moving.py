"""Compiled: one cycle of what references.py and impedance.py do, each on a flat array of its own, whose layout stands below."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from daemon.controllers.references import hermite
from daemon.wbc import layout as at
from daemon.wbc.vectors import (
    FAST,
    add,
    dot,
    minus,
    nine,
    product,
    put,
    rotate,
    rotation_of,
    rotation_vector,
    three,
    times,
    transposed,
)
from handrail.compiled import compiled

LINE_R, LINE_P, LINE_SHIFT, LINE_TURN, LINE_V, LINE_LENGTH, LINE_PERIOD, LINE = 0, 9, 12, 15, 18, 24, 25, 26
"""a line: where it starts, what way it goes, the twist of the cycle before, its length s, the loop's period s"""
HERE_P, HERE_R, SENT_P, SENT_R, SENT_V, AGE, PERIOD, STALE, GAIN, SPEED, TURN, STREAM = (
    0, 3, 12, 15, 24, 30, 31, 32, 33, 34, 35, 36,
)  # fmt: skip
"""a stream: the reference, what was sent, how long ago, settings"""
WANTED_P, WANTED_R, SHORT, SEEN_P, SEEN_R, OFF, LEASH = 0, 3, 12, 13, 16, 25, 28
"""a leash: the pose that is wanted, 1 where the task's is nearer, the pose measured last, what lies between the positions"""
POINT_P, POINT_V, POINT_A, POINT = 0, 3, 6, 9
"""a point on knots: position, velocity, acceleration"""
_SHORTER = 0.9
"""share of a leash that is taken in where levels are damped"""


@compiled(fastmath=FAST, error_model="numpy")
def follow_line(state, s, rate, task):  # type: ignore[no-untyped-def]
    """A task's reference at path parameter s of a line, minimum-jerk (Flash and Hogan 1985), as controllers.references.LinePath."""
    u = min(max(s / state[LINE_LENGTH], 0.0), 1.0)
    share = u * u * u * (10.0 - 15.0 * u + 6.0 * u * u)
    slope = rate * 30.0 * u * u * (1.0 - u) * (1.0 - u) / state[LINE_LENGTH]
    shift, turn = three(state, LINE_SHIFT), three(state, LINE_TURN)
    rotation = product(nine(state, LINE_R), rotation_of(times(share, turn)))
    put(task, at.REF_P, add(three(state, LINE_P), times(share, shift)))
    put(task, at.REF_R, rotation)
    put(task, at.REF_V, times(slope, shift))
    put(task, at.REF_V + 3, rotate(rotation, times(slope, turn)))
    for i in range(6):
        velocity = task[at.REF_V + i]
        task[at.REF_A + i] = (velocity - state[LINE_V + i]) / state[LINE_PERIOD]
        state[LINE_V + i] = velocity


@compiled
def follow_knots(knots, at_knot, s, rate, followed, period, rows, posture):  # type: ignore[no-untyped-def]
    """A posture's reference at path parameter s of a HermitePath; returns the knot before s.

    followed (3, n): position, its derivative by s, the velocity of the cycle before.
    """
    at_knot = hermite(s, at_knot, knots, followed[0], followed[1])
    for i in range(rows.shape[0]):
        c, velocity = rows[i], rate * followed[1, i]
        posture[0, c], posture[1, c], posture[2, c] = followed[0, i], velocity, (velocity - followed[2, i]) / period
        followed[2, i] = velocity
    return at_knot


@compiled
def follow_points(knots, at_knot, s, rate, followed, period, point):  # type: ignore[no-untyped-def]
    """A frame's point at path parameter s of a HermitePath of three columns; returns the knot before s.

    followed (3, 3): position, its derivative by s, the velocity of the cycle before.
    """
    at_knot = hermite(s, at_knot, knots, followed[0], followed[1])
    for i in range(3):
        velocity = rate * followed[1, i]
        point[POINT_P + i], point[POINT_V + i] = followed[0, i], velocity
        point[POINT_A + i] = (velocity - followed[2, i]) / period
        followed[2, i] = velocity
    return at_knot


@njit(fastmath=FAST, error_model="numpy")
def _at_most(v, most):  # type: ignore[no-untyped-def]
    size = math.sqrt(dot(v, v))
    return times(most / size, v) if size > most else v


@compiled(fastmath=FAST, error_model="numpy")
def follow_stream(state, rate, task):  # type: ignore[no-untyped-def]
    """A task's reference one period on, towards what was sent: see references.StreamedPose."""
    period, gain = state[PERIOD], state[GAIN]
    state[AGE] += period
    if state[AGE] > state[STALE]:
        put(state, SENT_V, (0.0, 0.0, 0.0))
        put(state, SENT_V + 3, (0.0, 0.0, 0.0))
    linear, angular = three(state, SENT_V), three(state, SENT_V + 3)
    position = add(three(state, SENT_P), times(period, linear))
    rotation = product(rotation_of(times(period, angular)), nine(state, SENT_R))
    here, turned = three(state, HERE_P), nine(state, HERE_R)
    gap, turn = minus(position, here), rotation_vector(product(rotation, transposed(turned)))
    linear = times(rate, _at_most(add(linear, times(gain, gap)), state[SPEED]))
    angular = times(rate, _at_most(add(angular, times(gain, turn)), state[TURN]))
    here, turned = add(here, times(period, linear)), product(rotation_of(times(period, angular)), turned)
    put(state, SENT_P, position)
    put(state, SENT_R, rotation)
    put(state, HERE_P, here)
    put(state, HERE_R, turned)
    put(task, at.REF_P, here)
    put(task, at.REF_R, turned)
    put(task, at.REF_V, linear)
    put(task, at.REF_V + 3, angular)


@njit(fastmath=FAST, error_model="numpy")
def _give(parameters, tasks, kept):  # type: ignore[no-untyped-def]
    """Put references back to what is wanted, and note where their frames were measured last."""
    for i in range(tasks.shape[0]):
        task, leash = parameters[tasks[i]], kept[i]
        put(leash, SEEN_P, minus(three(task, at.REF_P), three(task, at.ERROR)))
        turned = rotation_of(times(-1.0, three(task, at.ERROR + 3)))
        put(leash, SEEN_R, product(turned, nine(task, at.REF_R)))
        if leash[SHORT] > 0.0:
            put(task, at.REF_P, three(leash, WANTED_P))
            put(task, at.REF_R, nine(leash, WANTED_R))


@njit(fastmath=FAST, error_model="numpy")
def _take(parameters, tasks, kept, reach, widest):  # type: ignore[no-untyped-def]
    """Shorten references to within `reach` m, `widest` rad of where their frames were measured, and keep what was wanted."""
    for i in range(tasks.shape[0]):
        task, leash = parameters[tasks[i]], kept[i]
        wanted, rotation = three(task, at.REF_P), nine(task, at.REF_R)
        seen, seen_rotation = three(leash, SEEN_P), nine(leash, SEEN_R)
        off = minus(wanted, seen)
        turn = rotation_vector(product(rotation, transposed(seen_rotation)))
        put(leash, OFF, off)
        far, wide = math.sqrt(dot(off, off)), math.sqrt(dot(turn, turn))
        leash[SHORT] = 1.0 if far > reach or wide > widest else 0.0
        put(leash, WANTED_P, wanted)
        put(leash, WANTED_R, rotation)
        if far > reach:
            put(task, at.REF_P, add(seen, times(reach / far, off)))
        if wide > widest:
            put(task, at.REF_R, product(rotation_of(times(widest / wide, turn)), seen_rotation))


@compiled(fastmath=FAST, error_model="numpy")
def follow(parameters, kept, lines, streams, points, tasks, s, rate, settings, reach, widest):  # type: ignore[no-untyped-def]
    """A whole compound task's references one period on, see references.Leashes: given back, moved, taken in again.

    `tasks`: rows of `parameters`, those on leashes first, then the lines', the streams', the points' (which were moved
    already). `settings`: the solver's.
    """
    leashed, first = tasks[: kept.shape[0]], kept.shape[0]
    _give(parameters, leashed, kept)
    for i in range(lines.shape[0]):
        follow_line(lines[i], s, rate, parameters[tasks[first + i]])
    first += lines.shape[0]
    for i in range(streams.shape[0]):
        follow_stream(streams[i], rate, parameters[tasks[first + i]])
    first += streams.shape[0]
    for i in range(points.shape[0]):
        for k in range(3):
            task = parameters[tasks[first + i]]
            task[at.REF_P + k], task[at.REF_V + k] = points[i, POINT_P + k], points[i, POINT_V + k]
            task[at.REF_A + k] = points[i, POINT_A + k]
    share = 1.0
    if settings[at.MOST_DAMPING] > 0.0:
        share -= _SHORTER * settings[at.DAMPING] / settings[at.MOST_DAMPING]
    _take(parameters, leashed, kept, share * reach, share * widest)


@compiled
def lead(desired, acceleration, rows, position, velocity, period, leak, within):  # type: ignore[no-untyped-def]
    """desired (2, n) one period on: see impedance.ImpedanceOutput. What is not finite changes nothing."""
    n = rows.shape[0]
    for i in range(n):
        if not (math.isfinite(acceleration[rows[i]]) and math.isfinite(position[i]) and math.isfinite(velocity[i])):
            return
    for i in range(n):
        desired[1, i] += period * (acceleration[rows[i]] + leak * (velocity[i] - desired[1, i]))
        led = desired[0, i] + period * (desired[1, i] + leak * (position[i] - desired[0, i]))
        desired[0, i] = min(max(led, position[i] - within), position[i] + within)


@compiled
def follow_others(velocity, joints, seen, period, settle, most):  # type: ignore[no-untyped-def]
    """seen (2, m), velocity and acceleration of joints that others command: the latter is the former's slope over `settle` s,
    no more than `most` rad/s²."""
    share = period / (period + settle)
    for i in range(joints.shape[0]):
        now = velocity[joints[i]]
        slope = min(max((now - seen[0, i]) / period, -most), most)
        if math.isfinite(slope):
            seen[0, i] = now
            seen[1, i] += share * (slope - seen[1, i])


@njit
def _ease(solution, rows, torques, jumps, most, bound, mass, eased):  # type: ignore[no-untyped-def]
    """See Easing: eased (4, nv) is q̈ and τ as they are told, then as they were solved, in the cycle before (NaN: none was)."""
    step = far = 0.0
    for i in range(rows.shape[0]):
        step = max(step, abs(solution[1, rows[i]] - eased[3, rows[i]]) / torques[i])
    fresh, jump = not math.isfinite(eased[3, rows[0]]), jumps and step > most
    for k in range(2):
        for i in range(rows.shape[0]):
            r = rows[i]
            left = eased[k, r] - (solution[k, r] if jump else eased[2 + k, r])
            eased[2 + k, r] = solution[k, r]
            eased[k, r] = 0.0 if fresh else left
            if k == 1 and not fresh:
                far = max(far, abs(eased[k, r]) / torques[i])
    share = 1.0 - most / far if far > most else 0.0
    for k in range(2):
        for i in range(rows.shape[0]):
            eased[k, rows[i]] = solution[k, rows[i]] + share * eased[k, rows[i]]
    for i in range(rows.shape[0]):  # bounds hold all the same
        r = rows[i]
        beyond = eased[0, r] - min(max(eased[0, r], bound[0, r]), bound[1, r])
        if beyond != 0.0:
            eased[0, r] -= beyond
            for j in range(rows.shape[0]):
                eased[1, rows[j]] -= beyond * (mass[r, rows[j]] if rows[j] <= r else mass[rows[j], r])


@compiled
def tell(
    desired,
    period,
    leak,
    within,
    solution,
    rows,
    torques,
    settings,
    most,
    bound,
    mass,
    eased,
    measured,
    gains,
    joints,
    code,
    table,
    mode,
):  # type: ignore[no-untyped-def]
    """`desired` one period on, and the robot's joints `joints` told it, with their torque, stiffness and damping.

    `solution`: q̈ and τ in its first two rows; `torques` (m,) N·m, rated; `settings`, `bound`, `mass`: the solver's;
    `most`, `eased`: see Easing; `measured`: JointState.table; `gains` (2, m); `table`, `mode`: a JointCommand's.
    """
    _ease(solution, rows, torques, settings[at.DAMPING] > 0.0, most, bound, mass, eased)
    position, velocity = np.empty(joints.shape[0]), np.empty(joints.shape[0])
    for i in range(joints.shape[0]):
        position[i], velocity[i] = measured[0, joints[i]], measured[1, joints[i]]
    lead(desired, eased[0], rows, position, velocity, period, leak, within)
    for i in range(joints.shape[0]):
        j = joints[i]
        table[0, j], table[1, j], table[2, j] = desired[0, i], desired[1, i], eased[1, rows[i]]
        table[3, j], table[4, j], mode[j] = gains[0, i], gains[1, i], code


def warm_up(joints: int) -> None:
    """Compile (or load) all of it: before a loop starts."""
    task, parameters, tasks = np.zeros(at.PARAMETERS_WIDTH), np.zeros((1, at.PARAMETERS_WIDTH)), np.zeros(4, np.int64)
    two, rows, mode = np.zeros((2, joints)), np.arange(joints), np.zeros(joints, np.uint8)
    follow_line(np.ones(LINE), 0.0, 1.0, task)
    follow_knots(np.eye(2, 1 + 2 * joints), 0, 0.0, 1.0, np.zeros((3, joints)), 1.0, rows, np.zeros((6, joints)))
    follow_stream(np.zeros(STREAM), 1.0, task)
    follow_points(np.eye(2, 7), 0, 0.0, 1.0, np.zeros((3, 3)), 1.0, np.zeros(POINT))
    moved = (np.zeros((1, LEASH)), np.ones((1, LINE)), np.zeros((1, STREAM)), np.zeros((1, POINT)), tasks)
    follow(parameters, *moved, 0.0, 1.0, np.zeros(at.SETTINGS_WIDTH), 1.0, 1.0)
    lead(two, two[0], rows, two[0], two[0], 1.0, 0.0, 1.0)
    follow_others(two[0], rows, two, 1.0, 1.0, 1.0)
    eased, four, square = np.zeros((4, joints)), np.zeros((4, joints)), np.zeros((joints, joints))
    solver = (np.ones(joints), np.zeros(at.SETTINGS_WIDTH), 1.0, two, square, eased)
    tell(two, 1.0, 0.0, 1.0, two, rows, *solver, four, two, rows, 0, np.zeros((5, joints)), mode)
