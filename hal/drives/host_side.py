"""The host's side of a robot's frame program, compiled: what it writes in a cycle, and what it reads. Allocates nothing.

The same for every drive family; hal.drives.signals says what the tables are.
"""

from __future__ import annotations

import math

import numpy as np

from hal.can.frames import DATA, WORDS
from hal.device import COMMANDED
from hal.drives.borrowing import borrowed, piece
from hal.drives.fields import (
    COLUMN,
    END,
    ENTITY,
    EVERY,
    FIELD,
    FIRST,
    HEAD,
    LAW,
    LENGTH,
    PAYLOAD,
    ROLE,
    ROW,
    SEQUENCE,
    TIME,
    Field,
    Role,
)  # fmt: skip
from hal.drives.lifecycle import (
    COMMAND_OF_CONTROLWORD,
    FOLLOW,
    INTERNAL_LIMIT,
    NO_NUMBER,
    WARNING,
    State,
    statusword,
)
from hal.drives.order import is_fresh_answer, is_fresh_state
from hal.drives.parameter_frames import MOST_PARAMETERS, PARAMETER_COLUMNS, take_parameter
from hal.drives.rows import device_command, device_state, joint_command, joint_state
from hal.drives.signals import (
    begin,
    constant_of,
    frame_of,
    get_raw,
    get_value,
    joints_and_devices,
    mask_of,
    no_number,
    put_raw,
    put_value,
    sequence_of,
    sign,
    tables,
    valid,
)
from hal.drives.watch import grow_older, survey
from hal.joint import Mode
from handrail.compiled import compiled

NOTES = MOST_PARAMETERS * PARAMETER_COLUMNS
"""Words of the host's notes that are the parameter replies of the last batch. What is known of each joint and device follows: how
far its clock is behind, µs; a device's last sequence number."""

_TORQUE, _STIFFNESS, _DAMPING = int(Field.TORQUE), int(Field.STIFFNESS), int(Field.DAMPING)
_POSITION, _TEMPERATURE, _MODE = int(Field.POSITION), int(Field.TEMPERATURE), int(Field.MODE)
_CONTROLWORD, _STATUS, _STATE = int(Field.CONTROLWORD), int(Field.STATUS), int(Field.STATE)
_WARNING, _LIMIT, _ERROR, _WATCHDOG = int(Field.WARNING), int(Field.LIMIT), int(Field.ERROR), int(Field.WATCHDOG)
_COLUMN, _CONSTANT = int(Field.COLUMN), int(Field.CONSTANT)
_SEQUENCE, _CYCLE = int(Field.SEQUENCE), int(Field.CYCLE)
_R_CONTROL, _R_COMMAND = int(Role.CONTROL), int(Role.COMMAND)
_R_STATUS, _R_MASTER = int(Role.STATUS), int(Role.MASTER_STATUS)
_R_REPLY, _R_DEVICE_COMMAND = int(Role.PARAMETER_REPLY), int(Role.DEVICE_COMMAND)
_R_DEVICE_STATUS = int(Role.DEVICE_STATUS)
_WRITTEN = (_R_CONTROL, _R_COMMAND, _R_DEVICE_COMMAND, int(Role.SYNC), int(Role.HOLD_TIME))
_M_DAMPING, _M_TORQUE = int(Mode.DAMPING), int(Mode.TORQUE)
_STATUSWORDS = statusword(np.arange(len(State)))
_DRIFT = 1.0 / 8192.0


