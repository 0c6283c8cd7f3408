"""How long each cycle of the loop works and how late it starts: two histograms that the loop counts and the server reads.

Eight bins an octave from 2¹⁰ ns (1 µs) to 2³⁰ ns (1 s), each an eighth of its octave's start wide, so that shifting finds the bin
(the scheme of HdrHistogram); one more takes what is shorter, one what is longer. All of it lies in shared memory word by word:
a reader may meet the loop between two words of a cycle, and is then off by that cycle.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

import numpy as np

from daemon.exchange.shared_file import COUNTER, OTHER_COUNTER, WORDS, Attached, create
from handrail.messages import LoopTiming, TimeDistribution

MARK = 0x48525449_4D45_01
_FIRST_BIT, _LAST_BIT = 10, 30
_BELOW = 8 * (_FIRST_BIT - 3) + 7
BINS = 8 * (_LAST_BIT - _FIRST_BIT) + 2
EDGES_NS = np.array(
    [(8 + eighth) << (bit - 3) for bit in range(_FIRST_BIT, _LAST_BIT) for eighth in range(8)] + [1 << _LAST_BIT]
)
"""(BINS − 1,) ns: bin i holds EDGES_NS[i − 1] ≤ t < EDGES_NS[i]"""
RECORD = np.dtype(
    [
        ("misses", "i8"),  # periods skipped
        ("longest_run", "i8"),  # most periods that were skipped by cycles one after the other
        ("work_max_ns", "i8"),
        ("late_max_ns", "i8"),
        ("work", "i8", BINS),
        ("late", "i8", BINS),
    ]
)
_MISSES, _LONGEST_RUN, _WORK_MAX, _LATE_MAX, _WORK = range(WORDS, WORDS + 5)
_LATE = _WORK + BINS
"""where those lie, in words of the file"""
_NOTHING = bytes(RECORD.itemsize)

OVERRUN_POLICY = {
    "wall": "a cycle that overruns skips whole periods and keeps phase; nothing is made up for, "
    "and the drives go on by the last command",
    "lockstep": "the plant waits for the loop: no cycle is late, and no period is skipped",
}


def bin_of(ns: int) -> int:
    """The bin of a time ≥ 0."""
    if ns < 1 << _FIRST_BIT:
        return 0
    shift = ns.bit_length() - 4  # leaves 8..15: the eighth of the octave
    place = 8 * shift + (ns >> shift) - _BELOW
    return place if place < BINS else BINS - 1


class TimingWriter:
    """The loop's side: it waits for nobody and allocates nothing."""

    def __init__(self, path: Path):
        self._memory = create(path, WORDS * 8 + RECORD.itemsize, magic=MARK, record_size=RECORD.itemsize, count=1)
        self._words = memoryview(self._memory).cast("q")
        self._asked = self._work_max = self._late_max = self._cycles = 0
        self._run, self._overran = 0, -1

    def count(self, work_ns: int, late_ns: int | None) -> None:
        """Count one cycle. `late_ns`: how long after its time it started; None in lock-step, where no time is set."""
        words = self._words
        if words[OTHER_COUNTER] != self._asked:
            self._begin_anew()
        self._cycles += 1
        words[_WORK + bin_of(work_ns)] += 1
        if work_ns > self._work_max:
            self._work_max = words[_WORK_MAX] = work_ns
        if late_ns is not None:
            words[_LATE + bin_of(late_ns)] += 1
            if late_ns > self._late_max:
                self._late_max = words[_LATE_MAX] = late_ns

    def missed(self, periods: int) -> int:
        """The cycle counted last overran, and so many periods are skipped; how many that are in a row."""
        words = self._words
        # A punctual cycle in between has ended the run.
        self._run = periods + (self._run if self._overran == self._cycles - 1 else 0)
        self._overran = self._cycles
        words[_MISSES] += periods
        words[_LONGEST_RUN] = max(words[_LONGEST_RUN], self._run)
        return self._run

    def _begin_anew(self) -> None:
        words = self._words
        self._memory[WORDS * 8 :] = _NOTHING
        self._work_max = self._late_max = self._run = 0
        self._asked = words[COUNTER] = words[OTHER_COUNTER]


class TimingReader:
    """The server's side."""

    def __init__(self, path: Path):
        self._file = Attached(path, MARK, RECORD.itemsize)

    def read(self) -> np.ndarray | None:
        """What was counted since the loop's start or the last `begin_anew`, RECORD (); None: no loop has started yet."""
        if not self._file.refresh():
            return None
        assert self._file.memory is not None
        words = np.frombuffer(self._file.memory, np.int64, WORDS)
        if words[COUNTER] != words[OTHER_COUNTER]:  # the loop has not come to it; while time is held it does not
            return np.zeros((), RECORD)
        return np.frombuffer(self._file.memory, RECORD, 1, WORDS * 8)[0].copy()

    def begin_anew(self) -> None:
        """Have the loop forget what it counted, in its next cycle."""
        if self._file.refresh():
            assert self._file.memory is not None
            np.frombuffer(self._file.memory, np.int64, WORDS)[OTHER_COUNTER] += 1


def loop_timing(
    record: np.ndarray, clock: Literal["wall", "lockstep"], period_ns: int, stop_after_misses: int = 0
) -> LoopTiming:
    """A RECORD () as a message; `stop_after_misses`: as in the robot's description."""
    policy = OVERRUN_POLICY[clock]
    if clock == "wall" and stop_after_misses:
        policy += f"; {stop_after_misses} periods in a row stop the robot, as handrail stop does"
    return LoopTiming(
        clock=clock,
        period_us=period_ns / 1e3,
        cycles=int(record["work"].sum()),
        misses=int(record["misses"]),
        longest_run=int(record["longest_run"]),
        overrun_policy=policy,
        edges_us=(EDGES_NS / 1e3).tolist(),
        work=distribution(record["work"], int(record["work_max_ns"])),
        late=distribution(record["late"], int(record["late_max_ns"])),
    )


def distribution(counts: np.ndarray, longest_ns: int) -> TimeDistribution:
    """Counts (BINS,) with their percentiles: the upper edge of the bin in which one lies, never more than the longest time."""
    up_to = np.cumsum(counts)
    p50, p90, p99 = (_percentile(up_to, share, longest_ns) / 1e3 for share in (0.5, 0.9, 0.99))
    return TimeDistribution(counts=counts.tolist(), p50_us=p50, p90_us=p90, p99_us=p99, max_us=longest_ns / 1e3)


def _percentile(up_to: np.ndarray, share: float, longest_ns: int) -> int:
    place = int(np.searchsorted(up_to, max(math.ceil(share * int(up_to[-1])), 1)))
    return min(int(EDGES_NS[place]), longest_ns) if place < len(EDGES_NS) else longest_ns
