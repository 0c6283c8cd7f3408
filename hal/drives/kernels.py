"""Compiled kernels that walk a robot's frame program (hal.drives.program): the same for every drive family, allocating nothing.

A program's tables: `frames` (f, FRAME_COLUMNS), its messages; `ops` (o, OP_COLUMNS) and `scales` (o, 4), their signals;
`lookups` (t, LOOKUP_COLUMNS), of each table value by raw; raw by value, or of a logarithmic scale the least value by raw; the
scale's low end, largest raw, steps an octave and nearly its low end's binary logarithm;
`ids` (channels, 2048), identifier → frame; `long_ids` (2, m), sorted keys of 29-bit identifiers, and their frames; `payloads`.
`words` are records (hal.can.frames). Tables that belong together travel as one array, from which a kernel makes them again: each
argument of a compiled function costs about as much as a frame's decoding.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from hal.can.arbitration import bus_of
from hal.can.codec import (
    BIG_ENDIAN,
    FLOAT,
    HIGH,
    LOW,
    OFFSET,
    SCALE,
    SIGNED,
    get_big_endian,
    get_bits,
    put_big_endian,
    put_bits,
)
from hal.can.frames import DATA, EXTENDED, FD, WORDS
from hal.drives.borrowing import borrowed
from hal.drives.crc import crc_of
from hal.drives.fields import (
    ALGORITHM,
    BYTES,
    COLUMN,
    CONSTANTS,
    CRC,
    CRC_FROM,
    CRC_TO,
    END,
    ENTITY,
    FIELD,
    FIRST,
    FRAME_COLUMNS,
    HEAD,
    KIND,
    LAW,
    LENGTH,
    MASK,
    OP_COLUMNS,
    PAYLOAD,
    PLAIN,
    ROLE,
    ROW,
    SEQUENCE,
    SHIFT,
    START,
    TABLE,
    TIME,
    Field,
    Role,
)  # fmt: skip
from hal.drives.lifecycle import (
    COMMAND_OF_CONTROLWORD,
    CONTROLWORD,
    INTERNAL_LIMIT,
    STATE_OF_STATUSWORD,
    WARNING,
    State,
    statusword,
)
from hal.joint import Mode

COMMANDED, CONTROLLED, WORD, ECHO, WATCHDOG, HEARD = range(6)
"""Rows of a target's flags (6, n) uint8: was commanded, was controlled, controlword, sequence, watchdog, any frame ever came."""
SYNCS, HOLDS, CYCLE, REQUESTS, REPEATED = range(5)
"""Entries of what the drive side learns about the host."""
RAWS, LOGS, LOOKUP_COLUMNS = 256, 512, 516
"""Where raws by value (of a logarithmic scale: least values by raw), and the scale, begin in a row of the look-up tables."""
MOST_REQUESTS = 32
"""parameter requests or replies that one batch may hold; more are dropped, their askers ask again"""

_POSITION, _VELOCITY, _TORQUE = int(Field.POSITION), int(Field.VELOCITY), int(Field.TORQUE)
_STIFFNESS, _DAMPING, _TEMPERATURE = int(Field.STIFFNESS), int(Field.DAMPING), int(Field.TEMPERATURE)
_MODE, _CONTROLWORD, _STATUS, _STATE = int(Field.MODE), int(Field.CONTROLWORD), int(Field.STATUS), int(Field.STATE)
_WARNING, _LIMIT, _ERROR, _WATCHDOG = int(Field.WARNING), int(Field.LIMIT), int(Field.ERROR), int(Field.WATCHDOG)
_COLUMN, _CONSTANT, _SEQUENCE, _TIME, _CRC = (
    int(Field.COLUMN), int(Field.CONSTANT), int(Field.SEQUENCE), int(Field.TIME), int(Field.CRC),
)  # fmt: skip
_AXIS, _VALUE = int(Field.AXIS), int(Field.VALUE)
_R_CONTROL, _R_COMMAND, _R_STATUS, _R_MASTER = (
    int(Role.CONTROL),
    int(Role.COMMAND),
    int(Role.STATUS),
    int(Role.MASTER_STATUS),
)
_R_SYNC, _R_HOLD, _R_REQUEST, _R_REPLY = (
    int(Role.SYNC), int(Role.HOLD_TIME), int(Role.PARAMETER_REQUEST), int(Role.PARAMETER_REPLY),
)  # fmt: skip
_R_DEVICE_COMMAND, _R_DEVICE_STATUS = int(Role.DEVICE_COMMAND), int(Role.DEVICE_STATUS)
_M_DAMPING, _M_TORQUE = int(Mode.DAMPING), int(Mode.TORQUE)
_STATUSWORDS = statusword(np.arange(len(State)))
_LOW_BITS = np.uint64(0xFFFFFFFF)
_YOUNG, _NEVER_HEARD = 128, 1 << 29
_DRIFT = 1.0 / 8192.0