@compiled
def encode_host(words, code, roles, joint_memory, controlwords, device_memory, cycle, sequence, watchdog):
    """Write the frames of `roles` (bits, 1 << Role) in the order in which a host sends them; how many.

    Where both controlwords and commands are asked for, a limb gets commands if its controlword is FOLLOW, else controlwords.
    A device is written to when somebody commands it and its cycle has come. A value that is not finite ends it:
    −1 − (8 joint + field), or −1 − 8 n − (COMMANDED device + column).
    """
    words, controlwords = borrowed(words), borrowed(controlwords)
    frames, ops, scales, lookups, _, _, payloads, spans = tables(code)
    n, d = joints_and_devices(code)
    if controlwords.shape[0] < n:
        raise ValueError("controlwords: fewer than the robot has joints")
    table, mode = joint_command(joint_memory, n)
    device_values, device_commanded = device_command(device_memory, d)
    k, both = 0, (roles >> _R_CONTROL) & 1 and (roles >> _R_COMMAND) & 1
    for role in _WRITTEN:
        if not (roles >> role) & 1:
            continue
        for f in range(spans[role, 0], spans[role, 1]):
            entity, first = frames[f, ENTITY], WORDS * k + DATA
            if role == _R_DEVICE_COMMAND and not (device_commanded[entity] and cycle % frames[f, EVERY] == 0):
                continue
            if both and role <= _R_COMMAND and (controlwords[entity] == FOLLOW) != (role == _R_COMMAND):
                continue
            begin(words, k, np.uint64(frames[f, HEAD]))
            if role == _R_CONTROL and frames[f, PAYLOAD] >= 0:
                words[first] = payloads[frames[f, PAYLOAD] + COMMAND_OF_CONTROLWORD[0, controlwords[entity]]]
                k += 1
                continue
            for o in range(np.uint64(frames[f, FIRST]), np.uint64(frames[f, END])):
                field, row = np.uint64(ops[o, FIELD]), np.uint64(ops[o, ROW])
                value = 0.0
                if field <= _DAMPING:
                    value = table[field, row]
                    if not math.isfinite(value):
                        return -1 - np.int64(8 * row + field)
                    if frames[f, LAW] and (
                        (mode[row] == _M_TORQUE and field >= _STIFFNESS)
                        or (mode[row] == _M_DAMPING and field not in (_POSITION, _DAMPING))
                    ):
                        value = 0.0
                elif field == _MODE:
                    value = np.float64(mode[row])
                elif field == _CONTROLWORD:
                    value = np.float64(controlwords[row])
                elif field == _COLUMN:
                    value = device_values[row, ops[o, COLUMN]]
                    if not math.isfinite(value):
                        return -1 - 8 * n - (COMMANDED * np.int64(row) + np.int64(ops[o, COLUMN]))
                elif field == _SEQUENCE:
                    value = np.float64(sequence & 0xFF)
                elif field == _WATCHDOG:
                    value = np.float64(watchdog)
                elif field == _CYCLE:
                    value = np.float64(np.uint64(cycle) & mask_of(ops, o))
                elif field == _CONSTANT:
                    put_raw(words, first, ops, o, constant_of(ops, scales, o))
                    continue
                else:
                    continue
                put_value(words, first, ops, scales, lookups, o, value)
            sign(words, k, frames, f, ops)
            k += 1
    return k


