"""What the channels have carried, frame by frame: totals, and each identifier's share.

`totals` (channels, 4): columns `FREE`, `FRAMES`, `BUSY`, `ERRORS`. `identifiers` (channels, slots, 3): key, frames, busy ns; a
standard identifier's slot is the identifier, an extended one's is found by hashing and has the identifier + 1 as its key.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from hal.can.frames import EXTENDED, WORDS
from hal.can.timing import BusTiming
from handrail.compiled import compiled

FREE, FRAMES, BUSY, ERRORS = 0, 1, 2, 3
"""ns when the bus was last free · frames carried · ns in use · error frames"""
STANDARD = 2048
_EXTENDED = 2048  # slots for extended identifiers, a power of 2; what finds none is in the totals only
_PROBES = 32
_RATES, _TOTALS, _SLOTS, _COLUMNS = 2, 4, STANDARD + _EXTENDED, 3


class Tally:
    """The bit rates of a hub's channels, and what they have carried: views of one piece of memory, for kernels."""

    def __init__(self, channels: Sequence[BusTiming]):
        """All zero."""
        self.memory = np.zeros(len(channels) * (_RATES + _TOTALS + _SLOTS * _COLUMNS), np.int64)
        self.bitrates, self.totals, self.identifiers = tables(self.memory)
        """`bitrates` (c, 2): nominal and data bit/s"""
        self.bitrates[:] = [(channel.bitrate, channel.data_bitrate) for channel in channels]


@compiled
def tables(memory):
    """bitrates, totals, identifiers: a Tally's memory laid out."""
    c = len(memory) // (_RATES + _TOTALS + _SLOTS * _COLUMNS)
    rates, counts = _RATES * c, (_RATES + _TOTALS) * c
    return (
        memory[:rates].reshape(c, _RATES),
        memory[rates:counts].reshape(c, _TOTALS),
        memory[counts:].reshape(c, _SLOTS, _COLUMNS),
    )


@compiled
def count(words, row, bus, ns, frames, identifiers):
    """Add `frames` frames (0: an attempt that failed) that took `ns` to the identifier of record `row`."""
    head = words[WORDS * row + 1]
    can_id = np.int64(head & np.uint64(0x1FFFFFFF))
    if not (head >> np.uint64(40)) & np.uint64(EXTENDED):
        identifiers[bus, can_id, 1] += frames
        identifiers[bus, can_id, 2] += ns
        return
    at = (can_id * 2654435761) >> 11
    for probe in range(_PROBES):
        slot = STANDARD + ((at + probe) & (_EXTENDED - 1))
        key = identifiers[bus, slot, 0]
        if key == 0 or key == can_id + 1:
            identifiers[bus, slot, 0] = can_id + 1
            identifiers[bus, slot, 1] += frames
            identifiers[bus, slot, 2] += ns
            return


def seen(identifiers: npt.NDArray[np.int64], bus: int) -> list[tuple[int, bool, int, int]]:
    """(identifier, extended, frames, busy ns) of all that channel `bus` has carried, standard ones first, ascending."""
    slots = np.flatnonzero(identifiers[bus, :, 1] + identifiers[bus, :, 2])
    key, frames, busy = identifiers[bus, slots].T
    extended = slots >= STANDARD
    can_id = np.where(extended, key - 1, slots)
    order = np.lexsort((can_id, extended))
    columns = (column[order].tolist() for column in (can_id, extended, frames, busy))
    return list(zip(*columns, strict=True))
