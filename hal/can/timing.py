"""How long a frame occupies its bus: exact bit counts with stuffing, ISO 11898-1:2015.

CAN sends a bit of the other level after every five equal bits. In classic CAN that runs to the end of the CRC; in CAN FD to
the end of the data, after which the CRC field has stuff bits at fixed places. Stuffing moves through the data one byte a table
look-up, since a bus with 20 000 frames a second is timed frame by frame.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from hal.can.frames import BRS, DATA, ESI, EXTENDED, FD, REMOTE, WORDS
from handrail.compiled import compiled


@dataclass(frozen=True)
class BusTiming:
    """A channel's name and its bit rates in bit/s."""

    name: str
    bitrate: int = 1_000_000
    data_bitrate: int = 5_000_000


# A stuffing state is (level of the last bit, how many of it in a row) as 5 level + run - 1. The bus idles at level 1, and the
# frame's first bit (0) starts a new run, so that a frame begins in state `_START`.
_START = 4 + 5  # level 1, run 5: never seen again, since a run of 5 is broken by its stuff bit at once


def _stuffing_tables() -> tuple[np.ndarray, np.ndarray]:
    """(next state, stuff bits), each (9, 10, 256): by how many bits, state before them, and the bits; a bit that completes a
    run of 5 also sends the stuff bit."""
    step = np.zeros((10, 2), np.uint8)
    for state in range(10):
        level, run = divmod(state, 5)
        for value in (0, 1):
            length = run + 2 if value == level and state != _START else 1
            step[state, value] = 5 * value + length - 1 if length < 5 else 5 * (1 - value)
    after, stuffed = np.zeros((9, 10, 256), np.uint8), np.zeros((9, 10, 256), np.uint8)
    bits = np.arange(256)
    for state in range(10):
        after[0, state] = state
    for n in range(1, 9):
        # The first of n bits, then the n - 1 behind it.
        first, rest = (bits >> (n - 1)) & 1, bits & ((1 << (n - 1)) - 1)
        for state in range(10):
            then = step[state][first]
            after[n, state] = after[n - 1, then, rest]
            stuffed[n, state] = (state == 5 * first + 3) + stuffed[n - 1, then, rest]
    return after, stuffed


_AFTER, _STUFFED_IN = _stuffing_tables()
_NEXT_BYTE, _STUFFED = _AFTER[8].copy(), _STUFFED_IN[8].copy()
# length → DLC of CAN FD
_DLC = np.searchsorted(np.array([0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64]), np.arange(65)).astype(
    np.int64
)


@compiled
def _walk(state, bits, n):
    """Stuffing over the n lowest of `bits`, highest first: (state, stuff bits)."""
    count = 0
    while n >= 8:
        n -= 8
        value = (bits >> n) & 0xFF
        count += _STUFFED[state, value]
        state = np.int64(_NEXT_BYTE[state, value])
    value = bits & ((1 << n) - 1)
    return np.int64(_AFTER[n, state, value]), count + _STUFFED_IN[n, state, value]


@compiled
def _crc15(crc, bits, n):
    for position in range(n - 1, -1, -1):
        out = ((crc >> 14) ^ (bits >> position)) & 1
        crc = (crc << 1) & 0x7FFF
        if out:
            crc ^= 0x4599
    return crc


@compiled
def frame_bits(words, row):
    """(bits at the nominal rate, bits at the data rate) of frame `row`, from start of frame to the end of the intermission."""
    head = words[WORDS * row + 1]
    can_id = np.int64(head & np.uint64(0x1FFFFFFF))
    length = np.int64((head >> np.uint64(32)) & np.uint64(0xFF))
    flags = np.int64((head >> np.uint64(40)) & np.uint64(0xFF))
    remote = 1 if flags & REMOTE else 0
    first = WORDS * row + DATA
    # Arbitration field, from start of frame (0) to the last bit that is sent at the nominal rate in CAN FD.
    if flags & FD:
        brs = 1 if flags & BRS else 0
        if flags & EXTENDED:  # SRR 1, IDE 1, 18 bits, RRS 0, FDF 1, reserved 0, BRS
            bits, n = (((can_id >> 18) << 2 | 3) << 18 | (can_id & 0x3FFFF)) << 4 | 4 | brs, 36
        else:  # RRS 0, IDE 0, FDF 1, reserved 0, BRS
            bits, n = can_id << 5 | 4 | brs, 17
        state, arbitration = _walk(_START, bits, n)
        nominal = n + arbitration + 12  # acknowledge 2, end of frame 7, intermission 3
        control = (16 if flags & ESI else 0) | _DLC[length]
        # A run of five that ends with the data is broken by the CRC field's first fixed stuff bit, not by one more: the last
        # bit before the CRC field moves the state without being counted.
        state, count = _walk(state, control, 5) if length else _walk(state, control >> 1, 4)
        for i in range(length):
            value = np.int64((words[first + (i >> 3)] >> np.uint64(8 * (i & 7))) & np.uint64(0xFF))
            if i < length - 1:
                count += _STUFFED[state, value]
                state = np.int64(_NEXT_BYTE[state, value])
            else:
                count += _walk(state, value >> 1, 7)[1]
        # stuff count 4 and CRC 17 or 21 with a fixed stuff bit before every fourth bit, CRC delimiter 1
        data = 5 + 8 * length + count + (4 + 17 + 6 if length <= 16 else 4 + 21 + 7) + 1
        return (nominal, data) if brs else (nominal + data, 0)
    if flags & EXTENDED:  # SRR 1, IDE 1, 18 bits, RTR, two reserved 0, DLC
        bits, n = ((((can_id >> 18) << 2 | 3) << 18 | (can_id & 0x3FFFF)) << 3 | remote << 2) << 4 | length, 39
    else:  # RTR, IDE 0, reserved 0, DLC
        bits, n = (can_id << 3 | remote << 2) << 4 | length, 19
    state, count = _walk(_START, bits, n)
    crc = _crc15(0, bits, n)
    size = 0 if remote else length
    for i in range(size):
        value = np.int64((words[first] >> np.uint64(8 * i)) & np.uint64(0xFF))
        count += _STUFFED[state, value]
        state = np.int64(_NEXT_BYTE[state, value])
        crc = _crc15(crc, value, 8)
    state, in_crc = _walk(state, crc, 15)
    # CRC 15 and its delimiter 1, acknowledge 2, end of frame 7, intermission 3
    return n + 8 * size + count + 15 + in_crc + 13, 0


@compiled
def frame_ns(words, row, bitrate, data_bitrate):
    """Nanoseconds that frame `row` occupies a bus with these bit rates (bit/s)."""
    nominal, data = frame_bits(words, row)
    return nominal * 1_000_000_000 // bitrate + data * 1_000_000_000 // data_bitrate


class LoadMeter:
    """Share of a bus's time in use over about the last second, from a counter of busy time."""

    def __init__(self, window_ns: int = 1_000_000_000, samples: int = 10):
        self._step = window_ns // samples
        self._samples: deque[tuple[int, int]] = deque(maxlen=samples + 1)

    def update(self, time_ns: int, busy_ns: int) -> float:
        """Load at `time_ns`, given all the busy time counted so far; 0 until two samples a step apart are there."""
        if not self._samples or time_ns - self._samples[-1][0] >= self._step:
            self._samples.append((time_ns, busy_ns))
        since, before = self._samples[0]
        return (busy_ns - before) / (time_ns - since) if time_ns > since else 0.0
