"""The virtual CAN bus: a hub that arbitrates frames by identifier and sends every frame to everybody else.

Processes join over a Unix seqpacket socket (hal.can.wire, hal.can.members); the simulated drives sit in the hub's own process and
use `poll` and `transmit`. No listener can hold up the bus: what a slow one has not taken waits in a bounded queue, then is dropped,
counted, and told to it (hal.can.frames.LOST). Timestamps are when a frame would have ended on a real bus of that bit rate,
counted on the hub's clock; frames are passed on at once (hal.can.quick_path).

With bit timing on, frames wait in their sender's FIFO, go out as the arbitration lets them, and are passed on when they end. So
do they while a fault is on the bus, though then only a babbling node makes them take their time (hal.can.careful_path).
"""

from __future__ import annotations

import contextlib
import errno
import os
import select
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from hal.awake import Awake
from hal.can import datagrams, wire
from hal.can.alarm import Alarm
from hal.can.careful_path import CarefulPath
from hal.can.control import BusReport, NodeState
from hal.can.faults import Fault
from hal.can.frames import BYTES, MAX_CHANNELS, RECORD, TICK, WORDS, WordViews
from hal.can.hub_control import answer
from hal.can.hub_report import ChannelStatistics, Reporter
from hal.can.members import Members
from hal.can.node import Node
from hal.can.quick_path import CAPACITY, MOST_NODES, QuickPath
from hal.can.tally import Tally
from hal.can.timing import BusTiming
from hal.can.traffic import Traffic

_TURN = 16
"""Datagrams that one poll takes from one node, so that a flood from one can't starve the others."""
_SPARED = 8
"""lock-step: polls in which a node from which a second datagram was awaited in vain is not asked for one"""
_QUEUE = 65536
"""Records that wait for one slow listener, about 5 MB."""
_FIFO = 128
"""Frames that a node's transmit FIFO on one channel holds: at 1/5 Mbit/s some 20 ms of a full bus."""
_IN, _OUT = select.EPOLLIN, select.EPOLLOUT


