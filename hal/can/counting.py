"""What a port has sent and received, and for how long each of its channels was in use."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from hal.can.arbitration import bus_of
from hal.can.frames import LOST, TICK, WORDS
from hal.can.timing import frame_ns
from hal.can.wire import ChannelInfo
from hal.drives.borrowing import borrowed
from handrail.compiled import compiled

SENT, RECEIVED, BUSY_NS = 0, 1, 2
"""Columns of `Port.counters`."""
_TURNS, _RATES, _COUNTERS, _MEANS = 2, 2, 3, 2
_EVERY = 17
"""batches of which one is timed bit by bit; devices' frames come in every second cycle, or tenth: no multiple of that"""


@compiled
def count_frames(words, n, bitrates, column, counters):
    """Count n records into `counters` (channels, 3): one each in `column`, their time on the bus in `BUSY_NS`."""
    for row in range(n):
        bus = bus_of(words, row)
        if bus < counters.shape[0]:
            counters[bus, column] += 1
            counters[bus, BUSY_NS] += frame_ns(words, row, bitrates[bus, 0], bitrates[bus, 1])


class Ledger:
    """What one port on the virtual bus has counted, in one piece for its kernels.

    Frames are counted one by one. Their time is worked out bit by bit for one batch of `_EVERY` only, and taken for each channel's
    mean in the others: it costs as much as decoding them, for a load that is told in percent.
    """

    def __init__(self, channels: Sequence[ChannelInfo]):
        c = len(channels)
        self.memory = np.zeros(_TURNS + (_RATES + _COUNTERS + _MEANS) * c, np.int64)
        _, bitrates, self.counters, _ = _tables(self.memory)
        """`counters` (channels, 3): SENT, RECEIVED, BUSY_NS; a view"""
        bitrates[:] = np.array([(channel.bitrate, channel.data_bitrate) for channel in channels]).reshape(c, _RATES)


@compiled
def _tables(memory):  # type: ignore[no-untyped-def]
    """turns (2,), bitrates (c, 2), counters (c, 3), mean ns of a frame sent and received (c, 2)"""
    c = (len(memory) - _TURNS) // (_RATES + _COUNTERS + _MEANS)
    a = _TURNS + _RATES * c
    b = a + _COUNTERS * c
    return (
        memory[:_TURNS],
        memory[_TURNS:a].reshape(c, _RATES),
        memory[a:b].reshape(c, _COUNTERS),
        memory[b:].reshape(c, _MEANS),
    )


@compiled
def count_batch(words, n, column, memory):  # type: ignore[no-untyped-def]
    """Count n records into a Ledger's memory, `column` SENT or RECEIVED."""
    turns, bitrates, counters, means = borrowed(_tables(borrowed(memory)))
    exact = turns[column] == 0
    turns[column] = (turns[column] + 1) % _EVERY
    if exact:
        for bus in range(counters.shape[0]):
            before, busy = counters[bus, column], counters[bus, BUSY_NS]
            means[bus, column] = 0
            for row in range(n):
                if bus_of(words, row) == bus:
                    counters[bus, column] += 1
                    counters[bus, BUSY_NS] += frame_ns(words, row, bitrates[bus, 0], bitrates[bus, 1])
            if counters[bus, column] > before:
                means[bus, column] = (counters[bus, BUSY_NS] - busy) // (counters[bus, column] - before)
        return
    for row in range(n):
        bus = bus_of(words, row)
        if bus < counters.shape[0]:
            mean = means[bus, column]
            counters[bus, column] += 1
            counters[bus, BUSY_NS] += mean if mean > 0 else frame_ns(words, row, bitrates[bus, 0], bitrates[bus, 1])


@compiled
def take_notices(words, n, memory):  # type: ignore[no-untyped-def]
    """Take the hub's notices out of n records received, and count the frames: (frames left, moved together; frames that the hub
    says it dropped; ticks)."""
    k, lost, ticks = 0, np.int64(0), 0
    for row in range(n):
        head = words[WORDS * row + 1]
        if (head >> np.uint64(40)) & np.uint64(LOST):
            lost += np.int64(head & np.uint64(0xFFFFFFFF))
            continue
        if (head >> np.uint64(40)) & np.uint64(TICK):
            ticks += 1
            continue
        if k != row:
            for i in range(WORDS):
                words[WORDS * k + i] = words[WORDS * row + i]
        k += 1
    count_batch(words, k, RECEIVED, memory)
    return k, lost, ticks
