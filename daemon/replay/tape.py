"""The tape: everything that the loop takes in and every command that it gives, in order, through shared memory.

The loop appends entries with plain copies and never waits; one reader takes them away. Where that is too slow, or not there, what
was on the tape before stays: what finds no room is not written, nor is anything after it, and the tape says in which cycle it
broke off (`broken_in`). As in daemon.exchange.ring, all of this rests on stores becoming visible in program order.

An entry is whole 64-bit words: kind | body's length << 8, cycle, robot's time at the cycle's start as the loop knew it, body.
"""

from __future__ import annotations

import enum
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon.exchange.shared_file import COUNTER, OTHER_COUNTER, WORDS, Attached, create

MARK = 0x48525441504501
SIZE = 1 << 22
"""64-bit words of a tape, 32 MiB: 11,000 cycles of TALOS' upper body"""
_BROKEN = COUNTER + 1
_HEAD, _FIRST = 3, WORDS * 8
_NUMBERS = [struct.Struct(f"={_HEAD + count}q").pack_into for count in range(4)]

Words = NDArray[np.uint64]


@enum.unique
class Kind(enum.IntEnum):
    """What an entry tells, and the words of its body."""

    SKIPPED = 0
    """nothing: the tape goes on at its beginning"""
    START = 1
    """the loop's start: JSON (daemon.replay.recorded_loop.LoopStart)"""
    RECEIVED = 2
    """one look at the bus: plant's ticks so far, frames (hal.can.frames)"""
    SENT = 3
    """frames"""
    COMMAND = 4
    """a cycle is over: its time ns, its lateness ns, memory of the JointCommand that it decided on"""
    ORDER = 5
    """a command out of the mailbox: its header, its payload"""
    STOP = 6
    """a request at the stop socket: 1 stop, 0 clear; length of the reason; the reason"""
    WAIT = 7
    """whether the loop waited on for late replies: 0, 1"""
    CONTROLLER = 8
    """the workshop has finished something: slot, daemon.exchange.ControllerState"""
    MOTION = 9
    """a start asked for a prepared motion: serial, whether it was there"""
    SKIP = 10
    """periods that went by without a cycle"""
    END = 11
    """the loop ends; what it sends then follows"""


@dataclass(frozen=True)
class Entry:
    """One entry, copied off the tape."""

    kind: Kind
    cycle: int
    time_ns: int
    body: Words


class TapeWriter:
    """The loop's side."""

    def __init__(self, path: Path, size: int = SIZE):
        """`size`: in words."""
        self._memory = create(path, WORDS * 8 + size * 8, magic=MARK, record_size=8, count=size)
        self._words = memoryview(self._memory)[: WORDS * 8].cast("q")
        np.frombuffer(self._memory, np.uint64, size, _FIRST).fill(0)  # no page is touched first in mid-cycle
        self._size, self._at, self._whole = 8 * size, 0, True
        self.cycle = self.time_ns = 0
        """of the entries that follow"""
        self.in_cycle = False
        """set and asked by who writes"""

    def put(self, kind: int, numbers: tuple[int, ...] = (), *data: NDArray[Any]) -> None:
        """Append an entry: signed numbers, then the memory of contiguous arrays that are whole words long."""
        size = 8 * (_HEAD + len(numbers))
        length = size
        for part in data:
            length += part.nbytes
        at = self._room(length)
        if at < 0:
            return
        memory = self._memory
        _NUMBERS[len(numbers)](memory, at, kind | (length - 8 * _HEAD) << 5, self.cycle, self.time_ns, *numbers)
        at += size
        for part in data:  # mmap copies whatever lies in one piece: quicker than any view of it is made
            memory[at : at + part.nbytes] = part  # type: ignore[call-overload]
            at += part.nbytes
        self._words[COUNTER] = self._at

    def _room(self, length: int) -> int:
        """Where in the memory an entry of so many bytes goes, in one piece; −1: the tape is broken."""
        size, at = self._size, self._at % self._size
        rest = size - at if at + length > size else 0
        if not self._whole or self._at + rest + length - self._words[OTHER_COUNTER] > size:
            self._break()
            return -1
        if rest:
            self._memory[_FIRST + at : _FIRST + at + 8] = bytes(8)
            at = 0
        self._at += rest + length
        return _FIRST + at

    def _break(self) -> None:
        if self._whole:
            self._whole, self._words[_BROKEN] = False, self.cycle + 1


class TapeReader:
    """The other side: one process."""

    def __init__(self, path: Path):
        self._file = Attached(path, MARK, 8)
        self._mapped = 0

    @property
    def generation(self) -> int:
        """0: no loop has made a tape yet; goes up by one whenever one has started anew."""
        return self._file.generation

    @property
    def broken_in(self) -> int | None:
        """The cycle that did not get onto the tape whole, nor did anything after it; None: all of them did so far.

        Ask after `read`: what was written before is there.
        """
        return int(self._words[_BROKEN]) - 1 if self._mapped and self._words[_BROKEN] else None

    @property
    def begun(self) -> bool:
        """Somebody has taken entries off this tape."""
        return bool(self._mapped and self._words[OTHER_COUNTER])

    def attach(self) -> bool:
        """Map the tape that lies there now, a new one too. False: none has ever been there."""
        if not self._file.refresh():
            return False
        if self._mapped != self._file.generation:
            self._mapped = self._file.generation
            assert self._file.memory is not None
            self._words = np.frombuffer(self._file.memory, np.int64, WORDS)
            self._body = np.frombuffer(self._file.memory, np.uint64, self._file.count, WORDS * 8)
        return True

    def read(self) -> Iterator[Entry]:
        """Take away what is on the tape that was attached last, oldest first. An entry is gone once the next is asked for."""
        if not self._mapped:
            return
        size = len(self._body)
        at, end = int(self._words[OTHER_COUNTER]) // 8, int(self._words[COUNTER]) // 8
        while at < end:
            place = at % size
            first = int(self._body[place])
            kind, length = Kind(first & 0xFF), first >> 8
            if kind is Kind.SKIPPED:
                at += size - place
            else:
                cycle, time_ns = self._body[place + 1 : place + _HEAD].view(np.int64).tolist()
                yield Entry(kind, cycle, time_ns, self._body[place + _HEAD : place + _HEAD + length].copy())
                at += _HEAD + length
            self._words[OTHER_COUNTER] = 8 * at


def as_words(data: bytes) -> Words:
    """Bytes, padded with zeros, as words."""
    return np.frombuffer(data.ljust(-(-len(data) // 8) * 8, b"\0"), np.uint64)
