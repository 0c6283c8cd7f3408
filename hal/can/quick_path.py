"""The quick path of the hub: whole batches get onto their buses at once, and nothing is under way between two of them.

It is walked while the bus keeps no bit timing and no fault is near; else `hal.can.careful_path` is. A batch takes one kernel, from
what processes wrote to what those get who hear everything.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from hal.can import datagrams, tally
from hal.can.arbitration import admit, arbitrate, by_priority, select
from hal.can.frames import MAX_CHANNELS, RECORD, TICK, WORDS
from hal.can.tally import Tally
from hal.can.wire import MAX_RECORDS
from hal.drives.borrowing import borrowed
from handrail.compiled import compiled

CAPACITY = 8192
"""records that one batch takes"""
ROOM = 16384
"""records that one turn of the bus passes on"""
MOST_NODES = 64
"""processes on the bus; node 0 is the hub itself. Its own nodes are numbered behind"""
_NODES, _ANY_SENDER, _NOT_ITS_OWN = 0, -1, -1


class QuickPath:
    """The records of one turn: `inbox` as they came, `records` as the buses carry them, `senders` the nodes behind both."""

    def __init__(self, tallies: Tally, own_nodes: int):
        """`own_nodes`: how many the hub has in its own process, numbered from MOST_NODES on."""
        channels, nodes = len(tallies.bitrates), MOST_NODES + own_nodes
        self.inbox = np.zeros(WORDS * (CAPACITY + MAX_RECORDS + 1), np.uint64)
        """where processes' datagrams are read into"""
        self.inbox_bytes = self.inbox.data.cast("B")
        self.inbox_records = self.inbox.view(RECORD)
        self.carried = np.zeros(WORDS * ROOM, np.uint64)
        self.records = self.carried.view(RECORD)
        self.selected = np.zeros(WORDS * (ROOM + CAPACITY), np.uint64)
        self._tally, self._own_nodes = tallies, own_nodes
        self._book = np.zeros(1 + sum(_sizes(channels, nodes)), np.int64)
        self._book[_NODES] = nodes
        self.inbound, heads, _, self.inbox_senders, self.senders, _ = _pages(self._book, channels)
        """`inbound` (MOST_NODES, 16): by node, its index of a channel → the hub's, −1 where it has none"""
        heads[:] = -1
        self.inbound[:] = -1
        self.inbound[0, :channels] = np.arange(channels)
        self._order = np.zeros(CAPACITY, np.int64)
        self._nameless = np.zeros(CAPACITY, np.int64)
        # Compile every kernel before anybody joins: a slow first cycle would fill the sockets.
        datagrams.take(-1, self.inbox, 0)
        datagrams.post(-1, self.carried, 0, 0)
        self.carry_inbox(0, 0)
        self.admit_inbox(0)
        self.transmit(self.inbox[:0], 0, self._nameless[:0], 0, 0)
        by_priority(self.inbox, 0, self._order)
        self.select(0, self.inbound[0], 0)

    def carry_inbox(self, n: int, now: int) -> int:
        """Put the n records of the inbox onto their buses at `now` (ns); returns how many were good."""
        return int(
            _carry(self.inbox, self.inbox_senders, n, 0, _ANY_SENDER, now, 0, self.inbox, self._tally.memory,
                   self._book, self.carried)
        )  # fmt: skip

    def admit_inbox(self, n: int) -> int:
        """Move the good ones of the n records of the inbox together, their channels as the hub counts; returns how many."""
        return int(_admit_all(self.inbox, self.inbox_senders, n, 0, self.inbox, self.inbox_senders, self.inbound))

    def transmit(
        self, words: npt.NDArray[np.uint64], n: int, senders: npt.NDArray[np.int64] | None, now: int, ticks: int
    ) -> None:
        """Put n records of the hub's own nodes onto their buses at `now` (ns), and `ticks` notices behind them.

        senders: see Hub.transmit. Raises ValueError when a record is no CAN frame, its channel is not there or a sender is not.
        """
        first, known = MOST_NODES, self._own_nodes
        if senders is None:
            by_priority(words, n, self._order)
            words = words.reshape(n, WORDS)[self._order[:n]].ravel()
            senders, first, known = self._nameless, 0, 1
        elif len(senders) != n:
            raise self._no_sender(n, senders)
        good = _carry(
            words, senders, n, first, known, now, ticks, self.inbox, self._tally.memory, self._book, self.carried
        )
        if good < 0:
            raise self._no_sender(n, senders)
        if good != n:
            raise _no_frame(n, good)

    def take_own(self, words: npt.NDArray[np.uint64], n: int, senders: npt.NDArray[np.int64] | None) -> None:
        """Put n records of the hub's own nodes into the inbox, for the careful path. Raises ValueError as `transmit` does."""
        if senders is None:
            numbers = self._nameless[:n]
        elif len(senders) != n or (n and not 0 <= senders.min() <= senders.max() < self._own_nodes):
            raise self._no_sender(n, senders)
        else:
            numbers = senders + MOST_NODES
        good = _admit_all(words, numbers, n, 0, self.inbox, self.inbox_senders, self.inbound)
        if good != n:
            raise _no_frame(n, good)

    def select(self, n: int, outbound: npt.NDArray[np.int64], listener: int | None) -> int:
        """Copy of the n records carried those that a listener wants to the selection; returns how many.

        outbound (16,): hub's channel index → the listener's, −1 where it does not listen; listener: its number, whose own frames
        it does not get, or None.
        """
        skip = _NOT_ITS_OWN if listener is None else listener
        return int(select(self.carried, self.senders, n, skip, outbound, self.selected))

    def append(self, count: int, n: int, ticks: int) -> None:
        """Put the notices that lie behind n records carried behind `count` selected ones."""
        self.selected[WORDS * count : WORDS * (count + ticks)] = self.carried[WORDS * n : WORDS * (n + ticks)]

    def _no_sender(self, n: int, senders: npt.NDArray[np.int64]) -> ValueError:
        return ValueError(f"hub: senders {senders}; expected {n} places in {self._own_nodes} own nodes")


