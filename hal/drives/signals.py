"""One frame and one signal of a robot's frame program (hal.drives.program), read and written by compiled code.

A program's tables: `frames` (f, FRAME_COLUMNS), its messages; `ops` (o, OP_COLUMNS), their signals, and `scales` (s, 4) of those;
`lookups` (t, LOOKUP_COLUMNS), of each table value by raw; raw by value, or of a logarithmic scale the least value by raw; the
scale's low end, largest raw, steps an octave and nearly its low end's binary logarithm;
`ids` (channels, 2048), identifier → frame; `long_ids` (2, m), sorted keys of 29-bit identifiers, and their frames; `payloads`;
`spans` (roles, 2), where each role's frames begin and end.
`words` are records (hal.can.frames). The tables travel as one array, from which a kernel makes them again: each argument of a
compiled function costs about as much as a frame's decoding.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

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
from hal.drives.borrowing import piece
from hal.drives.crc import crc_of
from hal.drives.fields import (
    ACROSS,
    ALGORITHM,
    BYTES,
    CONSTANTS,
    CRC,
    CRC_FROM,
    CRC_TO,
    END,
    FIELD,
    FIRST,
    FLOATS,
    FRAME_COLUMNS,
    HEAD,
    KIND,
    LENGTH,
    OP_COLUMNS,
    OP_WORDS,
    SCALING,
    SEQUENCE,
    START,
    TABLE,
    Field,
    Role,
)  # fmt: skip
from handrail.compiled import compiled

RAWS, LOGS, LOOKUP_COLUMNS = 256, 512, 516
"""Where raws by value (of a logarithmic scale: least values by raw), and the scale, begin in a row of the look-up tables."""

_CONSTANT = int(Field.CONSTANT)
_LOW_BITS = np.uint64(0xFFFFFFFF)
_HEADER = 11
"""words before the tables: where each ends, how many channels, joints and devices there are"""
_ROLES = len(Role)


def packed(frames, ops, scales, lookups, ids, long_ids, payloads, spans, joints, devices):
    """A program's tables as one array (int64), for `tables` and `joints_and_devices`."""
    parts = [frames, ops, scales, lookups, ids, long_ids, payloads, spans]
    parts = [np.ascontiguousarray(part).reshape(-1).view(np.int64) for part in parts]
    ends = np.cumsum([_HEADER] + [part.size for part in parts])
    return np.concatenate([[*ends[1:], len(ids), joints, devices], *parts]).astype(np.int64)


