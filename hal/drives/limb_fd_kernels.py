"""Compiled kernels of the limb FD protocol (hal.drives.limb_fd). Tables of places and scales come from the DBC."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from hal.can.arbitration import bus_of
from hal.can.codec import SCALE, START, get_raw, put_raw, to_raw
from hal.can.frames import DATA, FD, WORDS
from hal.drives.crc16 import crc16

LIMBS, AXES = 8, 7
"""What the frame identifiers have room for."""
COMMAND, CONTROL = 0, 1
"""Kinds of frames to a limb."""
SYNCS, HOLDS, CYCLE = 0, 1, 2
"""Entries of DriveTargets._host."""

# Rows of the command table: six an axis, then the frame's own.
_POSITION, _VELOCITY, _TORQUE, _STIFFNESS, _DAMPING, _MODE, _FIELDS = range(7)
_SEQUENCE, _WATCHDOG, _CRC = _FIELDS * AXES, _FIELDS * AXES + 1, _FIELDS * AXES + 2

_STIFFNESS_LOW, _STIFFNESS_HIGH = 0.1, 10_000.0  # N·m/rad
_DAMPING_LOW, _DAMPING_HIGH = 0.001, 1000.0  # N·m·s/rad


def _log_table(low: float, high: float) -> np.ndarray:
    """(256,) raw 0 → 0, raw r ≥ 1 → low (high/low)^((r−1)/254)."""
    table = low * (high / low) ** ((np.arange(256) - 1) / 254)
    table[0] = 0.0
    return table


STIFFNESS_OF_RAW = _log_table(_STIFFNESS_LOW, _STIFFNESS_HIGH)
"""(256,) N·m/rad; neighbours are 4.6 % apart."""
DAMPING_OF_RAW = _log_table(_DAMPING_LOW, _DAMPING_HIGH)
"""(256,) N·m·s/rad; neighbours are 5.6 % apart."""


@njit(cache=True)
def log_raw(value, low, high):
    """The raw value nearest to `value` on the logarithmic scale; 0 below half of `low`."""
    if value < 0.5 * low:
        return np.int64(0)
    return np.int64(min(max(np.rint(1.0 + 254.0 / math.log(high / low) * math.log(value / low)), 1.0), 255.0))


@njit(cache=True)
def _begin(words, row, head):
    words[WORDS * row] = np.uint64(0)
    words[WORDS * row + 1] = head
    for i in range(8):
        words[WORDS * row + DATA + i] = np.uint64(0)


@njit(cache=True)
def _sign(words, row, places, crc):
    """Write the CRC over all bytes before it."""
    first = WORDS * row + DATA
    put_raw(words, first, places, crc, crc16(words, first, places[crc, START] >> 3))


@njit(cache=True)
def _valid(words, row, places, crc):
    """Is this a CAN FD frame that is long enough, with the right CRC?"""
    head, first = words[WORDS * row + 1], WORDS * row + DATA
    if not (head >> np.uint64(40)) & np.uint64(FD):
        return False
    size = places[crc, START] >> 3
    if np.int64((head >> np.uint64(32)) & np.uint64(0xFF)) < size + 2:
        return False
    return get_raw(words, first, places, crc) == crc16(words, first, size)


@njit(cache=True)
def encode_commands(
    words, heads, axis_joint, position, velocity, torque, stiffness, damping, mode, sequence, watchdog, places, scales
):
    """Frames written, or −1 − (8 joint + field) for the first value that is not finite."""
    for limb in range(axis_joint.shape[0]):
        _begin(words, limb, heads[limb])
        first = WORDS * limb + DATA
        for axis in range(AXES):
            joint, row = axis_joint[limb, axis], _FIELDS * axis
            if joint < 0:
                continue
            values = (position[joint], velocity[joint], torque[joint], stiffness[joint], damping[joint])
            for field in range(5):
                if not math.isfinite(values[field]):
                    return -1 - (8 * joint + field)
            for field in range(3):
                raw = to_raw(values[field], scales, row + field)
                put_raw(words, first, places, row + field, raw)
            put_raw(words, first, places, row + _STIFFNESS, log_raw(stiffness[joint], _STIFFNESS_LOW, _STIFFNESS_HIGH))
            put_raw(words, first, places, row + _DAMPING, log_raw(damping[joint], _DAMPING_LOW, _DAMPING_HIGH))
            put_raw(words, first, places, row + _MODE, np.int64(mode[joint]))
        put_raw(words, first, places, _SEQUENCE, np.int64(sequence))
        put_raw(words, first, places, _WATCHDOG, np.int64(watchdog))
        _sign(words, limb, places, _CRC)
    return axis_joint.shape[0]


@njit(cache=True)
def encode_control(words, heads, axis_joint, controlwords, sequence, places, scales):
    """Frames written."""
    for limb in range(axis_joint.shape[0]):
        _begin(words, limb, heads[limb])
        first = WORDS * limb + DATA
        for axis in range(AXES):
            joint = axis_joint[limb, axis]
            if joint >= 0:
                put_raw(words, first, places, axis, np.int64(controlwords[joint]))
        put_raw(words, first, places, AXES, np.int64(sequence))
        _sign(words, limb, places, AXES + 1)
    return axis_joint.shape[0]


@njit(cache=True)
def encode_cycle(words, head, channels, cycle):
    """Sync or HoldTime on every channel; frames written."""
    for bus in range(channels):
        _begin(words, bus, head | np.uint64(bus) << np.uint64(48))
        words[WORDS * bus + DATA] = np.uint64(cycle) & np.uint64(0xFFFFFFFF)
    return channels


@njit(cache=True)
def decode_host(
    words, n, limb_of_id, limb_bus, axis_joint, sync_id, hold_id, position, velocity, torque, stiffness, damping, mode,
    commanded, controlword, controlled, echo, watchdog, host, places, scales, control_places,
):  # fmt: skip
    """(good, refused)"""
    commanded[:] = False
    controlled[:] = False
    host[SYNCS], host[HOLDS] = 0, 0
    good, refused = 0, 0
    for k in range(n):
        can_id = np.int64(words[WORDS * k + 1] & np.uint64(0xFFFFFFFF))
        if can_id >= 2048:
            continue
        first, bus = WORDS * k + DATA, bus_of(words, k)
        if can_id in (sync_id, hold_id):
            if bus == 0:
                host[SYNCS if can_id == sync_id else HOLDS] += 1
                host[CYCLE] = np.int64(words[first] & np.uint64(0xFFFFFFFF))
            good += 1
            continue
        limb = limb_of_id[COMMAND, can_id]
        if limb >= 0 and limb_bus[limb] == bus:
            if not _valid(words, k, places, _CRC):
                refused += 1
                continue
            for axis in range(AXES):
                joint, row = axis_joint[limb, axis], _FIELDS * axis
                if joint < 0:
                    continue
                position[joint] = get_raw(words, first, places, row) * scales[row, SCALE]
                velocity[joint] = get_raw(words, first, places, row + _VELOCITY) * scales[row + _VELOCITY, SCALE]
                torque[joint] = get_raw(words, first, places, row + _TORQUE) * scales[row + _TORQUE, SCALE]
                stiffness[joint] = STIFFNESS_OF_RAW[get_raw(words, first, places, row + _STIFFNESS)]
                damping[joint] = DAMPING_OF_RAW[get_raw(words, first, places, row + _DAMPING)]
                mode[joint] = get_raw(words, first, places, row + _MODE)
                watchdog[joint] = get_raw(words, first, places, _WATCHDOG)
                echo[joint] = get_raw(words, first, places, _SEQUENCE)
                commanded[joint] = True
            good += 1
            continue
        limb = limb_of_id[CONTROL, can_id]
        if limb >= 0 and limb_bus[limb] == bus:
            if not _valid(words, k, control_places, AXES + 1):
                refused += 1
                continue
            for axis in range(AXES):
                joint = axis_joint[limb, axis]
                if joint >= 0:
                    controlword[joint] = get_raw(words, first, control_places, axis)
                    echo[joint] = get_raw(words, first, control_places, AXES)
                    controlled[joint] = True
            good += 1
    return good, refused


@njit(cache=True)
def _finite(value):
    return value if math.isfinite(value) else 0.0


@njit(cache=True)
def encode_status(
    words, heads, answer, position, velocity, torque, status, temperature, error, sequence, mode, places, scales
):
    """Frames written."""
    k = 0
    for joint in range(answer.shape[0]):
        if not answer[joint]:
            continue
        _begin(words, k, heads[joint])
        first = WORDS * k + DATA
        put_raw(words, first, places, 0, to_raw(_finite(position[joint]), scales, 0))
        put_raw(words, first, places, 1, to_raw(_finite(velocity[joint]), scales, 1))
        put_raw(words, first, places, 2, to_raw(_finite(torque[joint]), scales, 2))
        put_raw(words, first, places, 3, np.int64(status[joint]))
        put_raw(words, first, places, 4, to_raw(_finite(temperature[joint]), scales, 4))
        put_raw(words, first, places, 5, np.int64(error[joint]))
        put_raw(words, first, places, 6, np.int64(sequence[joint]))
        put_raw(words, first, places, 7, np.int64(mode[joint]))
        _sign(words, k, places, 8)
        k += 1
    return k


@njit(cache=True)
def decode_status(
    words,
    n,
    joint_of_id,
    joint_bus,
    position,
    velocity,
    torque,
    temperature,
    status,
    error,
    sequence,
    age,
    places,
    scales,
):
    """(good, refused)"""
    good, refused = 0, 0
    for k in range(n):
        can_id = np.int64(words[WORDS * k + 1] & np.uint64(0xFFFFFFFF))
        if can_id >= 2048:
            continue
        joint = joint_of_id[can_id]
        if joint < 0 or joint_bus[joint] != bus_of(words, k):
            continue
        if not _valid(words, k, places, 8):
            refused += 1
            continue
        first = WORDS * k + DATA
        position[joint] = get_raw(words, first, places, 0) * scales[0, SCALE]
        velocity[joint] = get_raw(words, first, places, 1) * scales[1, SCALE]
        torque[joint] = get_raw(words, first, places, 2) * scales[2, SCALE]
        status[joint] = get_raw(words, first, places, 3)
        temperature[joint] = get_raw(words, first, places, 4) * scales[4, SCALE]
        error[joint] = get_raw(words, first, places, 5)
        sequence[joint] = get_raw(words, first, places, 6)
        age[joint] = 0
        good += 1
    return good, refused