class Hub:
    """The bus, and the hub's own node on it."""

    def __init__(
        self,
        path: str | os.PathLike[str],
        channels: Sequence[str | BusTiming],
        *,
        clock: Callable[[], int] = time.time_ns,
        queue: int = _QUEUE,
        timing: bool = False,
        fifo: int = _FIFO,
    ):
        """Listens at `path`. `channels`: names, or anything with name, bitrate and data_bitrate (bit/s).

        clock: ns for the frames' timestamps; the plant gives its own. queue: records that may wait for a slow listener.
        timing: frames take the time that they would on a real bus; fifo: frames in each node's transmit queue on a channel.
        Raises ValueError on a bad list of channels, OSError when the path can't be used or another hub listens there.
        """
        self.channels = [
            BusTiming(c) if isinstance(c, str) else BusTiming(c.name, c.bitrate, c.data_bitrate) for c in channels
        ]
        names = [channel.name for channel in self.channels]
        if not 1 <= len(names) <= MAX_CHANNELS or len(set(names)) != len(names):
            raise ValueError(f"hub: channels {names}; expected 1 to {MAX_CHANNELS} different names")
        self._clock, self._timing, self._fifo = clock, timing, fifo
        self._names = ["hub", *(f"node{number}" for number in range(1, MOST_NODES))]
        self._tally, self._own_channels = Tally(self.channels), np.zeros(0, np.int64)
        self._reporter = Reporter(self.channels, self._tally, self._names)
        self.refused = 0
        """records that were no CAN frames, or for a channel that is not there"""
        self.dropped = 0
        """records dropped for slow listeners"""
        self._lockstep, self._awake = False, Awake()
        self._ticks_owed, self._views = 0, WordViews()
        self._sent_by: list[Node] = []  # whose datagrams this poll has taken
        self._lay_paths()
        self._epoll = select.epoll()
        self._members = Members(Path(path), self.channels, self._epoll, queue)
        self._alarm = Alarm()
        self._epoll.register(self._alarm, _IN)

    def _lay_paths(self) -> None:
        self._quick = QuickPath(self._tally, len(self._own_channels))
        self._traffic = Traffic(self.channels, self._tally, self._names, timing=self._timing, fifo=self._fifo)
        self._careful = CarefulPath(self._quick, self._traffic)

    def own_nodes(self, names: Sequence[str], channels: Sequence[str]) -> None:
        """Say who the hub's own nodes are, and on which channel each is; `transmit` counts them in this order.

        Raises ValueError on a name given twice and on a channel that is not there.
        """
        known = [channel.name for channel in self.channels]
        if len(names) != len(channels):
            raise ValueError(
                f"hub: own nodes: {len(names)} names and {len(channels)} channels; expected one channel each"
            )
        for name, channel in zip(names, channels, strict=True):
            if names.count(name) > 1:
                raise ValueError(f"hub: own nodes: name {name!r} twice; expected different names")
            if channel not in known:
                raise ValueError(f"hub: own node {name}: channel {channel!r}; expected one of {known}")
        if self.listeners or self._traffic.disturbance:
            raise ValueError("hub: own nodes: the bus is in use already; expected before anybody joins")
        self._own_channels = np.array([known.index(channel) for channel in channels], np.int64)
        self._names[MOST_NODES:] = names
        self._lay_paths()
        for number, bus in enumerate(self._own_channels.tolist(), MOST_NODES):
            self._traffic.join(number, [bus])

    def lockstep(self, period_ns: int, sync: int, hold: int) -> None:
        """Say that the clock stands until whoever runs the hub has heard Sync (identifier, first channel) from the host.

        On a bus that keeps bit timing a cycle's frames then have a period's time, as they would: what has not ended by then
        comes in the next cycle. HoldTime, which says that time stands, takes no time on the bus.
        """
        self._lockstep = True
        self._careful.lockstep(period_ns, sync, hold)

    # ------------------------------------------------------------------------------------------------------------ frames

    def poll(self, timeout_s: float | None = 0.0) -> npt.NDArray[np.void]:
        """Frames from the other processes since the last call, in the order in which the buses carry them.

        Waits at most `timeout_s` for the first (None: for ever, 0: not at all). A datagram is never split between two
        calls. The frames have been passed on to everybody else; the view holds until the next `poll` or `transmit`.
        """
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        wait, quick, careful = timeout_s, self._quick, self._careful
        careful.heard = None
        while True:
            if careful.needed:
                wait = careful.wait(self._alarm, self._clock, deadline)
            n = self._gather(wait)
            if careful.needed:
                good = quick.admit_inbox(n)
                ended = careful.turn(good, self._clock())
                self._pass_on_selected(ended)
                received = careful.read(ended)
            else:
                good = quick.carry_inbox(n, self._clock()) if n else 0
                self._pass_on(good)
                received = quick.records[:good]
            self.refused += n - good
            if good or len(received):
                return received
            if deadline is not None:
                wait = deadline - time.monotonic()
                if wait <= 0.0:
                    return quick.records[:0]

    def transmit(
        self, records: npt.NDArray[np.void], senders: npt.NDArray[np.int64] | None = None
    ) -> npt.NDArray[np.void]:
        """Send frames of the hub's own nodes to everybody else.

        senders (n,): who sends each frame, as a place in `own_nodes`' names; None: each is sent by a nameless node of its
        own. Returns the frames as the buses carried them; the view holds until the next `poll` or `transmit`. Raises
        ValueError when a record is no CAN frame, its channel is not there or a sender is none of `own_nodes`.
        """
        n, quick = len(records), self._quick
        if n > CAPACITY:
            raise ValueError(f"hub: {n} records at once; expected at most {CAPACITY}")
        words = self._views.of(records if records.flags.c_contiguous else np.ascontiguousarray(records))
        if self._traffic.careful:
            quick.take_own(words, n, senders)
            ended = self._careful.turn(n, self._clock(), takes_in=False)
            self._pass_on_selected(ended)
            self._careful.leave_unread(ended)
            return quick.records[:ended]
        ticks, self._ticks_owed = self._ticks_owed, 0
        quick.transmit(words, n, senders, self._clock(), ticks)
        self._sent_by.clear()
        self._pass_on(n, ticks)
        return quick.records[:n]

    def owe_ticks(self, count: int) -> None:
        """So many cycles of the plant's are over with the next `transmit`: where that can be, it carries the word along."""
        self._ticks_owed = count

    def tick(self) -> None:
        """Tell those who want to know that cycles of the plant's are over, if no `transmit` has: all that was said in them has
        been passed on."""
        if self._ticks_owed:
            notices = np.zeros(self._ticks_owed, RECORD)
            notices["flags"], notices["time_ns"] = TICK, self._clock()
            for node in self._members.greeted:
                if node.ticks:
                    self._send(node, notices.view(np.uint64), len(notices))
            self._ticks_owed = 0

    @property
    def heard(self) -> tuple[int, int] | None:
        """lock-step: how many Sync and HoldTime the last `poll` took in, whatever the bus then did to them; None: the quick
        path, on which they are among the frames that `poll` gave"""
        return self._careful.heard

    @property
    def careful(self) -> bool:
        """Frames may be under way that nobody sends any more: bit timing is on, or a fault is or was on the bus."""
        return self._careful.needed

    def deaf(self) -> npt.NDArray[np.bool_] | None:
        """(own nodes,) which of the hub's own nodes hear nothing: bus-off, or their cable is cut. None: all hear."""
        if not self._traffic.impaired:
            return None
        numbers = np.arange(MOST_NODES, len(self._names))
        return ~self._traffic.hears(numbers, self._own_channels)

    def _pass_on(self, n: int, ticks: int = 0) -> None:
        """Send n frames of the quick path to everybody else, and behind them, to those who want it, the word that so many cycles
        are over."""
        quick, sent_by = self._quick, self._sent_by
        if n + ticks == 0:
            return
        for node in self._members.greeted:
            told = ticks if node.ticks else 0
            if node not in sent_by or node.own_frames:
                if node.hears_all:
                    self._send(node, quick.carried, n + told)
                    continue
            elif len(sent_by) == 1:
                continue
            count = quick.select(n, node.outbound, None if node.own_frames else node.number)
            if told:
                quick.append(count, n, told)
            self._send(node, quick.selected, count + told)

    def _pass_on_selected(self, n: int) -> None:
        """Send n frames of the careful path to everybody else who hears."""
        if n == 0:
            return
        every = np.arange(len(self.channels))
        for node in self._members.greeted:
            wanted = node.outbound
            if self._traffic.impaired:
                wanted = wanted.copy()
                wanted[: len(every)][~self._traffic.hears(np.full(len(every), node.number), every)] = -1
            count = self._quick.select(n, wanted, None if node.own_frames else node.number)
            self._send(node, self._quick.selected, count)

    def _send(self, node: Node, words: npt.NDArray[np.uint64], count: int) -> None:
        for start in range(0, count, wire.MAX_RECORDS):
            n = min(count - start, wire.MAX_RECORDS)
            if not node.send(words, start, n):
                waits = node.waiting
                self.dropped += node.keep(words[WORDS * start : WORDS * (start + n)].tobytes(), self._clock)
                if node.waiting and not waits:
                    self._epoll.modify(node.connection, _IN | _OUT)

    # --------------------------------------------------------------------------------------------------------- processes

    def fileno(self) -> int:
        """A file descriptor that is readable when `poll` has something to do."""
        return self._epoll.fileno()

    @property
    def listeners(self) -> int:
        """Processes that have joined."""
        return len(self._members.greeted)

    def close(self) -> None:
        """Leave: every process on the bus notices."""
        for node in list(self._members.nodes.values()):
            self._part(node)
        self._alarm.close()
        self._epoll.close()
        self._members.close()

    def _gather(self, wait: float | None) -> int:
        """Wait for processes, and take in what they have sent; returns how many records the inbox holds."""
        n, nodes = 0, self._members.nodes
        self._sent_by.clear()
        for descriptor, event in self._wait(wait):
            if (node := nodes.get(descriptor)) is not None:
                if event & _OUT and not node.flush(self._clock):
                    self._epoll.modify(node.connection, _IN)
                if event & ~_OUT:
                    n = self._take(node, n)
            elif descriptor == self._alarm.fileno():
                self._alarm.set(None)
            elif descriptor == self._members.fileno():
                self._members.admit_next(lambda number: not self._traffic.is_sending(number))
        return n

    def _wait(self, wait: float | None) -> list[tuple[int, int]]:
        if wait == 0.0 or not self._lockstep:
            return self._epoll.poll(wait)
        if not (events := self._awake.look(self._epoll.poll)) and (events := self._epoll.poll(wait)):
            self._awake.woken()
        return events

    def _take(self, node: Node, n: int) -> int:
        """Read a node's datagrams behind the n records that are there; returns how many there are then."""
        start, leaves = n, False
        descriptor, inbox, quick = node.connection.fileno(), self._quick.inbox_bytes, self._quick
        turns = 1 if node.spared else _TURN
        node.spared = max(0, node.spared - 1)
        for turn in range(turns):
            if n + wire.MAX_RECORDS > CAPACITY:
                break
            size = datagrams.take(descriptor, quick.inbox, n)
            if size == -errno.EAGAIN:
                if turn and self._lockstep:  # who sends a datagram a cycle has no second one
                    node.spared = _SPARED
                break
            size = max(size, 0)
            if size and not (node.greeted and not node.control):
                datagram = bytes(inbox[BYTES * n : BYTES * n + size])
                if node.greeted:
                    # Who asks without reading the answers gets none.
                    with contextlib.suppress(OSError):
                        node.connection.send(answer(self, datagram))
                    continue
                if self._greet(node, datagram):
                    continue
                size = 0
            if size == 0 or size > wire.MAX_BYTES or size % BYTES:
                # It left, or speaks something else: nothing that it says from here on can be trusted.
                leaves = True
                break
            n += size // BYTES
        if n > start:
            quick.inbox_senders[start:n] = node.number
            self._sent_by.append(node)
        if leaves:
            self._part(node)
        return n

    def _greet(self, node: Node, datagram: bytes) -> bool:
        if not self._members.greet(node, datagram):
            return False
        if not node.control:
            self._names[node.number] = node.name
            self._quick.inbound[node.number] = node.inbound
            self._traffic.join(node.number, np.flatnonzero(node.outbound >= 0).tolist())
            self._traffic.changed(self._clock())
        return True

    def _part(self, node: Node) -> None:
        self._members.part(node)
        if node.greeted and not node.control:
            self._traffic.leave(node.number)

    # ------------------------------------------------------------------------------------------------- about the bus itself

    def report(self) -> BusReport:
        """Everything about the bus at this moment."""
        return self._reporter.report(self._clock(), self._traffic, self._places(), self._unread())

    def node_states(self, name: str) -> list[NodeState]:
        """How the node of this name fares, on each of its channels; none where nobody is called so."""
        places = [place for place in self._places() if self._names[place[0]] == name]
        return self._reporter.node_states(self._traffic, places, self._unread())

    def statistics(self) -> list[ChannelStatistics]:
        """What every channel has carried. Call it several times a second for a load that is up to date."""
        return self._reporter.statistics(self._clock())

    def add_fault(self, fault: Fault) -> int:
        """Lay a fault on the bus; returns its number. Raises ValueError when it can't ever act here."""
        now = self._clock()
        number = self._traffic.disturbance.add(fault, now)
        self._traffic.changed(now)
        return number

    def check_fault(self, fault: Fault) -> None:
        """Raises ValueError when `add_fault` would."""
        self._traffic.disturbance.check(fault)

    def clear_fault(self, number: int | None = None) -> int:
        """Take back one fault, or all (None); returns how many. Raises ValueError when there is no such fault."""
        return self._traffic.clear(number, self._clock())

    def _unread(self) -> dict[int, int]:
        return {node.number: node.unread for node in self._members.greeted}

    def _places(self) -> list[tuple[int, int]]:
        """(number, channel's index) of every node on every channel of its."""
        return [
            *enumerate(self._own_channels.tolist(), MOST_NODES),
            *(
                (node.number, bus)
                for node in self._members.greeted
                for bus in range(len(self.channels))
                if node.outbound[bus] >= 0
            ),
        ]