def packed(frames, ops, scales, lookups, ids, long_ids, payloads):
    """A program's tables as one array (int64), for `_tables`."""
    parts = [frames, ops, scales.view(np.int64), lookups.view(np.int64), ids, long_ids, payloads.view(np.int64)]
    ends = np.cumsum([8] + [part.size for part in parts])
    return np.concatenate([[*ends[1:], len(ids)], *(part.ravel() for part in parts)]).astype(np.int64)


@njit(cache=True)
def _tables(code):
    """frames, ops, scales, lookups, ids, long_ids, payloads"""
    code = borrowed(code)
    return (
        code[8 : code[0]].reshape(-1, FRAME_COLUMNS),
        code[code[0] : code[1]].reshape(-1, OP_COLUMNS),
        code[code[1] : code[2]].view(np.float64).reshape(-1, 4),
        code[code[2] : code[3]].view(np.float64).reshape(-1, LOOKUP_COLUMNS),
        code[code[3] : code[4]].reshape(code[7], 2048),
        code[code[4] : code[5]].reshape(2, (code[5] - code[4]) // 2),
        code[code[5] : code[6]].view(np.uint64),
    )


@njit(cache=True)
def _measured_rows(memory, n):
    """table, times, status, bytes of a JointState (hal.joint)"""
    memory = borrowed(memory)
    octets = memory[6 * n :].view(np.uint8)
    return (
        memory[: 4 * n].view(np.float64).reshape(4, n),
        memory[4 * n : 6 * n].reshape(2, n),
        octets[: 2 * n].view(np.uint16),
        octets[2 * n : 4 * n].reshape(2, n),
    )


# Helpers are inlined: an array handed on to a function costs reference counting, as much as the function's work.


@njit(inline="always")
def _put(words, first, ops, o, raw):
    bits, word = np.uint64(raw) & np.uint64(ops[o, MASK]), ops[o, PLAIN]
    if word >= 0:
        words[first + word] |= bits << np.uint64(ops[o, SHIFT])
    else:
        _put_across(words, first, ops[o, START], ops[o, LENGTH], ops[o, KIND], bits)


@njit(inline="always")
def _bits(words, first, ops, o):
    word = ops[o, PLAIN]
    if word >= 0:
        bits = words[first + word] >> np.uint64(ops[o, SHIFT]) & np.uint64(ops[o, MASK])
    else:
        bits = _bits_across(words, first, ops[o, START], ops[o, LENGTH], ops[o, KIND])
    return bits


@njit(cache=True)
def _put_across(words, first, start, length, kind, bits):
    if kind & BIG_ENDIAN:
        put_big_endian(words, first, start, length, bits)
    else:
        put_bits(words, first, start, length, bits)


@njit(cache=True)
def _bits_across(words, first, start, length, kind):
    if kind & BIG_ENDIAN:
        return get_big_endian(words, first, start, length)
    return get_bits(words, first, start, length)


@njit(cache=True)
def log2_nearly(value):
    """The binary logarithm of a positive normal number, to 0.01: its exponent, and a parabola through the octave's ends."""
    bits = np.float64(value).view(np.int64)
    rest = (bits & ((1 << 52) - 1)) * 2.0**-52
    return (bits >> 52) - 1023 + rest * (1.34 - 0.34 * rest)


@njit(cache=True)
def _looked_up(value, lookups, table):
    """The raw integer of a value by a look-up table."""
    low = lookups[table, LOGS]
    if low <= 0.0:
        return np.int64(lookups[table, RAWS + np.int64(min(max(value, 0.0), 255.0))])
    if value < 0.5 * low:
        return np.int64(0)
    # A guess that is seldom off by one, then the table.
    top = np.int64(lookups[table, LOGS + 1])
    guess = 1.5 + lookups[table, LOGS + 2] * (log2_nearly(value) - lookups[table, LOGS + 3])
    raw = np.int64(min(max(guess, 1.0), lookups[table, LOGS + 1]))
    while raw < top and value >= lookups[table, RAWS + raw + 1]:
        raw += 1
    while value < lookups[table, RAWS + raw]:
        raw -= 1
    return raw


@njit(cache=True)
def _float_bits(value, length):
    return np.uint64(np.float32(value).view(np.uint32)) if length == 32 else np.float64(value).view(np.uint64)


@njit(cache=True)
def _float_value(bits, length):
    return np.float64(np.uint32(bits).view(np.float32)) if length == 32 else np.uint64(bits).view(np.float64)


@njit(inline="always")
def _value(words, first, ops, scales, lookups, o):
    """The physical value of a signal; of one without bits its constant."""
    kind = ops[o, KIND]
    if ops[o, LENGTH] == 0:
        value = np.float64(ops[o, COLUMN])
    else:
        bits = _bits(words, first, ops, o)
        if kind & FLOAT:
            value = _float_value(bits, ops[o, LENGTH]) * scales[o, SCALE] + scales[o, OFFSET]
        elif ops[o, TABLE] >= 0:
            value = lookups[ops[o, TABLE], np.int64(bits)]
        elif kind & SIGNED:
            shift = 64 - ops[o, LENGTH]
            value = (np.int64(bits << np.uint64(shift)) >> shift) * scales[o, SCALE] + scales[o, OFFSET]
        else:
            value = np.int64(bits) * scales[o, SCALE] + scales[o, OFFSET]
    return value


@njit(inline="always")
def _put_value(words, first, ops, scales, lookups, o, value):
    """Write a finite physical value, saturated; signals without bits, and values that a table leaves out, write nothing."""
    if ops[o, LENGTH] > 0:
        table = ops[o, TABLE]
        if ops[o, KIND] & FLOAT:
            _put(words, first, ops, o, _float_bits((value - scales[o, OFFSET]) / scales[o, SCALE], ops[o, LENGTH]))
        elif table < 0:
            raw = np.rint((value - scales[o, OFFSET]) / scales[o, SCALE])
            _put(words, first, ops, o, np.int64(min(max(raw, scales[o, LOW]), scales[o, HIGH])))
        else:
            code = _looked_up(value, lookups, table)
            # Tables may share a signal: the first that has something to say does.
            if code > 0 and _bits(words, first, ops, o) == 0:
                _put(words, first, ops, o, code)


@njit(cache=True)
def _begin(words, k, head):
    words[WORDS * k] = np.uint64(0)
    words[WORDS * k + 1] = head
    for i in range(8):
        words[WORDS * k + DATA + i] = np.uint64(0)


@njit(cache=True)
def _sign(words, k, frames, f, ops):
    """Write the CRC, where the frame has one."""
    if frames[f, CRC] >= 0:
        first = WORDS * k + DATA
        crc = crc_of(words, first, frames[f, CRC_FROM], frames[f, CRC_TO], frames[f, ALGORITHM])
        _put(words, first, ops, frames[f, CRC], crc)


@njit(cache=True)
def _valid(words, k, frames, f, ops):
    """Is this frame of the right format and length, with the right CRC and constants?"""
    head, first = words[WORDS * k + 1], WORDS * k + DATA
    flags = np.int64((head >> np.uint64(40)) & np.uint64(0xFF))
    if (flags ^ (frames[f, HEAD] >> 40)) & FD:
        return False
    if np.int64((head >> np.uint64(32)) & np.uint64(0xFF)) != frames[f, BYTES]:
        return False
    if frames[f, CRC] >= 0:
        crc = crc_of(words, first, frames[f, CRC_FROM], frames[f, CRC_TO], frames[f, ALGORITHM])
        if np.int64(_bits(words, first, ops, frames[f, CRC])) != crc:
            return False
    if frames[f, CONSTANTS]:
        for o in range(frames[f, FIRST], frames[f, END]):
            if ops[o, FIELD] == _CONSTANT and np.int64(_bits(words, first, ops, o)) != ops[o, COLUMN]:
                return False
    return True


@njit(cache=True)
def _long_frame(key, long_ids):
    at = np.searchsorted(long_ids[0], key)
    return long_ids[1, at] if at < long_ids.shape[1] and long_ids[0, at] == key else -1


@njit(inline="always")
def _frame_of(words, k, ids, long_ids):
    """Index of the message that a record is; −1: none of ours."""
    head = words[WORDS * k + 1]
    can_id, bus = np.int64(head & _LOW_BITS), np.int64((head >> np.uint64(48)) & np.uint64(0xFF))
    found = np.int64(-1)
    if bus < ids.shape[0]:
        if (head >> np.uint64(40)) & np.uint64(EXTENDED):
            found = _long_frame(bus << 32 | can_id, long_ids)
        elif can_id < 2048:
            found = ids[bus, can_id]
    return found


@njit(cache=True)
def encode_commands(words, begin, end, code, table, mode, sequence, watchdog):
    """Commands of the frames begin..end; how many, or −1 − (8 joint + field) for the first value that is not finite."""
    words, table, mode = borrowed(words), borrowed(table), borrowed(mode)
    frames, ops, scales, lookups, _, _, _ = borrowed(_tables(code))
    for f in range(begin, end):
        k = f - begin
        _begin(words, k, np.uint64(frames[f, HEAD]))
        first, law = WORDS * k + DATA, frames[f, LAW]
        for o in range(frames[f, FIRST], frames[f, END]):
            field, joint = ops[o, FIELD], ops[o, ROW]
            value = 0.0
            if field <= _DAMPING:
                value = table[field, joint]
                if not math.isfinite(value):
                    return -1 - (8 * joint + field)
                if law and (
                    (mode[joint] == _M_TORQUE and field >= _STIFFNESS)
                    or (mode[joint] == _M_DAMPING and field not in (_POSITION, _DAMPING))
                ):
                    value = 0.0
            elif field == _MODE:
                value = np.float64(mode[joint])
            elif field == _SEQUENCE:
                value = np.float64(sequence)
            elif field == _WATCHDOG:
                value = np.float64(watchdog)
            elif field == _CONSTANT:
                value = np.float64(ops[o, COLUMN])
            else:
                continue
            _put_value(words, first, ops, scales, lookups, o, value)
        _sign(words, k, frames, f, ops)
    return end - begin


@njit(cache=True)
def encode_control(words, begin, end, code, controlwords, sequence):
    """Controlwords in the frames begin..end; how many."""
    words, controlwords = borrowed(words), borrowed(controlwords)
    frames, ops, _, _, _, _, payloads = borrowed(_tables(code))
    for f in range(begin, end):
        k = f - begin
        _begin(words, k, np.uint64(frames[f, HEAD]))
        first = WORDS * k + DATA
        if frames[f, PAYLOAD] >= 0:
            words[first] = payloads[frames[f, PAYLOAD] + COMMAND_OF_CONTROLWORD[0, controlwords[frames[f, ENTITY]]]]
            continue
        for o in range(frames[f, FIRST], frames[f, END]):
            field = ops[o, FIELD]
            if field == _CONTROLWORD:
                _put(words, first, ops, o, np.int64(controlwords[ops[o, ROW]]))
            elif field == _SEQUENCE:
                _put(words, first, ops, o, np.int64(sequence))
            elif field == _CONSTANT:
                _put(words, first, ops, o, ops[o, COLUMN])
        _sign(words, k, frames, f, ops)
    return end - begin


@njit(cache=True)
def encode_cycle(words, begin, end, code, cycle):
    """Sync or HoldTime in the frames begin..end; how many."""
    words = borrowed(words)
    frames, ops, _, _, _, _, _ = borrowed(_tables(code))
    for f in range(begin, end):
        _begin(words, f - begin, np.uint64(frames[f, HEAD]))
        for o in range(frames[f, FIRST], frames[f, END]):
            _put(words, WORDS * (f - begin) + DATA, ops, o, np.int64(cycle))
    return end - begin


@njit(cache=True)
def _finite(value):
    return value if math.isfinite(value) else 0.0


@njit(cache=True)
def encode_status(words, begin, end, code, answer, measured, mode, time_us):
    """Answers of the joints that owe one, in the frames begin..end; how many."""
    words, answer, mode = borrowed(words), borrowed(answer), borrowed(mode)
    frames, ops, scales, lookups, _, _, _ = borrowed(_tables(code))
    table, _, status, octets = borrowed(_measured_rows(measured, mode.shape[0]))
    k = 0
    for f in range(begin, end):
        if not answer[frames[f, ENTITY]]:
            continue
        _begin(words, k, np.uint64(frames[f, HEAD]))
        first = WORDS * k + DATA
        for o in range(frames[f, FIRST], frames[f, END]):
            field, joint = ops[o, FIELD], ops[o, ROW]
            value = 0.0
            if field <= _TORQUE:
                value = _finite(table[field, joint])
            elif field == _TEMPERATURE:
                # Where several axes share the signal, it is the hottest one's.
                for other in range(frames[f, FIRST], frames[f, END]):
                    if ops[other, FIELD] == _TEMPERATURE and ops[other, START] == ops[o, START]:
                        value = max(value, _finite(table[3, ops[other, ROW]]))
            elif field == _STATUS:
                value = np.float64(status[joint])
            elif field == _STATE:
                value = np.float64(STATE_OF_STATUSWORD[status[joint] & 0x7F])
            elif field == _WARNING:
                value = np.float64((status[joint] & WARNING) != 0)
            elif field == _LIMIT:
                value = np.float64((status[joint] & INTERNAL_LIMIT) != 0)
            elif field == _ERROR:
                value = np.float64(octets[0, joint])
            elif field == _SEQUENCE:
                value = np.float64(octets[1, joint])
            elif field == _MODE:
                value = np.float64(mode[joint])
            elif field == _TIME:
                value = np.float64(time_us & ((1 << ops[o, LENGTH]) - 1))
            elif field == _CONSTANT:
                value = np.float64(ops[o, COLUMN])
            else:
                continue
            _put_value(words, first, ops, scales, lookups, o, value)
        _sign(words, k, frames, f, ops)
        k += 1
    return k


@njit(cache=True)
def _fresh(sequence, last, age, sent):
    """Does this answer come after the last one that was believed?

    `sent`: sequence number of what was last sent (−1: unknown). An answer to something older than what was answered already
    is a replay; once nothing was believed for 128 cycles order can't be told, and only a repetition is one.
    """
    if age > _NEVER_HEARD:
        return True
    if sequence == last:
        return False
    if age >= _YOUNG:
        return True
    if sent < 0:
        return ((sequence - last) & 0xFF) < _YOUNG
    return ((sent - sequence) & 0xFF) < ((sent - last) & 0xFF)


@njit(cache=True)
def _measured(words, k, time_op, ops, clocks, row):
    """When a frame's values were measured, ns of the bus's clock.

    The sender's clock runs free and wraps round; `clocks[row]` learns by how much it is behind: the least delay that was seen,
    creeping up, so that clocks may drift.
    """
    arrived = np.int64(words[WORDS * k])
    if time_op < 0:
        return arrived
    wrap = np.int64(1) << ops[time_op, LENGTH]
    behind = np.float64((arrived // 1000 - np.int64(_bits(words, WORDS * k + DATA, ops, time_op))) & (wrap - 1))
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


@njit(cache=True)
def _take_parameter(words, first, frames, f, ops, parameters, count):
    """Row `count` of `parameters`: entity, then the raw values of axis, index, write, result, value; then the sequence."""
    for column in range(parameters.shape[1]):
        parameters[count, column] = 0
    parameters[count, 0] = frames[f, ENTITY]
    for o in range(frames[f, FIRST], frames[f, END]):
        field = ops[o, FIELD]
        if _AXIS <= field <= _VALUE:
            parameters[count, 1 + field - _AXIS] = np.int64(_bits(words, first, ops, o))
        elif field == _SEQUENCE:
            parameters[count, 7] = np.int64(_bits(words, first, ops, o))


@njit(cache=True)
def decode_status(
    words, n, code, joints, joint_memory, devices, device_memory, device_sequence, clocks, sent, parameters
):
    """Host side. The last row of `parameters` becomes (good, refused, repeated, parameter replies)."""
    words, device_memory, device_sequence, clocks, parameters = (
        borrowed(words),
        borrowed(device_memory),
        borrowed(device_sequence),
        borrowed(clocks),
        borrowed(parameters),
    )
    frames, ops, scales, lookups, ids, long_ids, _ = borrowed(_tables(code))
    table, times, status, octets = borrowed(_measured_rows(joint_memory, joints))
    values = device_memory[: 16 * devices].view(np.float64).reshape(devices, 16)
    device_times = device_memory[16 * devices :].reshape(2, devices)
    good, refused, repeated, replies, last = 0, 0, 0, 0, parameters.shape[0] - 1
    for k in range(n):
        f = _frame_of(words, k, ids, long_ids)
        if f < 0:
            continue
        role = frames[f, ROLE]
        if role not in (_R_STATUS, _R_MASTER, _R_DEVICE_STATUS, _R_REPLY):
            continue
        if not _valid(words, k, frames, f, ops):
            refused += 1
            continue
        first, entity = WORDS * k + DATA, frames[f, ENTITY]
        if role == _R_REPLY:
            if replies < last:
                _take_parameter(words, first, frames, f, ops, parameters, replies)
                replies += 1
            continue
        device, sequence, sequence_op, lag = role == _R_DEVICE_STATUS, np.int64(0), frames[f, SEQUENCE], np.int64(0)
        if sequence_op >= 0:
            sequence = np.int64(get_bits(words, first, ops[sequence_op, START], ops[sequence_op, LENGTH]))
            if device:
                new = _fresh(sequence, np.int64(device_sequence[entity]), device_times[0, entity], -1)
            else:
                new = _fresh(sequence, np.int64(octets[1, entity]), times[0, entity], sent)
                if sent >= 0:
                    lag = (sent - sequence) & 0xFF
            if not new:
                repeated += 1
                continue
        good += 1
        measured = _measured(words, k, frames[f, TIME], ops, clocks, joints + entity if device else entity)
        if device:
            device_times[0, entity], device_times[1, entity], device_sequence[entity] = 0, measured, sequence
        for o in range(frames[f, FIRST], frames[f, END]):
            field, row = ops[o, FIELD], ops[o, ROW]
            value = _value(words, first, ops, scales, lookups, o)
            if field <= _TORQUE:
                table[field, row] = value
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
    parameters[last, 0], parameters[last, 1], parameters[last, 2], parameters[last, 3] = (
        good,
        refused,
        repeated,
        replies,
    )


@njit(cache=True)
def decode_host(words, n, code, table, mode, flags, device_values, device_flags, parameters, check):
    """Drive side. (good, refused); the last row of `parameters` learns about the host; `check`: commands whose sequence does not
    go on count for nothing."""
    words, table, mode, flags, device_values, device_flags, parameters = (
        borrowed(words),
        borrowed(table),
        borrowed(mode),
        borrowed(flags),
        borrowed(device_values),
        borrowed(device_flags),
        borrowed(parameters),
    )
    frames, ops, scales, lookups, ids, long_ids, payloads = borrowed(_tables(code))
    flags[COMMANDED, :] = 0
    flags[CONTROLLED, :] = 0
    device_flags[COMMANDED, :] = 0
    last = parameters.shape[0] - 1
    parameters[last, SYNCS], parameters[last, HOLDS], parameters[last, REQUESTS] = 0, 0, 0
    good, refused = 0, 0
    for k in range(n):
        f = _frame_of(words, k, ids, long_ids)
        if f < 0:
            continue
        role, first, entity = frames[f, ROLE], WORDS * k + DATA, frames[f, ENTITY]
        if role in (_R_SYNC, _R_HOLD):
            if bus_of(words, k) == 0:
                parameters[last, SYNCS if role == _R_SYNC else HOLDS] += 1
                op = frames[f, FIRST]
                parameters[last, CYCLE] = np.int64(get_bits(words, first, ops[op, START], ops[op, LENGTH]))
            good += 1
            continue
        if role == _R_COMMAND and frames[f, PAYLOAD] >= 0:
            taken = -1
            for command in range(6):
                if taken < 0 and words[first] == payloads[frames[f, PAYLOAD] + command]:
                    taken = command
            if taken >= 0 and np.int64((words[WORDS * k + 1] >> np.uint64(32)) & np.uint64(0xFF)) == 8:
                flags[WORD, entity], flags[CONTROLLED, entity] = CONTROLWORD[taken], 1
                good += 1
                continue
        if role not in (_R_COMMAND, _R_CONTROL, _R_REQUEST, _R_DEVICE_COMMAND):
            continue
        if not _valid(words, k, frames, f, ops):
            refused += 1
            continue
        if role == _R_REQUEST:
            if parameters[last, REQUESTS] < last:
                _take_parameter(words, first, frames, f, ops, parameters, parameters[last, REQUESTS])
                parameters[last, REQUESTS] += 1
            good += 1
            continue
        sequence, sequence_op = np.int64(0), frames[f, SEQUENCE]
        if sequence_op >= 0:
            sequence = np.int64(get_bits(words, first, ops[sequence_op, START], ops[sequence_op, LENGTH]))
            old = False
            if role == _R_COMMAND and flags[HEARD, entity]:
                old = not 0 < ((sequence - flags[ECHO, entity]) & 0xFF) < _YOUNG
            elif role == _R_DEVICE_COMMAND and device_flags[HEARD, entity]:
                old = not 0 < ((sequence - device_flags[ECHO, entity]) & 0xFF) < _YOUNG
            if check and old:
                parameters[last, REPEATED] += 1
                continue
        good += 1
        device = role == _R_DEVICE_COMMAND
        if device:
            device_flags[ECHO, entity], device_flags[COMMANDED, entity], device_flags[HEARD, entity] = sequence, 1, 1
        for o in range(frames[f, FIRST], frames[f, END]):
            field, row = ops[o, FIELD], ops[o, ROW]
            value = _value(words, first, ops, scales, lookups, o)
            if field <= _DAMPING:
                table[field, row] = value
            elif field == _MODE:
                mode[row] = np.uint8(np.int64(value))
                flags[COMMANDED, row] = 1
            elif field == _CONTROLWORD:
                flags[WORD, row] = np.uint8(np.int64(value))
                flags[CONTROLLED, row] = 1
            elif field == _WATCHDOG:
                if device:
                    device_flags[WATCHDOG, row] = np.uint8(np.int64(value))
                else:
                    flags[WATCHDOG, row] = np.uint8(np.int64(value))
            elif field == _SEQUENCE:
                if not device:
                    flags[ECHO, row], flags[HEARD, row] = sequence, 1
            elif field == _COLUMN:
                device_values[row, ops[o, COLUMN]] = value
    return good, refused


@njit(cache=True)
def encode_device_commands(words, begin, end, code, values, commanded, due, sequence, watchdog):
    """Commands of the devices that somebody commands and that are due; how many, or −1 − (16 row + column) for the first value
    that is not finite."""
    words, values, commanded, due = borrowed(words), borrowed(values), borrowed(commanded), borrowed(due)
    frames, ops, scales, lookups, _, _, _ = borrowed(_tables(code))
    k = 0
    for f in range(begin, end):
        entity = frames[f, ENTITY]
        if not commanded[entity] or not due[entity]:
            continue
        _begin(words, k, np.uint64(frames[f, HEAD]))
        for o in range(frames[f, FIRST], frames[f, END]):
            field, value = ops[o, FIELD], 0.0
            if field == _COLUMN:
                value = values[entity, ops[o, COLUMN]]
                if not math.isfinite(value):
                    return -1 - (16 * entity + ops[o, COLUMN])
            elif field == _SEQUENCE:
                value = np.float64(sequence)
            elif field == _WATCHDOG:
                value = np.float64(watchdog)
            elif field == _CONSTANT:
                value = np.float64(ops[o, COLUMN])
            else:
                continue
            _put_value(words, WORDS * k + DATA, ops, scales, lookups, o, value)
        _sign(words, k, frames, f, ops)
        k += 1
    return k


@njit(cache=True)
def encode_device_status(words, begin, end, code, values, due, sequences, time_us):
    """What the devices that are due have measured; how many. Each frame has the next sequence number of its device."""
    words, values, due, sequences = borrowed(words), borrowed(values), borrowed(due), borrowed(sequences)
    frames, ops, scales, lookups, _, _, _ = borrowed(_tables(code))
    k = 0
    for f in range(begin, end):
        entity = frames[f, ENTITY]
        if not due[entity]:
            continue
        _begin(words, k, np.uint64(frames[f, HEAD]))
        sequences[entity] = (sequences[entity] + 1) & 0xFF
        for o in range(frames[f, FIRST], frames[f, END]):
            field, value = ops[o, FIELD], 0.0
            if field == _COLUMN:
                value = _finite(values[entity, ops[o, COLUMN]])
            elif field == _SEQUENCE:
                value = np.float64(sequences[entity])
            elif field == _TIME:
                value = np.float64(time_us & ((1 << ops[o, LENGTH]) - 1))
            elif field == _CONSTANT:
                value = np.float64(ops[o, COLUMN])
            else:
                continue
            _put_value(words, WORDS * k + DATA, ops, scales, lookups, o, value)
        _sign(words, k, frames, f, ops)
        k += 1
    return k


@njit(cache=True)
def encode_parameter(words, f, code, parameter):
    """A parameter request or reply from a row as `_take_parameter` makes it."""
    words, parameter = borrowed(words), borrowed(parameter)
    frames, ops, _, _, _, _, _ = borrowed(_tables(code))
    _begin(words, 0, np.uint64(frames[f, HEAD]))
    for o in range(frames[f, FIRST], frames[f, END]):
        field = ops[o, FIELD]
        if _AXIS <= field <= _VALUE:
            _put(words, DATA, ops, o, parameter[1 + field - _AXIS])
        elif field == _SEQUENCE:
            _put(words, DATA, ops, o, parameter[7])
    _sign(words, 0, frames, f, ops)
    return 1