@compiled
def tables(code):
    """frames, ops, scales, lookups, ids, long_ids, payloads, spans"""
    return (
        piece(code, _HEADER, ((code[0] - _HEADER) // FRAME_COLUMNS, FRAME_COLUMNS), np.int64),
        piece(code, code[0], ((code[1] - code[0]) // OP_WORDS, OP_COLUMNS), np.int16),
        piece(code, code[1], ((code[2] - code[1]) // 4, 4), np.float64),
        piece(code, code[2], ((code[3] - code[2]) // LOOKUP_COLUMNS, LOOKUP_COLUMNS), np.float64),
        piece(code, code[3], (code[8], 2048), np.int64),
        piece(code, code[4], (2, (code[5] - code[4]) // 2), np.int64),
        piece(code, code[5], (code[6] - code[5],), np.uint64),
        piece(code, code[6], (_ROLES, 2), np.int64),
    )


@compiled
def joints_and_devices(code):
    """How many there are."""
    return code[9], code[10]


@compiled
def words_of(records):
    """Records as words (WORDS a frame, uint64)."""
    return piece(records, 0, (WORDS * records.shape[0],), np.uint64)


# Indices of signals and words are unsigned: numba asks each signed one whether it counts from the end, a tenth of the time.
# What kernels work a frame through with is inlined: an array handed on to a function costs reference counting, as much as the
# function's work.


@njit(inline="always")
def mask_of(ops, o):
    """As many ones as a signal has bits (1..64)."""
    return np.uint64(0xFFFFFFFFFFFFFFFF) >> np.uint64(64 - ops[o, LENGTH])


@njit(inline="always")
def put_raw(words, first, ops, o, raw):
    bits, start = np.uint64(raw) & mask_of(ops, o), np.int64(ops[o, START])
    if ops[o, KIND] & ACROSS:
        _put_across(words, first, start, np.int64(ops[o, LENGTH]), ops[o, KIND], bits)
    else:
        words[np.uint64(first + (start >> 6))] |= bits << np.uint64(start & 63)


@njit(inline="always")
def get_raw(words, first, ops, o):
    start = np.int64(ops[o, START])
    if ops[o, KIND] & ACROSS:
        bits = _bits_across(words, first, start, np.int64(ops[o, LENGTH]), ops[o, KIND])
    else:
        bits = words[np.uint64(first + (start >> 6))] >> np.uint64(start & 63) & mask_of(ops, o)
    return bits


@compiled
def _put_across(words, first, start, length, kind, bits):
    if kind & BIG_ENDIAN:
        put_big_endian(words, first, start, length, bits)
    else:
        put_bits(words, first, start, length, bits)


@compiled
def _bits_across(words, first, start, length, kind):
    if kind & BIG_ENDIAN:
        return get_big_endian(words, first, start, length)
    return get_bits(words, first, start, length)


@compiled
def log2_nearly(value):
    """The binary logarithm of a positive normal number, to 0.01: its exponent, and a parabola through the octave's ends."""
    bits = np.float64(value).view(np.int64)
    rest = (bits & ((1 << 52) - 1)) * 2.0**-52
    return (bits >> 52) - 1023 + rest * (1.34 - 0.34 * rest)


@compiled
def _looked_up(value, lookups, table):
    """The raw integer of a value by a look-up table."""
    low = lookups[table, LOGS]
    if low <= 0.0:
        return np.int64(lookups[table, np.uint64(RAWS + np.int64(min(max(value, 0.0), 255.0)))])
    if value < 0.5 * low:
        return np.int64(0)
    # A guess that is seldom off by one, then the table.
    top = np.int64(lookups[table, LOGS + 1])
    guess = 1.5 + lookups[table, LOGS + 2] * (log2_nearly(value) - lookups[table, LOGS + 3])
    raw = np.int64(min(max(guess, 1.0), lookups[table, LOGS + 1]))
    while raw < top and value >= lookups[table, np.uint64(RAWS + raw + 1)]:
        raw += 1
    while value < lookups[table, np.uint64(RAWS + raw)]:
        raw -= 1
    return raw


@compiled
def _float_bits(value, length):
    return np.uint64(np.float32(value).view(np.uint32)) if length == 32 else np.float64(value).view(np.uint64)


@compiled
def _float_value(bits, length):
    return np.float64(np.uint32(bits).view(np.float32)) if length == 32 else np.uint64(bits).view(np.float64)


@njit(inline="always")
def get_value(words, first, ops, scales, lookups, o):
    """The physical value of a signal; of one without bits its constant."""
    kind, length, scaling = ops[o, KIND], np.int64(ops[o, LENGTH]), np.uint64(ops[o, SCALING])
    if length == 0:
        value = scales[scaling, OFFSET]
    else:
        bits = get_raw(words, first, ops, o)
        if kind & FLOAT:
            value = _float_value(bits, length) * scales[scaling, SCALE] + scales[scaling, OFFSET]
        elif ops[o, TABLE] >= 0:
            value = lookups[np.uint64(ops[o, TABLE]), bits]
        elif kind & SIGNED:
            shift = 64 - length
            value = (np.int64(bits << np.uint64(shift)) >> shift) * scales[scaling, SCALE] + scales[scaling, OFFSET]
        else:
            value = np.int64(bits) * scales[scaling, SCALE] + scales[scaling, OFFSET]
    return value


@njit(inline="always")
def put_value(words, first, ops, scales, lookups, o, value):
    """Write a finite physical value, saturated; signals without bits, and values that a table leaves out, write nothing."""
    if ops[o, LENGTH] > 0:
        table, scaling = ops[o, TABLE], np.uint64(ops[o, SCALING])
        if ops[o, KIND] & FLOAT:
            scaled = (value - scales[scaling, OFFSET]) / scales[scaling, SCALE]
            put_raw(words, first, ops, o, _float_bits(scaled, np.int64(ops[o, LENGTH])))
        elif table < 0:
            raw = np.rint((value - scales[scaling, OFFSET]) / scales[scaling, SCALE])
            put_raw(words, first, ops, o, np.int64(min(max(raw, scales[scaling, LOW]), scales[scaling, HIGH])))
        else:
            code = _looked_up(value, lookups, np.uint64(table))
            # Tables may share a signal: the first that has something to say does.
            if code > 0 and get_raw(words, first, ops, o) == 0:
                put_raw(words, first, ops, o, code)


@njit(inline="always")
def constant_of(ops, scales, o):
    """The raw value of a signal that always has the same."""
    return np.int64(scales[np.uint64(ops[o, SCALING]), LOW])


@compiled
def begin(words, k, head):
    words[WORDS * k] = np.uint64(0)
    words[WORDS * k + 1] = head
    for i in range(8):
        words[WORDS * k + DATA + i] = np.uint64(0)


@compiled
def sign(words, k, frames, f, ops):
    """Write the CRC, where the frame has one."""
    if frames[f, CRC] >= 0:
        first = WORDS * k + DATA
        crc = crc_of(words, first, frames[f, CRC_FROM], frames[f, CRC_TO], frames[f, ALGORITHM])
        put_raw(words, first, ops, frames[f, CRC], crc)


@compiled
def valid(words, k, frames, f, ops, scales):
    """Is this frame of the right format and length, with the right CRC and constants?"""
    head, first = words[WORDS * k + 1], WORDS * k + DATA
    flags = np.int64((head >> np.uint64(40)) & np.uint64(0xFF))
    if (flags ^ (frames[f, HEAD] >> 40)) & FD:
        return False
    if np.int64((head >> np.uint64(32)) & np.uint64(0xFF)) != frames[f, BYTES]:
        return False
    if frames[f, CRC] >= 0:
        crc = crc_of(words, first, frames[f, CRC_FROM], frames[f, CRC_TO], frames[f, ALGORITHM])
        if np.int64(get_raw(words, first, ops, frames[f, CRC])) != crc:
            return False
    if frames[f, CONSTANTS]:
        for o in range(frames[f, FIRST], frames[f, END]):
            if ops[o, FIELD] == _CONSTANT and np.int64(get_raw(words, first, ops, o)) != constant_of(ops, scales, o):
                return False
    return True


@compiled
def no_number(words, k, frames, f, ops, scales, lookups):
    """The first signal (op) of this frame that is no finite number; −1: none. Only floating-point signals can be."""
    if frames[f, FLOATS]:
        first = WORDS * k + DATA
        for o in range(frames[f, FIRST], frames[f, END]):
            if ops[o, KIND] & FLOAT and not math.isfinite(get_value(words, first, ops, scales, lookups, o)):
                return o
    return np.int64(-1)


@compiled
def _long_frame(key, long_ids):
    at = np.searchsorted(long_ids[0], key)
    return long_ids[1, at] if at < long_ids.shape[1] and long_ids[0, at] == key else -1


@njit(inline="always")
def frame_of(words, k, ids, long_ids):
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


@compiled
def sequence_of(words, first, frames, f, ops):
    """The sequence number of a frame that has one (0..255)."""
    op = frames[f, SEQUENCE]
    return np.int64(get_bits(words, first, np.int64(ops[op, START]), np.int64(ops[op, LENGTH])))
