"""Everything about the hub's channels while frames are under way, as one tuple of arrays for the kernels of the careful path.

`hal.can.queues` fills and empties the transmit queues, `hal.can.transit` moves frames over the wire, `hal.can.disturbance` writes
down which nodes and frames a fault is about, `hal.can.confinement` keeps the error counters.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hal.can.confinement import COLUMNS, recover
from hal.can.frames import WORDS
from hal.can.tally import FREE
from handrail.compiled import compiled

POOL = 32768
"""Frames that may be on their way at once."""
RESERVE = 16
"""of them, for babblers: one frame a channel"""
NEVER = 1 << 62
"""ns, later than everything"""

NEXT, NODE, READY, MARK = 0, 1, 2, 3
DROP, TWICE, BABBLE = 1, 2, 4
"""Marks of a queued frame: it is sent but reaches nobody · it is sent twice · it never was in a queue."""
HEAD, TAIL, LENGTH, OVERFLOWS = 0, 1, 2, 3
ROW, BEGAN, END, BAD, RECESSIVE = 0, 1, 2, 3, 4
"""Columns of `wire`: the frame on it (−1: none), since when, until when, 1 if it will be destroyed; runs of 11 recessive bits."""
BUS_MASK, CAN_ID, ID_MASK, EXTENDED_ID, LEFT, CHANCE, HITS = 0, 1, 2, 3, 4, 5, 6
"""Columns of `errors`: channels as bits, identifier (−1: all), mask, 1: extended, frames left (−1: all), chance / 2^53, hits."""
MOST_ERRORS = 16


class State(NamedTuple):
    """Everything about all channels. c channels, n nodes."""

    bitrates: npt.NDArray[np.int64]
    """(c, 2) nominal and data bit/s"""
    totals: npt.NDArray[np.int64]
    identifiers: npt.NDArray[np.int64]
    pool: npt.NDArray[np.uint64]
    """(POOL WORDS,) the frames"""
    link: npt.NDArray[np.int64]
    """(POOL, 4) of each: the one behind it in its queue, who sends it, from when (ns), marks"""
    spare: npt.NDArray[np.int64]
    """(POOL + 1,) free rows of the pool; the last element says how many"""
    queue: npt.NDArray[np.int64]
    """(c, n, 4) each node's transmit FIFO: first and last row (−1), length, frames refused or thrown away"""
    counters: npt.NDArray[np.int64]
    """(c, n, 6) hal.can.confinement"""
    present: npt.NDArray[np.bool_]
    """(c, n) who is on which channel"""
    wire: npt.NDArray[np.int64]
    """(c, 5)"""
    babble: npt.NDArray[np.int64]
    """(c, n, 3) identifier that a node babbles (−1: it does not), since when (ns), frames so far"""
    errors: npt.NDArray[np.int64]
    """(MOST_ERRORS, 7) faults that destroy frames on the wire"""
    error_nodes: npt.NDArray[np.bool_]
    """(MOST_ERRORS, n) whose frames each of them destroys"""
    random: npt.NDArray[np.uint64]
    """(MOST_ERRORS,) their random numbers' state"""


def make(
    bitrates: npt.NDArray[np.int64],
    totals: npt.NDArray[np.int64],
    identifiers: npt.NDArray[np.int64],
    nodes: int,
) -> State:
    """Nothing on its way, no error, nobody present."""
    channels = len(bitrates)
    queue = np.zeros((channels, nodes, 4), np.int64)
    queue[:, :, (HEAD, TAIL)] = -1
    wire = np.zeros((channels, 5), np.int64)
    wire[:, ROW] = -1
    babble = np.zeros((channels, nodes, 3), np.int64)
    babble[:, :, 0] = -1
    spare = np.append(np.arange(POOL - 1, -1, -1), POOL)
    return State(
        bitrates=bitrates,
        totals=totals,
        identifiers=identifiers,
        pool=np.zeros(POOL * WORDS, np.uint64),
        link=np.zeros((POOL, 4), np.int64),
        spare=spare,
        queue=queue,
        counters=np.zeros((channels, nodes, COLUMNS), np.int64),
        present=np.zeros((channels, nodes), np.bool_),
        wire=wire,
        babble=babble,
        errors=np.zeros((MOST_ERRORS, 7), np.int64),
        error_nodes=np.zeros((MOST_ERRORS, nodes), np.bool_),
        random=np.zeros(MOST_ERRORS, np.uint64),
    )


@compiled
def recessive(s, bus, now):
    """Runs of 11 recessive bits that the channel has had until `now`: one at each frame's end, and those of idle time."""
    idle = now - s.totals[bus, FREE] if s.wire[bus, ROW] < 0 else 0
    return s.wire[bus, RECESSIVE] + max(0, idle) * s.bitrates[bus, 0] // 11_000_000_000


@compiled
def catch_up(s, bus, now):
    """Let time pass for the nodes that are bus-off on a channel."""
    recover(s.counters, bus, recessive(s, bus, now))
