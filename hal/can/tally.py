"""What the channels have carried, frame by frame: totals, and each identifier's share.

`totals` (channels, 4): columns `FREE`, `FRAMES`, `BUSY`, `ERRORS`. `identifiers` (channels, slots, 3): key, frames, busy ns; a
standard identifier's slot is the identifier, an extended one's is found by hashing and has the identifier + 1 as its key.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from hal.can.frames import EXTENDED, WORDS

FREE, FRAMES, BUSY, ERRORS = 0, 1, 2, 3
"""ns when the bus was last free · frames carried · ns in use · error frames"""
STANDARD = 2048
_EXTENDED = 2048  # slots for extended identifiers, a power of 2; what finds none is in the totals only
_PROBES = 32


def totals(channels: int) -> npt.NDArray[np.int64]:
    """All zero."""
    return np.zeros((channels, 4), np.int64)


def identifiers(channels: int) -> npt.NDArray[np.int64]:
    """All zero."""
    return np.zeros((channels, STANDARD + _EXTENDED, 3), np.int64)


@njit(cache=True)
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
    table = identifiers[bus]
    slots = np.flatnonzero(table[:, 1] + table[:, 2])
    rows = [
        (int(slot) if slot < STANDARD else int(key) - 1, bool(slot >= STANDARD), int(frames), int(busy))
        for slot, (key, frames, busy) in zip(slots, table[slots], strict=True)
    ]
    return sorted(rows, key=lambda row: (row[1], row[0]))
