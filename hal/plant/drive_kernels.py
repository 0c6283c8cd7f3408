"""What drives do by themselves in a millisecond, and with what the bus brings them, compiled.

All that drives remember is one piece of memory, as with their actuators (hal.plant.actuator_kernels), and for the same reason.
Its parts have a column a drive, and are named here; `drives` and `actuators` are such memories.
"""

from __future__ import annotations

import numpy as np

from hal.drives.borrowing import borrowed
from hal.drives.lifecycle import COMMAND_OF_CONTROLWORD, INTERNAL_LIMIT, TRANSITION, WARNING, DriveError, State
from hal.joint import COMMANDED, Mode
from hal.plant.actuator_kernels import (
    CURRENT,
    DAMPING,
    DERATING,
    LIMITED,
    MODE,
    POSITION,
    POWERED,
    READING,
    READING_RATE,
    READING_TORQUE,
    SMOOTH,
    STIFFNESS,
    TORQUE,
    VELOCITY,
    actuator_parts,
    run,
)
from handrail.compiled import compiled

STEP_NS = 1_000_000
"""one step of the plant"""
QUICK_STOP_NS = 250_000_000
"""how long a quick stop damps before the brake closes"""
QUICK_STOP_RATE = 10.0
"""1/s, of a quick stop's stiffness to its damping: a load that grows on the way moves the joint by little, and ever more slowly"""
BRAKE_RELEASE_NS = 50_000_000
"""from the first command to the open brake: the spring takes the load up meanwhile, so that nothing drops"""
AMBIENT = 25.0
"""°C"""
UNDERVOLTAGE = 36.0
"""V: where a drive faults"""
NEVER = -1

# Rows of the values: °C, and the temperatures at which a drive warns and faults; V; K per A²; rad/s at which it trips; N·m·s/rad.
TEMPERATURE, WARM, HOT, VOLTAGE, HEAT, OVERSPEED, QUICK_STOP_DAMPING = range(7)
# Rows of the times, ns: when a command came last and how long the next may stay away, when the first one came, when the drive
# stopped, since when it has been too fast.
HEARD, INTERVAL, FIRST_COMMAND, STOPPED, FAST = range(5)
# Rows of the marks, one byte each: state, error, whether the brake is closed, the last controlword, where it leads to.
STATE, ERROR, BRAKED, CONTROLWORD, NEXT = range(5)
_VALUES, _TIMES, _MARKS = 7, 5, 5
_HEAD = 3

THERMAL_TIME_CONSTANT = 600.0
"""s"""
_LEAST_DERATING = 1e-3
# A drive trips when the joint runs too fast for so long: a blow alone does not trip it.
_OVERSPEED_NS = 5_000_000
_ENABLED, _QUICK_STOP, _FAULT = int(State.OPERATION_ENABLED), int(State.QUICK_STOP_ACTIVE), int(State.FAULT)
_WATCHDOG, _INTERNAL = int(DriveError.WATCHDOG), int(DriveError.INTERNAL)
_OVERTEMPERATURE, _TOO_FAST = int(DriveError.OVERTEMPERATURE), int(DriveError.OVERSPEED)
_NO_POWER = int(DriveError.UNDERVOLTAGE)
_IMPEDANCE = int(Mode.IMPEDANCE)
_WARNING, _INTERNAL_LIMIT = np.uint16(WARNING), np.uint16(INTERNAL_LIMIT)
_SET_POINTS = len(COMMANDED)


