"""What a port has sent and received, and for how long each of its channels was in use."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from hal.can.arbitration import bus_of
from hal.can.frames import LOST, TICK, WORDS
from hal.can.timing import frame_ns
from hal.can.wire import ChannelInfo
from hal.drives.borrowing import borrowed
from handrail.compiled import compiled

SENT, RECEIVED, BUSY_NS = 0, 1, 2
"""Columns of `Port.counters`."""
_RATES, _COUNTERS = 2, 3


@compiled
def count_frames(words, n, bitrates, column, counters):
    """Count n records into `counters` (channels, 3): one each in `column`, their time on the bus in `BUSY_NS`."""
    for row in range(n):
        bus = bus_of(words, row)
        if bus < counters.shape[0]:
            counters[bus, column] += 1
            counters[bus, BUSY_NS] += frame_ns(words, row, bitrates[bus, 0], bitrates[bus, 1])


class Ledger:
    """What one port on the virtual bus has counted, in one piece for its kernels."""

    def __init__(self, channels: Sequence[ChannelInfo]):
        c = len(channels)
        self._memory = np.zeros((_RATES + _COUNTERS) * c, np.int64)
        bitrates, self.counters = _tables(self._memory)
        """`counters` (channels, 3): SENT, RECEIVED, BUSY_NS; a view"""
        bitrates[:] = np.array([(channel.bitrate, channel.data_bitrate) for channel in channels]).reshape(c, _RATES)

    def count_sent(self, words: npt.NDArray[np.uint64], n: int) -> None:
        """Count n records that have been sent."""
        _count_sent(words, n, self._memory)

    def take_in(self, words: npt.NDArray[np.uint64], n: int) -> tuple[int, int, int]:
        """Take the hub's notices out of n records received, and count the frames: (frames left, moved together; frames that the
        hub says it dropped; ticks)."""
        left: tuple[int, int, int] = _take_in(words, n, self._memory)
        return left


@compiled
def _tables(memory):  # type: ignore[no-untyped-def]
    """bitrates, counters"""
    c = len(memory) // (_RATES + _COUNTERS)
    return memory[: _RATES * c].reshape(c, _RATES), memory[_RATES * c :].reshape(c, _COUNTERS)


@compiled
def _count_sent(words, n, memory):  # type: ignore[no-untyped-def]
    words = borrowed(words)
    bitrates, counters = borrowed(_tables(borrowed(memory)))
    count_frames(words, n, bitrates, SENT, counters)


@compiled
def _take_in(words, n, memory):  # type: ignore[no-untyped-def]
    words = borrowed(words)
    bitrates, counters = borrowed(_tables(borrowed(memory)))
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
    count_frames(words, k, bitrates, RECEIVED, counters)
    return k, lost, ticks
