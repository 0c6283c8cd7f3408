"""The drives' and devices' side of a robot's frame program, compiled: what they hear, and what they answer. Allocates nothing.

The same for every drive family; hal.drives.signals says what the tables are. Nodes are the joints' drives, then the devices.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from hal.can.arbitration import bus_of
from hal.can.frames import DATA, WORDS
from hal.device import COMMANDED as DEVICE_COLUMNS
from hal.drives.borrowing import borrowed, piece
from hal.drives.fields import (
    COLUMN,
    END,
    ENTITY,
    EVERY,
    FIELD,
    FIRST,
    HEAD,
    LENGTH,
    MEMBERS,
    PAYLOAD,
    ROLE,
    ROW,
    SEQUENCE,
    START,
    Field,
    Role,
)  # fmt: skip
from hal.drives.lifecycle import (
    COMMAND_OF_CONTROLWORD,
    CONTROLWORD,
    INTERNAL_LIMIT,
    STATE_OF_STATUSWORD,
    WARNING,
    Command,
)
from hal.drives.order import LATE, NEXT, order_at_drive
from hal.drives.parameter_frames import MOST_PARAMETERS, PARAMETER_COLUMNS, take_parameter
from hal.drives.rows import device_command, joint_command, joint_state
from hal.drives.signals import (
    begin,
    constant_of,
    frame_of,
    get_raw,
    get_value,
    joints_and_devices,
    no_number,
    put_raw,
    put_value,
    sequence_of,
    sign,
    tables,
    valid,
    words_of,
)
from handrail.compiled import compiled

COMMANDED, CONTROLLED, ANSWERS, OWED, WORD, ECHO, WATCHDOG, HEARD, ORDER, DEAF = range(10)
"""Rows of a target's flags (FLAGS, nodes) uint8: in this batch, was commanded, was controlled, owes an answer; owes a frame, until
somebody clears it; controlword, sequence, watchdog, any frame ever came, hal.drives.order of the last frame, hears nothing."""
FLAGS = 10
SYNCS, HOLDS, CYCLE, REQUESTS, REPEATED, TURNS, CONTROLS, COMMANDS, TOLD, PATIENCE, DRIVES, NODES = range(12)
"""Entries of what a target knows: of Syncs, HoldTimes and requests in this batch, and the cycle that they told; of frames so far
that were refused for their order, and of Syncs; how many of this batch's controlwords, set-points and device commands reached
somebody; the nodes' own watchdog, in cycles; how many drives and nodes there are."""
HOST = 12
ROWS = HOST + MOST_PARAMETERS * PARAMETER_COLUMNS
"""Where a target's memory goes on behind these entries and the parameter requests: nodes' last hearing, then `places`."""


_DAMPING, _TORQUE, _TEMPERATURE = int(Field.DAMPING), int(Field.TORQUE), int(Field.TEMPERATURE)
_MODE, _CONTROLWORD, _STATUS, _STATE = int(Field.MODE), int(Field.CONTROLWORD), int(Field.STATUS), int(Field.STATE)
_WARNING, _LIMIT, _ERROR, _WATCHDOG = int(Field.WARNING), int(Field.LIMIT), int(Field.ERROR), int(Field.WATCHDOG)
_COLUMN, _CONSTANT = int(Field.COLUMN), int(Field.CONSTANT)
_SEQUENCE, _TIME = int(Field.SEQUENCE), int(Field.TIME)
_R_CONTROL, _R_COMMAND, _R_SYNC, _R_HOLD = int(Role.CONTROL), int(Role.COMMAND), int(Role.SYNC), int(Role.HOLD_TIME)
_R_REQUEST, _R_DEVICE_COMMAND = int(Role.PARAMETER_REQUEST), int(Role.DEVICE_COMMAND)
_R_DEVICE_STATUS = int(Role.DEVICE_STATUS)
_ANSWERED = (int(Role.STATUS), int(Role.MASTER_STATUS), _R_DEVICE_STATUS)
_SWITCH_ON, _ENABLE = int(Command.SWITCH_ON), int(Command.ENABLE_OPERATION)


@compiled
def places(n, nodes):
    """Where in a target's memory flags, JointCommand and DeviceCommand of its drives (n) and devices begin; where it ends."""
    flags = ROWS + nodes
    command = flags + (FLAGS * nodes + 7) // 8
    devices = command + 5 * n + (n + 7) // 8
    return flags, command, devices, devices + DEVICE_COLUMNS * (nodes - n) + (nodes - n + 7) // 8


