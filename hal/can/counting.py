"""What a port has sent and received, and for how long each of its channels was in use."""

from __future__ import annotations

from numba import njit

from hal.can.arbitration import bus_of
from hal.can.timing import frame_ns

SENT, RECEIVED, BUSY_NS = 0, 1, 2
"""Columns of `Port.counters`."""


@njit(cache=True)
def count_frames(words, n, bitrates, column, counters):
    """Count n records into `counters` (channels, 3): one each in `column`, their time on the bus in `BUSY_NS`."""
    for row in range(n):
        bus = bus_of(words, row)
        if bus < counters.shape[0]:
            counters[bus, column] += 1
            counters[bus, BUSY_NS] += frame_ns(words, row, bitrates[bus, 0], bitrates[bus, 1])