class DriveMemory:
    """n drives. All parts are views of `memory`: never rebind them."""

    def __init__(self, n: int, period_ns: int, watchdog_cycles: int):
        """period_ns: of the host; watchdog_cycles: how many of them a drive goes on alone, if a command does not say."""
        self.memory = np.zeros(_HEAD + (_VALUES + _TIMES) * n + ((2 + _MARKS) * n + 7) // 8, np.int64)
        """n, period, cycles, and everything below"""
        self.memory[:_HEAD] = n, period_ns, watchdog_cycles
        values, times, rest = np.split(self.memory[_HEAD:], (_VALUES * n, (_VALUES + _TIMES) * n))
        self.values = values.view(np.float64).reshape(_VALUES, n)
        self.times = times.reshape(_TIMES, n)
        octets = rest.view(np.uint8)
        self.flags = octets[: 2 * n].view(np.uint16)
        """statusword's bits 7 and 11"""
        self.marks = octets[2 * n : (2 + _MARKS) * n].reshape(_MARKS, n)


@compiled
def drive_parts(memory):  # type: ignore[no-untyped-def]
    """values, times, flags, marks of a DriveMemory's memory"""
    memory = borrowed(memory)
    n = memory[0]
    times = _HEAD + _VALUES * n
    rest = times + _TIMES * n
    octets = memory[rest:].view(np.uint8)
    return (
        memory[_HEAD:times].view(np.float64).reshape(_VALUES, n),
        memory[times:rest].reshape(_TIMES, n),
        octets[: 2 * n].view(np.uint16),
        octets[2 * n : (2 + _MARKS) * n].reshape(_MARKS, n),
    )


@compiled
def climb(words, addressed, drives):  # type: ignore[no-untyped-def]
    """Note controlwords (n,) of the drives that are addressed, and in NEXT where they lead every drive. True if anywhere."""
    _, _, _, marks = drive_parts(drives)
    words, addressed = borrowed(words), borrowed(addressed)
    moves = False
    for j in range(len(words)):
        marks[NEXT, j] = marks[STATE, j]
        if addressed[j]:
            command = COMMAND_OF_CONTROLWORD[marks[CONTROLWORD, j] >> 7, words[j]]
            marks[NEXT, j] = TRANSITION[marks[STATE, j], command]
            marks[CONTROLWORD, j] = words[j]
            moves = moves or marks[NEXT, j] != marks[STATE, j]
    return moves


@compiled
def take(now, given, modes, addressed, cycles, drives, actuators):  # type: ignore[no-untyped-def]
    """Copy set-points, a JointCommand's table and modes, to the drives that are addressed and enabled, and feed their watchdogs.

    cycles (n,): how many of the host's a drive goes on without another command; 0: as usual.
    """
    _, times, _, marks = drive_parts(drives)
    signals, _, _, _, _, _, traits = actuator_parts(actuators)
    given, modes, addressed, cycles = borrowed(given), borrowed(modes), borrowed(addressed), borrowed(cycles)
    period, usual = drives[1], drives[2]
    for j in range(len(modes)):
        if not addressed[j] or marks[STATE, j] != _ENABLED:
            continue
        for row in range(_SET_POINTS):
            signals[row, j] = given[row, j]
        traits[MODE, j] = modes[j]
        times[HEARD, j] = now
        times[INTERVAL, j] = (cycles[j] if cycles[j] > 0 else usual) * period
        if times[FIRST_COMMAND, j] == NEVER:
            times[FIRST_COMMAND, j] = now


@compiled
def step(now, firmware_cycles, position, velocity, drives, actuators):  # type: ignore[no-untyped-def]
    """A millisecond of drives and actuators, for joints at `position` and `velocity` (n,). True when a brake opened or closed."""
    moved = _live(now, drives, actuators)
    moved = _stop_left_alone(drives, actuators) or moved
    run(firmware_cycles, position, velocity, actuators)
    return moved


@compiled
def _live(now, drives, actuators):  # type: ignore[no-untyped-def]
    """What every drive does by itself. True when a brake opened or closed."""
    values, times, flags, marks = drive_parts(drives)
    signals, _, state, _, _, _, traits = actuator_parts(actuators)
    moved = False
    for j in range(len(flags)):
        warm, hot, current = values[WARM, j], values[HOT, j], state[j, CURRENT]
        temperature = values[TEMPERATURE, j]
        excess = AMBIENT + values[HEAT, j] * current**2 - temperature
        temperature += STEP_NS * 1e-9 / THERMAL_TIME_CONSTANT * excess
        values[TEMPERATURE, j] = temperature
        flags[j] = _INTERNAL_LIMIT if traits[LIMITED, j] and traits[POWERED, j] else 0
        signals[DERATING, j] = 1.0
        if temperature > warm:
            flags[j] |= _WARNING
            signals[DERATING, j] = max((hot - temperature) / (hot - warm), _LEAST_DERATING)
        if abs(signals[READING_RATE, j]) <= values[OVERSPEED, j]:
            times[FAST, j] = NEVER
        elif times[FAST, j] == NEVER:
            times[FAST, j] = now
        tripped = 0
        if marks[STATE, j] == _ENABLED:
            if temperature > hot:
                tripped = _OVERTEMPERATURE
            elif times[FAST, j] != NEVER and now - times[FAST, j] >= _OVERSPEED_NS:
                tripped = _TOO_FAST
        if values[VOLTAGE, j] < UNDERVOLTAGE and marks[STATE, j] != _FAULT:
            tripped = _NO_POWER
        if tripped:
            moved = _fault(j, tripped, marks, traits) or moved
        if marks[STATE, j] == _ENABLED:
            first = times[FIRST_COMMAND, j]
            if now - times[HEARD, j] > times[INTERVAL, j]:
                marks[STATE, j], marks[ERROR, j] = _QUICK_STOP, _WATCHDOG
                traits[MODE, j], signals[DAMPING, j] = _IMPEDANCE, values[QUICK_STOP_DAMPING, j]
                signals[TORQUE, j] = signals[READING_TORQUE, j]
                signals[POSITION, j], signals[VELOCITY, j] = signals[READING, j], 0.0
                signals[STIFFNESS, j] = QUICK_STOP_RATE * values[QUICK_STOP_DAMPING, j]
                times[STOPPED, j] = now
            elif marks[BRAKED, j] and first != NEVER and now - first >= BRAKE_RELEASE_NS:
                marks[BRAKED, j] = False
                moved = True
        elif marks[STATE, j] == _QUICK_STOP and traits[POWERED, j] and now - times[STOPPED, j] >= QUICK_STOP_NS:
            traits[POWERED, j] = False
            moved = moved or not marks[BRAKED, j]
            marks[BRAKED, j] = True
        # A stop acts at once, and behind a closed brake nothing can jump.
        traits[SMOOTH, j] = marks[STATE, j] == _ENABLED and not marks[BRAKED, j]
    return moved


@compiled
def _fault(j, error, marks, traits):  # type: ignore[no-untyped-def]
    """Stop a drive for good. True when its brake closed."""
    opened = not marks[BRAKED, j]
    marks[STATE, j], marks[ERROR, j], marks[BRAKED, j] = _FAULT, error, True
    traits[POWERED, j] = False
    return opened


@compiled
def _stop_left_alone(drives, actuators):  # type: ignore[no-untyped-def]
    """Of two drives that move their joints together, none does anything alone: where one is off, the other faults."""
    _, _, _, marks = drive_parts(drives)
    _, _, _, _, pairs, _, traits = actuator_parts(actuators)
    moved = False
    for m in range(len(pairs)):
        pitch, roll = pairs[m, 0], pairs[m, 1]
        if traits[POWERED, pitch] != traits[POWERED, roll]:
            left = pitch if traits[POWERED, pitch] else roll
            if not marks[BRAKED, left]:
                moved = _fault(left, _INTERNAL, marks, traits) or moved
    return moved