@njit(inline="always")
def _listen(words, first, f, frames, ops, memory, flags, now, check):
    """Who of those that a frame is for takes it as what (the flags' ORDER); how many do, and how many refuse it for its order."""
    taken, late = 0, 0
    device = frames[f, ROLE] == _R_DEVICE_COMMAND
    sequence = sequence_of(words, first, frames, f, ops) if frames[f, SEQUENCE] >= 0 else np.int64(-1)
    for o in range(frames[f, MEMBERS], frames[f, END]):
        if ops[o, FIELD] != _SEQUENCE:
            break
        node = ops[o, ROW] + (memory[DRIVES] if device else 0)
        if flags[DEAF, node]:
            flags[ORDER, node] = LATE
            continue
        order = NEXT
        if check and sequence >= 0:
            patience = np.int64(flags[WATCHDOG, node])
            patience = (patience if patience > 0 else memory[PATIENCE]) + frames[f, EVERY] - 1
            order = order_at_drive(
                sequence, np.int64(flags[ECHO, node]), flags[HEARD, node], now - memory[ROWS + node], patience
            )
        flags[ORDER, node] = order
        if order == LATE:
            late += 1
            continue
        taken += 1
        memory[ROWS + node] = now
        flags[HEARD, node] = 1
        if sequence >= 0:
            flags[ECHO, node] = sequence
        if device:
            flags[COMMANDED, node] = 1
            memory[TOLD] += 1
        else:
            flags[ANSWERS, node] = flags[OWED, node] = 1
    return taken, late


@compiled
def decode_host(records, count, code, memory, cycle, check):
    """Take the host's frames among the first `count` records in; (good, refused).

    memory: a target's. cycle: host cycles that have passed on the nodes' own clock; −1: as many as Syncs have come. check: frames
    whose sequence does not go on count for nothing, and one that begins a stream does not take a drive further.
    """
    words, memory = words_of(records), borrowed(memory)
    frames, ops, scales, lookups, ids, long_ids, payloads, spans = tables(code)
    n, nodes = memory[DRIVES], memory[NODES]
    flags_at, command_at, devices_at, _ = places(n, nodes)
    requests = piece(memory, HOST, (MOST_PARAMETERS, PARAMETER_COLUMNS), np.int64)
    flags = piece(memory, flags_at, (FLAGS, nodes), np.uint8)
    table, mode = joint_command(memory, n, command_at)
    device_values, _ = device_command(memory, nodes - n, devices_at)
    flags[COMMANDED : ANSWERS + 1, :] = 0
    memory[SYNCS] = memory[HOLDS] = memory[REQUESTS] = memory[CONTROLS] = memory[COMMANDS] = memory[TOLD] = 0
    good, refused = 0, 0
    for k in range(count):
        f = frame_of(words, k, ids, long_ids)
        if f < 0:
            continue
        role, first, entity = frames[f, ROLE], WORDS * k + DATA, frames[f, ENTITY]
        if role in (_R_SYNC, _R_HOLD):
            good += 1
            if bus_of(words, k) == 0:
                memory[SYNCS if role == _R_SYNC else HOLDS] += 1
                memory[CYCLE] = np.int64(get_raw(words, first, ops, frames[f, FIRST]))
                if role == _R_SYNC:
                    memory[TURNS] += 1
                    for g in range(spans[_R_DEVICE_STATUS, 0], spans[_R_DEVICE_STATUS, 1]):
                        if n + frames[g, ENTITY] < nodes and memory[TURNS] % frames[g, EVERY] == 0:
                            flags[OWED, n + frames[g, ENTITY]] = 1
            continue
        if role == _R_COMMAND and frames[f, PAYLOAD] >= 0:
            taken = -1
            for command in range(6):
                if taken < 0 and words[first] == payloads[frames[f, PAYLOAD] + command]:
                    taken = command
            if taken >= 0 and np.int64((words[WORDS * k + 1] >> np.uint64(32)) & np.uint64(0xFF)) == 8:
                good += 1
                if not flags[DEAF, entity]:
                    flags[WORD, entity] = CONTROLWORD[taken]
                    flags[CONTROLLED, entity] = flags[ANSWERS, entity] = flags[OWED, entity] = 1
                    memory[CONTROLS] += 1
                continue
        if role not in (_R_COMMAND, _R_CONTROL, _R_REQUEST, _R_DEVICE_COMMAND):
            continue
        device = role == _R_DEVICE_COMMAND
        if device and n + entity >= nodes:
            continue
        if not valid(words, k, frames, f, ops, scales):
            refused += 1
            continue
        if role == _R_REQUEST:
            if memory[REQUESTS] < MOST_PARAMETERS:
                take_parameter(words, first, frames, f, ops, requests, memory[REQUESTS])
                memory[REQUESTS] += 1
            good += 1
            continue
        if no_number(words, k, frames, f, ops, scales, lookups) >= 0:
            refused += 1
            continue
        now = cycle if cycle >= 0 else memory[TURNS]
        took, late = _listen(words, first, f, frames, ops, memory, flags, now, check)
        if took == 0:
            memory[REPEATED] += late > 0
            continue
        good += 1
        for o in range(np.uint64(frames[f, FIRST]), np.uint64(frames[f, END])):
            field, row = np.uint64(ops[o, FIELD]), np.uint64(ops[o, ROW])
            node = np.uint64(n) + row if device else row
            if flags[ORDER, node] == LATE:
                continue
            value = get_value(words, first, ops, scales, lookups, o)
            if field <= _DAMPING:
                table[field, row] = value
            elif field == _MODE:
                mode[row] = np.uint8(np.int64(value))
                flags[COMMANDED, row] = 1
                memory[COMMANDS] += 1
            elif field == _CONTROLWORD:
                flags[WORD, row] = np.uint8(np.int64(value))
                if flags[ORDER, row] == NEXT or COMMAND_OF_CONTROLWORD[1, flags[WORD, row]] not in (
                    _SWITCH_ON,
                    _ENABLE,
                ):
                    flags[CONTROLLED, row] = 1
                    memory[CONTROLS] += 1
            elif field == _WATCHDOG:
                flags[WATCHDOG, node] = np.uint8(np.int64(value))
            elif field == _COLUMN:
                device_values[row, ops[o, COLUMN]] = value
    return good, refused


