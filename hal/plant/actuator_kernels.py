"""The compiled firmware: sensors, set-points, limits and torque loop of every actuator, cycle by cycle. Nothing allocates.

All that the actuators are and remember is one piece of memory, which hal.plant.actuator fills: each argument of a compiled
function costs as much as a cycle of an actuator. Its parts hold a row or a column an actuator, and are named here. In the kernels
t and s are one actuator's rows of table and state, w its set-point.
"""

from __future__ import annotations

import math

import numpy as np

from hal.drives.borrowing import borrowed
from hal.joint import Mode
from hal.plant.transmission import ROD_COLUMNS, rod_lengths
from handrail.compiled import compiled

FIRMWARE_HZ = 5000
MODE_SWITCH_RATE = 10.0
"""1/s: the difference that a change of mode makes to the torque fades by so many rated torques a second"""
TRACKING_HZ = 300.0
"""bandwidth of the loop that follows the encoder, and estimates the velocity with it"""
SPRING_BITS = 24
"""a turn: the spring's own sensor has 32 (Radford et al. 2015, §2.3); the last of them are noise"""
APPROACH_RATE = 20.0
"""1/s: how fast a joint may still go towards its end, over what is left of the way"""

# Rows of the actuators' signals: the set-point, what a hot motor may still do, what acts on the joint, what the firmware reads,
# and the torque that it aims at.
POSITION, VELOCITY, TORQUE, STIFFNESS, DAMPING, DERATING, SPRING, READING, READING_RATE, READING_TORQUE, GOAL = range(
    11
)
# Columns of the table, what does not change from cycle to cycle. First what the actuator is: spring, friction, inertia, torque
# per current, Coulomb friction and half the backlash before the spring; encoder's resolution, noise and mounting error, the error
# of the angle measured at the motor.
K, B, PER_J, NKT, COULOMB, SLACK, QUANTUM, PER_QUANTUM, NOISE, MOUNTED, MOTOR_MOUNTED = range(11)
# Then what the firmware believes and wants: spring and torque per current, gains of the torque loop, current limit, torque
# limits of actuator and joint, the observer's filters, current loop, slope filter, position loop, limits, calibration; and
# whether the loops around the torque close on the angle at the motor.
MODEL_K, MODEL_NKT, KP, KD, CURRENT_MAX, FORCE_MAX, EFFORT, P0, P1, P2, A1, A2, Q0, Q1, Q2, AC, AF = range(11, 28)
POSITION_K, POSITION_D, POSITION_I, SPEED_MAX, SPEED_GAIN, LOWER, UPPER, ENCODER_ADDS, TORQUE_ADDS = range(28, 37)
ON_MOTOR = 37
# Columns of the state, what does.
ROTOR, RATE, CURRENT, DISTURBANCE, LAST, SLOPE, X1, X2, Y1, Y2 = range(10)
INTEGRAL, REST, HELD, MODE_BEFORE, TRACKED, TRACKED_RATE = range(10, 16)
# Rows of the actuators' marks, one byte each: hal.joint.Mode, and four that are true or false.
MODE, POWERED, SMOOTH, LIMITED, PAIRED = range(5)
_SIGNALS, _TABLE, _STATE, _MARKS = 11, 38, 16, 5
_HEAD = 2

_DT = 1.0 / FIRMWARE_HZ
_SPRING_QUANTUM = 2.0 * math.pi / 2**SPRING_BITS
_SPEED_INTEGRAL = 25.0  # 1/s, integral over proportional gain of the speed limit's controller
_TRACK_X, _TRACK_V = 1.6 * 2 * math.pi * TRACKING_HZ, (2 * math.pi * TRACKING_HZ) ** 2
_BEYOND = 1e-3  # rad: a set-point this far beyond the joint's end is called limited
_MODE_DAMPING, _MODE_TORQUE, _MODE_POSITION = int(Mode.DAMPING), int(Mode.TORQUE), int(Mode.POSITION)
_SHIFT_A, _SHIFT_B, _SHIFT_C, _LOW = np.uint64(13), np.uint64(7), np.uint64(17), np.uint64(0xFFFF)
_TO_WHOLE = 1.5 * 2.0**52  # added and taken away again, it rounds a double of moderate size to a whole number
_GAUSS = math.sqrt(3.0) / 65536.0