def _no_frame(n: int, good: int) -> ValueError:
    return ValueError(f"hub: {n - good} of {n} records are no CAN frames or name a channel that is not there")


@compiled
def _sizes(channels, nodes):  # type: ignore[no-untyped-def]
    """Of the pages of a book: see `_pages`."""
    return MOST_NODES * MAX_CHANNELS, channels * nodes * 2, CAPACITY, CAPACITY, ROOM, 3 * channels


@compiled
def _pages(book, channels):  # type: ignore[no-untyped-def]
    """inbound, then work space: heads, following, who sent each record that came and each that was carried, state of each bus."""
    nodes = book[_NODES]
    inbound, heads, following, sent, carried, buses = _sizes(channels, nodes)
    a = 1 + inbound
    b = a + heads
    c = b + following
    d = c + sent
    e = d + carried
    return (
        book[1:a].reshape(MOST_NODES, MAX_CHANNELS),
        book[a:b].reshape(channels, nodes, 2),
        book[b:c],
        book[c:d],
        book[d:e],
        book[e : e + buses].reshape(3, channels),
    )


@compiled
def _admit_all(words, senders, n, first, out, out_senders, inbound):  # type: ignore[no-untyped-def]
    """Copy the good ones of n records to `out`, senders' numbers counted from `first` on; returns how many."""
    good = 0
    for row in range(n):
        who = senders[row] + first
        if admit(words, row, inbound[who if who < MOST_NODES else 0], out, good):
            out_senders[good] = who
            good += 1
    return good


@compiled
def _carry(words, senders, n, first, known, now, ticks, inbox, memory, book, out):  # type: ignore[no-untyped-def]
    """Admit n records and put them onto their buses; returns how many were good.

    known ≥ 0: `senders` are places among so many nodes; then either all records are good, or nothing is carried, and −1 says
    that a sender is none of them.
    """
    words, senders, inbox, out = borrowed(words), borrowed(senders), borrowed(inbox), borrowed(out)
    bitrates, totals, identifiers = borrowed(tally.tables(borrowed(memory)))
    inbound, heads, following, node, out_node, buses = borrowed(_pages(borrowed(book), len(bitrates)))
    if known >= 0:
        for row in range(n):
            if not 0 <= senders[row] < known:
                return -1
    good = _admit_all(words, senders, n, first, inbox, node, inbound)
    if known >= 0 and good != n:
        return good
    arbitrate(inbox, node, good, now, bitrates, totals, identifiers, out, out_node, heads, following, buses)
    for row in range(good, good + ticks):
        out[WORDS * row : WORDS * (row + 1)] = 0
        out[WORDS * row] = np.uint64(now)
        out[WORDS * row + 1] = np.uint64(TICK) << np.uint64(40)
    return good