@compiled
def _finite(value):
    return value if math.isfinite(value) else 0.0


@compiled
def encode_answers(records, code, owed, joint_memory, mode, device_values, device_sequence, time_us, senders):
    """Write the frames of the nodes that owe one (nodes,), and their numbers into `senders`; how many.

    Each frame of a device has its next sequence number.
    """
    words, owed, mode = words_of(records), borrowed(owed), borrowed(mode)
    device_values, device_sequence, senders = borrowed(device_values), borrowed(device_sequence), borrowed(senders)
    frames, ops, scales, lookups, _, _, _, spans = tables(code)
    n, d = joints_and_devices(code)
    if mode.shape[0] < n or owed.shape[0] < n + d:
        raise ValueError("mode, owed: fewer than the robot has joints, and nodes")
    table, _, status, octets = joint_state(joint_memory, n)
    k = 0
    for role in _ANSWERED:
        device = role == _R_DEVICE_STATUS
        for f in range(spans[role, 0], spans[role, 1]):
            node = frames[f, ENTITY] + (n if device else 0)
            if not owed[node]:
                continue
            begin(words, k, np.uint64(frames[f, HEAD]))
            first, senders[k] = WORDS * k + DATA, node
            if device:
                device_sequence[node - n] = (device_sequence[node - n] + 1) & 0xFF
            for o in range(frames[f, FIRST], frames[f, END]):
                field, row = ops[o, FIELD], ops[o, ROW]
                value = 0.0
                if field <= _TORQUE:
                    value = _finite(table[field, row])
                elif field == _COLUMN:
                    value = _finite(device_values[row, ops[o, COLUMN]])
                elif field == _TEMPERATURE:
                    # Where several axes share the signal, it is the hottest one's.
                    for other in range(frames[f, FIRST], frames[f, END]):
                        if ops[other, FIELD] == _TEMPERATURE and ops[other, START] == ops[o, START]:
                            value = max(value, _finite(table[3, ops[other, ROW]]))
                elif field == _STATUS:
                    value = np.float64(status[row])
                elif field == _STATE:
                    value = np.float64(STATE_OF_STATUSWORD[status[row] & 0x7F])
                elif field == _WARNING:
                    value = np.float64((status[row] & WARNING) != 0)
                elif field == _LIMIT:
                    value = np.float64((status[row] & INTERNAL_LIMIT) != 0)
                elif field == _ERROR:
                    value = np.float64(octets[0, row])
                elif field == _SEQUENCE:
                    value = np.float64(device_sequence[row] if device else octets[1, row])
                elif field == _MODE:
                    value = np.float64(mode[row])
                elif field == _TIME:
                    value = np.float64(time_us & ((1 << ops[o, LENGTH]) - 1))
                elif field == _CONSTANT:
                    put_raw(words, first, ops, o, constant_of(ops, scales, o))
                    continue
                else:
                    continue
                put_value(words, first, ops, scales, lookups, o, value)
            sign(words, k, frames, f, ops)
            k += 1
    return k