class ActuatorMemory:
    """n actuators, of which `pairs` pairs share their joints. All parts are views of `memory`: never rebind them."""

    def __init__(self, n: int, pairs: int):
        floats = (_SIGNALS + _TABLE + _STATE) * n
        self.memory = np.zeros(_HEAD + floats + n + (2 + ROD_COLUMNS) * pairs + (_MARKS * n + 7) // 8, np.int64)
        """n, pairs, and everything below"""
        self.memory[:_HEAD] = n, pairs
        sizes = (_SIGNALS * n, _TABLE * n, _STATE * n, n, 2 * pairs, ROD_COLUMNS * pairs)
        parts = np.split(self.memory, _HEAD + np.cumsum((0, *sizes)))[1:]
        self.signals = parts[0].view(np.float64).reshape(_SIGNALS, n)
        self.table = parts[1].view(np.float64).reshape(n, _TABLE)
        self.state = parts[2].view(np.float64).reshape(n, _STATE)
        self.seeds = parts[3].view(np.uint64)
        """of the encoders' noise"""
        self.pairs = parts[4].reshape(pairs, 2)
        """rows of pitch and roll"""
        self.rods = parts[5].view(np.float64).reshape(pairs, ROD_COLUMNS)
        self.marks = parts[6].view(np.uint8)[: _MARKS * n].reshape(_MARKS, n)


@compiled
def actuator_parts(memory):  # type: ignore[no-untyped-def]
    """signals, table, state, seeds, pairs, rods, marks of an ActuatorMemory"""
    memory = borrowed(memory)
    n, pairs = memory[0], memory[1]
    table = _HEAD + _SIGNALS * n
    state = table + _TABLE * n
    seeds = state + _STATE * n
    pair = seeds + n
    rods = pair + 2 * pairs
    marks = rods + ROD_COLUMNS * pairs
    return (
        memory[_HEAD:table].view(np.float64).reshape(_SIGNALS, n),
        memory[table:state].view(np.float64).reshape(n, _TABLE),
        memory[state:seeds].view(np.float64).reshape(n, _STATE),
        memory[seeds:pair].view(np.uint64),
        memory[pair:rods].reshape(pairs, 2),
        memory[rods:marks].view(np.float64).reshape(pairs, ROD_COLUMNS),
        memory[marks:].view(np.uint8)[: _MARKS * n].reshape(_MARKS, n),
    )


@compiled(error_model="numpy")
def _noise(seed):  # type: ignore[no-untyped-def]
    """About normal, mean 0, standard deviation 1: four 16-bit parts of a xorshift generator's next number, added up.

    `seed` (1,) is the generator.
    """
    x = seed[0]
    x ^= x << _SHIFT_A
    x ^= x >> _SHIFT_B
    x ^= x << _SHIFT_C
    seed[0] = x
    total = float(x & _LOW) + float((x >> np.uint64(16)) & _LOW) + float((x >> np.uint64(32)) & _LOW)
    total += float((x >> np.uint64(48)) & _LOW)
    return (total - 2.0 * 65535.0) * _GAUSS


@compiled(error_model="numpy")
def _read_encoder(joint, t, s, seed):  # type: ignore[no-untyped-def]
    """The encoder's angle; the tracking loop follows it."""
    reading = joint + t[MOUNTED]
    if t[NOISE] > 0.0:
        reading += t[NOISE] * _noise(seed)
    reading = (reading * t[PER_QUANTUM] + _TO_WHOLE - _TO_WHOLE) * t[QUANTUM] + t[ENCODER_ADDS]
    error = reading - s[TRACKED]
    s[TRACKED] += _DT * (s[TRACKED_RATE] + _TRACK_X * error)
    s[TRACKED_RATE] += _DT * _TRACK_V * error
    return reading


@compiled(error_model="numpy")
def _servo(angle, joint, t, s):  # type: ignore[no-untyped-def]
    """Angle and rate of a joint at `joint` that the firmware's loops close on; `angle`: the encoder's.

    Measured at the motor: the rotor's, less what the spring's own sensor says that it is wound up by. Backlash stays in it.
    """
    if t[ON_MOTOR] == 0.0:
        return angle, s[TRACKED_RATE]
    rotor = s[ROTOR]
    return rotor - _deflection(rotor - joint, t) + t[MOTOR_MOUNTED], s[RATE] - s[SLOPE] / t[MODEL_K]


@compiled(error_model="numpy")
def _asked(mode, q, v, w, t, s):  # type: ignore[no-untyped-def]
    """The torque that the set-point asks for at position q and velocity v, N·m."""
    if mode == _MODE_DAMPING:
        return -w[DAMPING] * v
    if mode == _MODE_TORQUE:
        return w[TORQUE]
    position = min(max(w[POSITION], t[LOWER]), t[UPPER])
    if mode == _MODE_POSITION:
        asked = w[TORQUE] + s[INTEGRAL] + t[POSITION_K] * (position - q)
        return asked + t[POSITION_D] * (w[VELOCITY] - v)
    return w[TORQUE] + w[STIFFNESS] * (position - q) + w[DAMPING] * (w[VELOCITY] - v)


@compiled(error_model="numpy")
def _switch_mode(mode, smooth, q, v, last_goal, w, t, s):  # type: ignore[no-untyped-def]
    """Take over a new mode: the torque goes on from where it was, and what is left over fades (`REST`).

    The position loop's integrator takes the difference up for good: it carries the load from its first cycle on.
    """
    if not smooth:
        s[REST] = 0.0
    if mode == s[MODE_BEFORE]:
        return
    s[MODE_BEFORE] = mode
    s[INTEGRAL] = 0.0
    if not smooth:
        return
    effort = t[EFFORT]
    if mode == _MODE_POSITION:
        s[INTEGRAL] = min(max(last_goal - _asked(mode, q, v, w, t, s), -effort), effort)
    s[REST] = last_goal - min(max(_asked(mode, q, v, w, t, s), -effort), effort)


@compiled(error_model="numpy")
def _within_limits(goal, effort, q, v, t, s):  # type: ignore[no-untyped-def]
    """The torque that the limits of speed and position leave of a goal.

    A speed controller stands by, and takes over where it asks for less in the goal's direction: its ceiling is the speed limit,
    and sinks to nothing at the joint's end. Its integrator (`HELD`) begins at the torque that it takes over.
    """
    sign, push, room = (1.0, goal, t[UPPER] - q) if goal >= 0.0 else (-1.0, -goal, q - t[LOWER])
    excess = sign * v - min(t[SPEED_MAX], APPROACH_RATE * room)
    if excess <= 0.0 and s[HELD] >= effort:
        return goal
    gain = t[SPEED_GAIN]
    held = max(min(s[HELD] - _DT * _SPEED_INTEGRAL * gain * excess, push), -effort)
    bound = max(held - gain * excess, -effort)
    if bound >= push:
        s[HELD] = effort
        return goal
    s[HELD] = held
    return sign * bound


@compiled(error_model="numpy")
def _goal(mode, derating, q, v, w, t, s):  # type: ignore[no-untyped-def]
    """The joint's torque goal for this cycle at position q and velocity v, N·m, and whether a limit acts on it."""
    effort = t[EFFORT] * derating
    asked = _asked(mode, q, v, w, t, s)
    goal = min(max(asked, -effort), effort)
    rest = s[REST]
    if rest != 0.0:
        rest = math.copysign(max(abs(rest) - MODE_SWITCH_RATE * t[EFFORT] * _DT, 0.0), rest)
        s[REST] = rest
        goal = min(max(goal + rest, -effort), effort)
    bounded = _within_limits(goal, effort, q, v, t, s)
    limited = abs(asked) > effort or bounded != goal
    if mode > _MODE_TORQUE:  # impedance, position
        wanted = w[POSITION]
        limited = limited or wanted > t[UPPER] + _BEYOND or wanted < t[LOWER] - _BEYOND
        if mode == _MODE_POSITION and not limited:  # what is saturated already must not wind up
            s[INTEGRAL] += t[POSITION_I] * (min(max(wanted, t[LOWER]), t[UPPER]) - q) * _DT
    return bounded, limited


@compiled(error_model="numpy")
def _deflection(angle, t):  # type: ignore[no-untyped-def]
    """rad that the spring is wound up by when the rotor is ahead by `angle`: nothing while the gear is loose."""
    slack = t[SLACK]
    return angle if slack == 0.0 else angle - min(max(angle, -slack), slack)


@compiled(error_model="numpy")
def _drive(goal, powered, derating, joint, joint_rate, t, s):  # type: ignore[no-untyped-def]
    """One cycle of the torque loop and of the actuator: feed-forward, PD and disturbance observer around the spring.

    `joint`, `joint_rate`: of the spring's far end. Returns the torque measured, the torque at the cycle's end, and whether
    the current limit acts.
    """
    rotor, rate = s[ROTOR], s[RATE]
    wound = _deflection(rotor - joint, t)
    sensed = (wound * (1.0 / _SPRING_QUANTUM) + _TO_WHOLE - _TO_WHOLE) * _SPRING_QUANTUM
    measured = t[MODEL_K] * sensed + t[TORQUE_ADDS]
    slope = s[SLOPE]
    slope += t[AF] * ((measured - s[LAST]) * FIRMWARE_HZ - slope)
    s[SLOPE], s[LAST] = slope, measured
    wanted, limited = 0.0, False
    if powered:
        kp = t[KP]
        feedback = kp * measured + t[KD] * slope
        set_point = goal - s[DISTURBANCE]
        most = t[CURRENT_MAX] * derating
        wanted = ((1.0 + kp) * set_point - feedback) / t[MODEL_NKT]
        if abs(wanted) > most:
            # The observer believes what the current limit lets through, so that it does not wind up.
            wanted, limited = math.copysign(most, wanted), True
            set_point = (wanted * t[MODEL_NKT] + feedback) / (1.0 + kp)
        a1, a2 = t[A1], t[A2]
        y = t[P0] * measured + s[X1]
        z = t[Q0] * set_point + s[Y1]
        s[X1] = t[P1] * measured - a1 * y + s[X2]
        s[X2] = t[P2] * measured - a2 * y
        s[Y1] = t[Q1] * set_point - a1 * z + s[Y2]
        s[Y2] = t[Q2] * set_point - a2 * z
        s[DISTURBANCE] = y - z
    else:
        s[DISTURBANCE] = s[X1] = s[X2] = s[Y1] = s[Y2] = 0.0
    current = s[CURRENT]
    current += t[AC] * (wanted - current)
    per_inertia = _DT * t[PER_J]
    rate += per_inertia * (t[NKT] * current - t[B] * rate - t[K] * wound)
    held = per_inertia * t[COULOMB]
    if held > 0.0:
        rate = 0.0 if abs(rate) <= held else rate - math.copysign(held, rate)
    rotor += _DT * rate
    s[CURRENT], s[RATE], s[ROTOR] = current, rate, rotor
    return measured, t[K] * _deflection(rotor - joint - _DT * joint_rate, t), limited


@compiled(error_model="numpy")
def _set_point(signals, j):  # type: ignore[no-untyped-def]
    return signals[POSITION, j], signals[VELOCITY, j], signals[TORQUE, j], signals[STIFFNESS, j], signals[DAMPING, j]


@compiled(error_model="numpy")
def run(cycles, q, v, memory):  # type: ignore[no-untyped-def]
    """`cycles` of the firmware for every actuator, for joints at `q`, going on at constant velocity `v` (n,).

    memory: an ActuatorMemory's. Writes the state, the readings and the mean torques at the joints, the last goals, and where a
    limit acted.
    """
    signals, table, state, seeds, pairs, rods, marks = actuator_parts(memory)
    q, v = borrowed(q), borrowed(v)
    for j in range(len(q)):
        if marks[PAIRED, j]:
            continue
        w, t, s, seed = _set_point(signals, j), table[j], state[j], seeds[j : j + 1]
        law, on, derated = marks[MODE, j], marks[POWERED, j] != 0, signals[DERATING, j]
        joint, rate = q[j], v[j]
        servo, servo_rate = _servo(signals[READING, j], joint, t, s)
        _switch_mode(law, marks[SMOOTH, j] != 0, servo, servo_rate, signals[GOAL, j], w, t, s)
        angle, mean, sensed, goal, any_limit = 0.0, 0.0, 0.0, 0.0, False
        for _ in range(cycles):
            angle = _read_encoder(joint, t, s, seed)
            over = False
            if on:
                servo, servo_rate = _servo(angle, joint, t, s)
                goal, over = _goal(law, derated, servo, servo_rate, w, t, s)
            measured, torque, current_over = _drive(goal, on, derated, joint, rate, t, s)
            sensed += measured
            mean += torque
            any_limit = any_limit or over or current_over
            joint += _DT * rate
        if not on:
            _forget(s)
        _tell(j, angle, s[TRACKED_RATE], sensed / cycles, mean / cycles, goal, any_limit, signals, marks)
    for m in range(len(pairs)):
        _run_pair(pairs[m, 0], pairs[m, 1], rods[m], cycles, q, v, signals, table, state, seeds, marks)


@compiled(error_model="numpy")
def _tell(j, angle, rate, sensed, mean, goal, limited, signals, marks):  # type: ignore[no-untyped-def]
    """Leave what others read of an actuator."""
    signals[READING, j], signals[READING_RATE, j], signals[READING_TORQUE, j] = angle, rate, sensed
    signals[SPRING, j], signals[GOAL, j], marks[LIMITED, j] = mean, goal, limited


@compiled(error_model="numpy")
def _forget(s):  # type: ignore[no-untyped-def]
    """Without power nothing is left of the set-point's past."""
    s[INTEGRAL] = s[REST] = 0.0
    s[HELD] = np.inf


@compiled(error_model="numpy")
def _run_pair(a, b, rods, cycles, q, v, signals, table, state, seeds, marks):  # type: ignore[no-untyped-def]
    """The same for joints that two actuators move together: goals in joint space, torque loops in the actuators' own.

    a: row of the pitch joint and of the left actuator, b: row of the roll joint and of the right actuator.
    """
    x, jacobian = np.empty(2), np.empty((2, 2))
    rod_lengths(q[a], q[b], rods, x, jacobian)
    ap, ar, bp, br = jacobian[0, 0], jacobian[0, 1], jacobian[1, 0], jacobian[1, 1]
    xa, xb, va, vb = x[0], x[1], ap * v[a] + ar * v[b], bp * v[a] + br * v[b]
    determinant = ap * br - ar * bp
    wa, ta, sa, law_a = _set_point(signals, a), table[a], state[a], marks[MODE, a]
    wb, tb, sb, law_b = _set_point(signals, b), table[b], state[b], marks[MODE, b]
    _switch_mode(
        law_a, marks[SMOOTH, a] != 0, signals[READING, a], signals[READING_RATE, a], signals[GOAL, a], wa, ta, sa
    )
    _switch_mode(
        law_b, marks[SMOOTH, b] != 0, signals[READING, b], signals[READING_RATE, b], signals[GOAL, b], wb, tb, sb
    )
    on = marks[POWERED, a] != 0 and marks[POWERED, b] != 0
    pitch, roll, derated = q[a], q[b], min(signals[DERATING, a], signals[DERATING, b])
    mean_a = mean_b = sensed_a = sensed_b = goal_a = goal_b = angle_a = angle_b = 0.0
    limit_a = limit_b = False
    for _ in range(cycles):
        angle_a = _read_encoder(pitch, ta, sa, seeds[a : a + 1])
        angle_b = _read_encoder(roll, tb, sb, seeds[b : b + 1])
        force_a = force_b = 0.0
        over_a = over_b = False
        if on:
            goal_a, over_a = _goal(law_a, derated, angle_a, sa[TRACKED_RATE], wa, ta, sa)
            goal_b, over_b = _goal(law_b, derated, angle_b, sb[TRACKED_RATE], wb, tb, sb)
            # F = J⁻ᵀ τ; beyond what an actuator can do both give way alike, so that the torques keep their direction.
            force_a = (br * goal_a - bp * goal_b) / determinant
            force_b = (ap * goal_b - ar * goal_a) / determinant
            most = max(abs(force_a) / ta[FORCE_MAX], abs(force_b) / tb[FORCE_MAX])
            if most > derated:
                share = derated / most
                force_a, force_b, goal_a, goal_b = share * force_a, share * force_b, share * goal_a, share * goal_b
                over_a = over_b = True
        measured_a, torque_a, current_a = _drive(force_a, on, derated, xa, va, ta, sa)
        measured_b, torque_b, current_b = _drive(force_b, on, derated, xb, vb, tb, sb)
        sensed_a, mean_a = sensed_a + measured_a, mean_a + torque_a
        sensed_b, mean_b = sensed_b + measured_b, mean_b + torque_b
        limit_a = limit_a or over_a or current_a or current_b
        limit_b = limit_b or over_b or current_a or current_b
        xa, xb, pitch, roll = xa + _DT * va, xb + _DT * vb, pitch + _DT * v[a], roll + _DT * v[b]
    if not on:
        _forget(sa)
        _forget(sb)
    sensed, mean = (ap * sensed_a + bp * sensed_b) / cycles, (ap * mean_a + bp * mean_b) / cycles
    _tell(a, angle_a, sa[TRACKED_RATE], sensed, mean, goal_a, limit_a, signals, marks)
    sensed, mean = (ar * sensed_a + br * sensed_b) / cycles, (ar * mean_a + br * mean_b) / cycles
    _tell(b, angle_b, sb[TRACKED_RATE], sensed, mean, goal_b, limit_b, signals, marks)
