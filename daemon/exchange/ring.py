"""The ring of snapshots through which the loop tells the processes beside it what the robot does.

The loop never waits for a reader: it overwrites the oldest snapshot. Snapshots are guarded as in a seqlock: a slot's sequence
number is withdrawn, the record copied, the number set; a reader copies, then looks whether the number still stands. This
rests on stores becoming visible in program order, which x86-64 guarantees (Intel SDM vol. 3, 8.2.2), and on aligned 8-byte
words being written whole.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from daemon.exchange.shared_file import COUNTER, WORDS, Attached, create, whole_lines

MARK = 0x48525354415445_01


def _slot(record: np.dtype) -> np.dtype:
    """One snapshot with its sequence number in front, in whole cache lines."""
    return np.dtype(
        {
            "names": ["sequence", "record"],
            "formats": [np.int64, record],
            "offsets": [0, 8],
            "itemsize": whole_lines(8 + record.itemsize),
        }
    )


class StateRingWriter:
    """The loop's side: fill `record`, then `publish`. Never waits, never allocates after the start."""

    def __init__(self, path: Path, record: np.dtype, capacity: int = 2048):
        """`record`: dtype of one snapshot; `capacity`: how many snapshots a slow reader may fall behind."""
        slot = _slot(record)
        self._memory = create(
            path, WORDS * 8 + capacity * slot.itemsize, magic=MARK, record_size=record.itemsize, count=capacity
        )
        self._words = memoryview(self._memory).cast("q")  # single words cost less through it than through numpy
        self.record = np.zeros((), record)
        """the snapshot to be published next, shape (); keeps what was filled in before"""
        self._bytes = self.record.reshape(1).view(np.uint8).data
        self._capacity, self._slot_size = capacity, slot.itemsize
        self.sequence = 0
        """of the snapshot published last; the first has 1"""

    def publish(self) -> int:
        """Let readers see a copy of `record`. Returns its sequence number."""
        sequence = self.sequence + 1
        place = WORDS * 8 + sequence % self._capacity * self._slot_size
        words, number, record = self._words, place // 8, place + 8
        words[number] = -1
        self._memory[record : record + len(self._bytes)] = self._bytes
        words[number] = sequence
        words[COUNTER] = sequence
        self.sequence = sequence
        return sequence


class StateRingReader:
    """Reads snapshots in order, across restarts of the loop. Any number of readers; none of them disturbs the loop."""

    def __init__(self, path: Path, record: np.dtype):
        self._file = Attached(path, MARK, record.itemsize)
        self._record = record
        self._last = 0
        self._mapped = 0
        self.missed = 0
        """snapshots overwritten before they were read"""

    @property
    def generation(self) -> int:
        """0: no loop has started yet; goes up by one whenever one has started anew."""
        return self._file.generation

    def read(self) -> np.ndarray:
        """Copies of the snapshots published since the last call, oldest first, shape (k,), k ≥ 0.

        The first call gives the newest only. Never spans a restart of the loop: what the old loop had published and was not
        read before the new one started is lost.
        """
        if not self._attach():
            return np.zeros(0, self._record)
        head = int(self._words[COUNTER])
        # One slot less than there are: the next one is the writer's to overwrite at any moment.
        first = max(self._last + 1, head - self._file.count + 2)
        self.missed += first - self._last - 1
        if (fresh := head - first + 1) <= 0:
            return np.zeros(0, self._record)
        copies = _along(self._rows, first, fresh).view(self._record).reshape(fresh)
        whole = _along(self._numbers, first, fresh) == np.arange(first, head + 1)
        self._last = head
        if whole.all():
            return copies
        self.missed += int(np.count_nonzero(~whole))
        return copies[whole]

    def _attach(self) -> bool:
        if not self._file.refresh():
            return False
        if self._mapped != self._file.generation:
            first_ever = self._mapped == 0
            self._mapped = self._file.generation
            assert self._file.memory is not None
            self._words = np.frombuffer(self._file.memory, np.int64, WORDS)
            slot = _slot(self._record)
            slots = np.frombuffer(self._file.memory, slot, self._file.count, WORDS * 8)
            self._numbers = slots["sequence"]
            # As rows of bytes: numpy copies a record's fields one by one.
            place = slot.fields["record"][1]  # type: ignore[index]
            self._rows = slots.view(np.uint8).reshape(-1, slot.itemsize)[:, place : place + self._record.itemsize]
            self._last = max(0, int(self._words[COUNTER]) - 1) if first_ever else 0
        return True


def _along(ring: np.ndarray, first: int, n: int) -> np.ndarray:
    """A copy of n items of a ring (slots, ...), the one with the sequence number `first` and those that follow it."""
    at = first % len(ring)
    return np.concatenate((ring[at : at + n], ring[: max(0, at + n - len(ring))]))