@compiled
def _measured(words, k, time_op, ops, clocks, row):
    """When a frame's values were measured, ns of the bus's clock.

    The sender's clock runs free and wraps round; `clocks[row]` learns by how much it is behind: the least delay that was seen,
    creeping up, so that clocks may drift.
    """
    arrived = np.int64(words[WORDS * k])
    if time_op < 0:
        return arrived
    wrap = np.int64(1) << np.int64(ops[time_op, LENGTH])
    behind = np.float64((arrived // 1000 - np.int64(get_raw(words, WORDS * k + DATA, ops, time_op))) & (wrap - 1))
    if math.isnan(clocks[row]):
        clocks[row] = behind
        return arrived
    late = behind - clocks[row]
    if late >= wrap / 2:
        late -= wrap
    elif late < -wrap / 2:
        late += wrap
    if late <= 0.0:
        clocks[row] = behind
        return arrived
    clocks[row] += late * _DRIFT
    if clocks[row] >= wrap:
        clocks[row] -= wrap
    return arrived - np.int64(late * 1000.0)


@compiled
def hear(words, count, code, joint_memory, device_memory, notes, watch, sent, older):
    """A cycle's hearing: let everything be `older` cycles older, take the nodes' frames among the first `count` records in, and
    look at all drives; (good, refused, repeated, replies among the notes, late, lost, silent, time of the first record in ns).

    sent: sequence number of what was last sent, −1: unknown; watch: a DriveWatch's memory. One kernel, since calling one costs
    more than most of this does.
    """
    n, d = joints_and_devices(code)
    grow_older(joint_memory, n, device_memory, d, older)
    good, refused, repeated, replies = _take_in(words, count, code, joint_memory, device_memory, notes, sent)
    late, lost, silent = survey(joint_memory, n, watch)
    heard = np.int64(words[0]) if count > 0 else np.int64(0)
    return good, refused, repeated, replies, late, lost, silent, heard


@compiled
def _take_in(words, count, code, joint_memory, device_memory, notes, sent):
    """The nodes' frames among the first `count` records: (good, refused, repeated, replies).

    A frame with a number that is none is refused whole: NaN would go on from there into every joint's command.
    """
    words, notes = borrowed(words), borrowed(notes)
    frames, ops, scales, lookups, ids, long_ids, _, _ = tables(code)
    n, d = joints_and_devices(code)
    table, times, status, octets = joint_state(joint_memory, n)
    values, device_times = device_state(device_memory, d)
    rows = piece(notes, 0, (MOST_PARAMETERS, PARAMETER_COLUMNS), np.int64)
    clocks, last = piece(notes, NOTES, (n + d,), np.float64), piece(notes, NOTES + n + d, (d,), np.int64)
    good, refused, repeated, replies = 0, 0, 0, 0
    for k in range(count):
        f = frame_of(words, k, ids, long_ids)
        if f < 0:
            continue
        role = frames[f, ROLE]
        if role not in (_R_STATUS, _R_MASTER, _R_DEVICE_STATUS, _R_REPLY):
            continue
        if not valid(words, k, frames, f, ops, scales):
            refused += 1
            continue
        first, entity = WORDS * k + DATA, frames[f, ENTITY]
        if role == _R_REPLY:
            if replies < MOST_PARAMETERS:
                take_parameter(words, first, frames, f, ops, rows, replies)
                replies += 1
            continue
        device, sequence, lag = role == _R_DEVICE_STATUS, np.int64(0), np.int64(0)
        bad = no_number(words, k, frames, f, ops, scales, lookups)
        if bad >= 0:
            refused += 1
            if not device:
                octets[0, ops[bad, ROW]] = NO_NUMBER
            continue
        if frames[f, SEQUENCE] >= 0:
            sequence = sequence_of(words, first, frames, f, ops)
            if device:
                fresh = is_fresh_state(sequence, last[entity], device_times[0, entity])
            else:
                fresh = is_fresh_answer(sequence, np.int64(octets[1, entity]), times[0, entity], sent)
                if sent >= 0:
                    lag = (sent - sequence) & 0xFF
            if not fresh:
                repeated += 1
                continue
        good += 1
        measured = _measured(words, k, frames[f, TIME], ops, clocks, n + entity if device else entity)
        if device:
            device_times[0, entity], device_times[1, entity], last[entity] = 0, measured, sequence
        for o in range(frames[f, FIRST], frames[f, END]):
            field, row = ops[o, FIELD], ops[o, ROW]
            value = get_value(words, first, ops, scales, lookups, o)
            if field <= _TORQUE:
                table[field, row] = value
                if octets[0, row] == NO_NUMBER:
                    octets[0, row] = 0
            elif field == _COLUMN:
                values[row, ops[o, COLUMN]] = value
            elif field == _SEQUENCE:
                if not device:
                    times[0, row], times[1, row], octets[1, row] = lag, measured, sequence
            elif field == _STATUS:
                status[row] = np.uint16(np.int64(value))
            elif field == _ERROR:
                octets[0, row] = np.uint8(np.int64(value))
            elif field == _TEMPERATURE:
                table[3, row] = value
            elif field == _STATE:
                status[row] = _STATUSWORDS[np.int64(value) & 7]
            elif field == _WARNING:
                if value != 0.0:
                    status[row] |= np.uint16(WARNING)
            elif field == _LIMIT and value != 0.0:
                status[row] |= np.uint16(INTERNAL_LIMIT)
    return good, refused, repeated, replies
