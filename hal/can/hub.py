"""The virtual CAN bus: a hub that arbitrates frames by identifier and sends every frame to everybody else.

Processes join over a Unix seqpacket socket (hal.can.wire); the simulated drives sit in the hub's own process and use `poll`
and `transmit`. No listener can hold up the bus: what a slow one has not taken waits in a bounded queue, then is dropped,
counted, and told to it (hal.can.frames.LOST). Timestamps are when a frame would have ended on a real bus of that bit rate,
counted on the hub's clock; frames are passed on at once.

With bit timing on, frames wait in their sender's FIFO, go out as the arbitration lets them, and are passed on when they end. So
do they while a fault is on the bus, though then only a babbling node makes them take their time (hal.can.traffic).

    python -m hal.can.hub --runtime DIR --channels can0,can1      a bus without a robot, for tests and tools
"""

from __future__ import annotations

import argparse
import contextlib
import os
import select
import signal
import socket
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
import numpy.typing as npt

from hal.can import control, faults, tally, transit, wire
from hal.can.alarm import Alarm
from hal.can.arbitration import admit, arbitrate, by_priority
from hal.can.arbitration import select as select_records
from hal.can.control import BusReport, ChannelState, IdentifierLoad, NodeState
from hal.can.faults import Fault
from hal.can.frames import BYTES, EXTENDED, MAX_CHANNELS, RECORD, TICK, WORDS
from hal.can.node import Node
from hal.can.timing import BusTiming, LoadMeter
from hal.can.traffic import TURN_ROOM, Traffic
from hal.realtime import RealTime
from handrail.config import ConfigError
from handrail.runtime import Runtime

_PRIORITY = 60  # below plant and daemon
_CAPACITY = 8192
"""Records that one poll takes in."""
_TURN = 16
"""Datagrams that one poll takes from one node, so that a flood from one can't starve the others."""
_QUEUE = 65536
"""Records that wait for one slow listener, about 5 MB."""
_FIFO = 128
"""Frames that a node's transmit FIFO on one channel holds: at 1/5 Mbit/s some 20 ms of a full bus."""
_MOST_NODES = 64
"""Processes on the bus; node 0 is the hub itself. Its own drives are numbered behind."""


@dataclass(frozen=True)
class ChannelStatistics:
    """What one channel has carried."""

    name: str
    frames: int
    busy_ns: int
    load: float
    """share of the time in use over about the last second of the hub's clock; above 1: more than the bus can carry"""


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
        self._clock, self._queue = clock, queue
        count = len(names)
        self._bitrates = np.array([(c.bitrate, c.data_bitrate) for c in self.channels], np.int64)
        self._totals, self._identifiers = tally.totals(count), tally.identifiers(count)
        self._meters = [LoadMeter() for _ in names]
        self.refused = 0
        """records that were no CAN frames, or for a channel that is not there"""
        self.dropped = 0
        """records dropped for slow listeners"""
        self._inbox = np.zeros(WORDS * (_CAPACITY + wire.MAX_RECORDS + 1), np.uint64)
        self._ordered = np.zeros(WORDS * TURN_ROOM, np.uint64)
        self._selected = np.zeros(WORDS * (TURN_ROOM + _CAPACITY), np.uint64)
        self._ticks_owed = 0
        self._inbox_bytes = self._inbox.data.cast("B")
        self._selected_bytes = self._selected.data.cast("B")
        self._records = self._ordered.view(RECORD)
        self._node, self._ordered_node = np.zeros(_CAPACITY, np.int64), np.zeros(TURN_ROOM, np.int64)
        self._as_they_came, self._order = np.arange(_CAPACITY), np.zeros(_CAPACITY, np.int64)
        self._heads, self._following = np.full((count, _MOST_NODES, 2), -1, np.int64), np.zeros(_CAPACITY, np.int64)
        self._own_channels: tuple[int, ...] = ()
        self._timing, self._fifo = timing, fifo
        self._names = ["hub", *(f"node{number}" for number in range(1, _MOST_NODES))]
        self._traffic = self._new_traffic()
        self._unread: list[npt.NDArray[np.void]] = []
        self._cycle: tuple[int, int, int] | None = None  # lock-step: period in ns, identifiers of Sync and HoldTime
        self.heard: tuple[int, int] | None = None
        """lock-step: how many Sync and HoldTime the last `poll` took in, whatever the bus then did to them; None: the quick
        path, on which they are among the frames that `poll` gave"""
        self._inbox_records = self._inbox.view(RECORD)
        self._own = np.where(np.arange(MAX_CHANNELS) < count, np.arange(MAX_CHANNELS), -1)
        self._warm()
        self._nodes: dict[int, Node] = {}
        self._path = Path(path)
        self._listener = _listen(self._path)
        self._epoll = select.epoll()
        self._epoll.register(self._listener, select.EPOLLIN)
        self._alarm = Alarm()
        self._epoll.register(self._alarm, select.EPOLLIN)

    def _new_traffic(self) -> Traffic:
        return Traffic(
            self.channels, self._totals, self._identifiers, self._names, timing=self._timing, fifo=self._fifo
        )

    def _warm(self) -> None:
        # Compile every kernel before anybody joins: a slow first cycle would fill the sockets.
        self._inbox[:WORDS] = 0
        admit(self._inbox, 0, 1, self._own)
        by_priority(self._inbox, 1, self._order)
        self._arbitrate(self._as_they_came, 1, 0)
        select_records(self._ordered, self._ordered_node, 1, 0, self._own, self._selected)
        self._totals[:] = 0
        self._identifiers[:] = 0

    def _arbitrate(self, order: npt.NDArray[np.int64], n: int, now: int) -> None:
        arbitrate(
            self._inbox, order, self._node, n, now, self._bitrates, self._totals, self._identifiers,
            self._ordered, self._ordered_node, self._heads, self._following,
        )  # fmt: skip

    def fileno(self) -> int:
        """A file descriptor that is readable when `poll` has something to do."""
        return self._epoll.fileno()

    @property
    def listeners(self) -> int:
        """Processes that have joined."""
        return sum(node.greeted and not node.control for node in self._nodes.values())

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
        self._own_channels = tuple(known.index(channel) for channel in channels)
        self._names[_MOST_NODES:] = names
        self._heads = np.full((len(known), len(self._names), 2), -1, np.int64)
        self._traffic = self._new_traffic()
        for number, bus in enumerate(self._own_channels, _MOST_NODES):
            self._traffic.join(number, [bus])

    def lockstep(self, period_ns: int, sync: int, hold: int) -> None:
        """Say that the clock stands until whoever runs the hub has heard Sync (identifier, first channel) from the host.

        On a bus that keeps bit timing a cycle's frames then have a period's time, as they would: what has not ended by then
        comes in the next cycle. HoldTime, which says that time stands, takes no time on the bus.
        """
        self._cycle = (period_ns, sync, hold)

    def deaf(self) -> npt.NDArray[np.bool_] | None:
        """(own nodes,) which of the hub's own nodes hear nothing: bus-off, or their cable is cut. None: all hear."""
        if not self._traffic.impaired:
            return None
        numbers = np.arange(_MOST_NODES, len(self._names))
        return ~self._traffic.hears(numbers, np.array(self._own_channels, np.int64))

    @property
    def careful(self) -> bool:
        """Frames may be under way that nobody sends any more: bit timing is on, or a fault is or was on the bus."""
        return self._traffic.careful or bool(self._unread)

    def poll(self, timeout_s: float | None = 0.0) -> npt.NDArray[np.void]:
        """Frames from the other processes since the last call, in the order in which the buses carry them.

        Waits at most `timeout_s` for the first (None: for ever, 0: not at all). A datagram is never split between two
        calls. The frames have been passed on to everybody else; the view holds until the next `poll` or `transmit`.
        """
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        wait = timeout_s
        self.heard = None
        while True:
            if self._traffic.careful or self._unread:
                wait = self._careful_wait(deadline)
            n = 0
            for descriptor, event in self._epoll.poll(wait):
                if descriptor == self._listener.fileno():
                    self._accept()
                elif descriptor == self._alarm.fileno():
                    self._alarm.set(None)
                elif (node := self._nodes.get(descriptor)) is not None:
                    if event & select.EPOLLOUT and not node.flush(self._clock):
                        self._epoll.modify(node.connection, select.EPOLLIN)
                    if event & ~select.EPOLLOUT:
                        n = self._take(node, n)
            if self._traffic.careful or self._unread:
                received = self._turn(n)
                if n or len(received):
                    return received
            elif n:
                self._arbitrate(self._as_they_came, n, self._clock())
                self._pass_on(n)
                return self._records[:n]
            if deadline is not None:
                wait = deadline - time.monotonic()
                if wait <= 0.0:
                    return self._records[:0]

    def transmit(
        self, records: npt.NDArray[np.void], senders: npt.NDArray[np.int64] | None = None
    ) -> npt.NDArray[np.void]:
        """Send frames of the hub's own nodes to everybody else.

        senders (n,): who sends each frame, as a place in `own_nodes`' names; None: each is sent by a nameless node of its
        own. Returns the frames as the buses carried them; the view holds until the next `poll` or `transmit`. Raises
        ValueError when a record is no CAN frame, its channel is not there or a sender is none of `own_nodes`.
        """
        n = len(records)
        if n > _CAPACITY:
            raise ValueError(f"hub: {n} records at once; expected at most {_CAPACITY}")
        self._inbox[: WORDS * n] = np.ascontiguousarray(records).view(np.uint64)
        good = admit(self._inbox, 0, n, self._own)
        if good != n:
            raise ValueError(f"hub: {n - good} of {n} records are no CAN frames or name a channel that is not there")
        if senders is not None:
            if len(senders) != n or (n and not 0 <= senders.min() <= senders.max() < len(self._own_channels)):
                raise ValueError(f"hub: senders {senders}; expected {n} places in {len(self._own_channels)} own nodes")
            np.add(senders, _MOST_NODES, out=self._node[:n])
        if self._traffic.careful:
            if senders is None:
                self._node[:n] = 0
            received = self._turn(n, takes_in=False)
            if len(received):
                self._unread.append(received.copy())
            return self._records[: self._carried]
        if senders is None:
            by_priority(self._inbox, n, self._order)
            self._node[:n] = 0
            self._arbitrate(self._order, n, self._clock())
        else:
            self._arbitrate(self._as_they_came, n, self._clock())
        self._pass_on(n, ticks=True)
        return self._records[:n]

    def report(self) -> BusReport:
        """Everything about the bus at this moment."""
        carried = self.statistics()
        channels = [
            ChannelState(
                name=channel.name,
                bitrate=channel.bitrate,
                data_bitrate=channel.data_bitrate,
                frames=of.frames,
                busy_ns=of.busy_ns,
                error_frames=int(self._totals[bus, tally.ERRORS]),
                load=of.load,
                identifiers=[
                    IdentifierLoad(can_id=can_id, extended=extended, frames=frames, busy_ns=busy)
                    for can_id, extended, frames, busy in tally.seen(self._identifiers, bus)
                ],
            )
            for bus, (channel, of) in enumerate(zip(self.channels, carried, strict=True))
        ]
        places = [
            *enumerate(self._own_channels, _MOST_NODES),
            *(
                (node.number, bus)
                for node in self._nodes.values()
                if node.greeted and not node.control
                for bus in range(len(channels))
                if node.outbound[bus] >= 0
            ),
        ]
        return BusReport(
            time_ns=self._clock(),
            timing=self._timing,
            channels=channels,
            nodes=[self._node_state(number, bus) for number, bus in places],
            faults=self._traffic.disturbance.faults,
            hits=self._traffic.disturbance.hits,
        )

    def _node_state(self, number: int, bus: int) -> NodeState:
        state, transmit_errors, receive_errors, waiting, overflows = self._traffic.of_node(number, bus)
        return NodeState(
            name=self._names[number],
            channel=self.channels[bus].name,
            state=state,
            transmit_errors=transmit_errors,
            receive_errors=receive_errors,
            waiting=waiting,
            overflows=overflows,
        )

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

    def statistics(self) -> list[ChannelStatistics]:
        """What every channel has carried. Call it several times a second for a load that is up to date."""
        now = self._clock()
        return [
            ChannelStatistics(channel.name, int(frames), int(busy), meter.update(now, int(busy)))
            for channel, frames, busy, meter in zip(
                self.channels,
                self._totals[:, tally.FRAMES],
                self._totals[:, tally.BUSY],
                self._meters,
                strict=True,
            )
        ]

    def close(self) -> None:
        """Leave: every process on the bus notices."""
        for node in list(self._nodes.values()):
            self._part(node)
        self._alarm.close()
        self._epoll.close()
        self._listener.close()
        with contextlib.suppress(FileNotFoundError):
            self._path.unlink()

    def owe_ticks(self, count: int) -> None:
        """So many cycles of the plant's are over with the next `transmit`: where that can be, it carries the word along."""
        self._ticks_owed = count

    def tick(self) -> None:
        """Tell those who want to know that cycles of the plant's are over, if no `transmit` has: all that was said in them has
        been passed on."""
        if self._ticks_owed:
            datagram = self._notices().tobytes()
            for node in self._nodes.values():
                if node.ticks:
                    self._send(node, memoryview(datagram))
            self._ticks_owed = 0

    def _notices(self) -> npt.NDArray[np.uint64]:
        notices = np.zeros(self._ticks_owed, RECORD)
        notices["flags"], notices["time_ns"] = TICK, self._clock()
        return notices.view(np.uint64)

    def _accept(self) -> None:
        with contextlib.suppress(BlockingIOError):
            connection, _ = self._listener.accept()
            wire.prepare(connection)
            taken = {node.number for node in self._nodes.values()}
            free = (i for i in range(1, _MOST_NODES) if i not in taken and not self._traffic.is_sending(i))
            number = next(free, None)
            if number is None:
                with contextlib.suppress(OSError):
                    connection.send(
                        wire.encode(wire.Sorry(reason=f"{_MOST_NODES - 1} processes are on the bus already"))
                    )
                connection.close()
                return
            self._nodes[connection.fileno()] = Node(connection, number, self._queue)
            self._epoll.register(connection, select.EPOLLIN)

    def _part(self, node: Node) -> None:
        self._nodes.pop(node.connection.fileno(), None)
        with contextlib.suppress(OSError):
            self._epoll.unregister(node.connection)
        node.connection.close()
        if node.greeted and not node.control:
            self._traffic.leave(node.number)

    def _take(self, node: Node, n: int) -> int:
        """Read a node's datagrams behind the n records that are there; returns how many there are then."""
        start, leaves, receive = n, False, node.connection.recv_into
        for _ in range(_TURN):
            if n + wire.MAX_RECORDS > _CAPACITY:
                break
            try:
                size = receive(self._inbox_bytes[BYTES * n :], wire.MAX_BYTES + 1)
            except BlockingIOError:
                break
            except OSError:
                size = 0
            if size and not (node.greeted and not node.control):
                datagram = bytes(self._inbox_bytes[BYTES * n : BYTES * n + size])
                if node.greeted:
                    self._serve(node, datagram)
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
            good = admit(self._inbox, start, n - start, node.inbound)
            self.refused += n - start - good
            n = start + good
            self._node[start:n] = node.number
        if leaves:
            self._part(node)
        return n

    def _greet(self, node: Node, datagram: bytes) -> bool:
        names = [channel.name for channel in self.channels]
        try:
            hello = wire.decode_hello(datagram)
            wanted = names if hello.channels is None else hello.channels
            unknown = [name for name in wanted if name not in names]
            if hello.version != wire.VERSION:
                raise ValueError(
                    f"wire version {hello.version}; this hub speaks {wire.VERSION}: start the hub and what joins it from the same "
                    f"Handrail, or bring your firmware up to date (docs/can.md)"
                )
            if unknown or len(set(wanted)) != len(wanted):
                raise ValueError(f"channels {wanted}; expected different names out of {names}")
        except (msgspec.DecodeError, ValueError) as error:
            with contextlib.suppress(OSError):
                node.connection.send(wire.encode(wire.Sorry(reason=str(error))))
            return False
        for local, name in enumerate(wanted):
            node.inbound[local] = names.index(name)
            node.outbound[names.index(name)] = local
        chosen = [self.channels[names.index(name)] for name in wanted]
        answer = [wire.ChannelInfo(c.name, c.bitrate, c.data_bitrate) for c in chosen]
        try:
            node.connection.send(wire.encode(wire.Welcome(channels=answer)))
        except OSError:
            return False
        node.greeted, node.own_frames = True, hello.own_frames
        node.control, node.ticks = hello.role == "control", hello.ticks
        if not node.control:
            self._names[node.number] = hello.name or f"node{node.number}"
            self._traffic.join(node.number, [names.index(name) for name in wanted])
            self._traffic.changed(self._clock())
        return True

    def _serve(self, node: Node, datagram: bytes) -> None:
        """Answer a request about the bus."""
        answer: control.Answer
        try:
            match control.decode_request(datagram):
                case control.GetBus():
                    answer = self.report()
                case control.AddFault(fault=fault):
                    answer = control.FaultAdded(number=self.add_fault(fault))
                case control.ClearFault(number=number):
                    answer = control.FaultsCleared(count=self.clear_fault(number))
        except (msgspec.DecodeError, ValueError) as error:
            answer = wire.Sorry(reason=str(error))
        # Who asks without reading the answers gets none.
        with contextlib.suppress(OSError):
            node.connection.send(wire.encode(answer))

    def _turn(self, n: int, *, takes_in: bool = True) -> npt.NDArray[np.void]:
        """The careful path for n records in the inbox, passed on when they end; returns those that other processes sent."""
        now = self._clock()
        records, node = self._inbox_records[:n], self._node[:n]
        ahead = 0
        if self._cycle is not None:
            ahead, sync, hold = self._cycle
            if takes_in:
                first = np.where((records["bus"] == 0) & (records["flags"] & EXTENDED == 0), records["can_id"], -1)
                self.heard = int(np.count_nonzero(first == sync)), int(np.count_nonzero(first == hold))
                if self.heard[1]:
                    records, node = records[first != hold], node[first != hold]
        count = self._traffic.turn(records, node, now, ahead, self._ordered, self._ordered_node)
        self._carried = count
        if count:
            self._pass_on(count)
        from_others = self._records[:count][self._ordered_node[:count] < _MOST_NODES]
        if takes_in and self._unread:
            from_others = np.concatenate([*self._unread, from_others])
            self._unread.clear()
        return from_others

    def _careful_wait(self, deadline: float | None) -> float | None:
        """How long epoll may wait; the alarm ends that when a frame ends on the bus, or at the deadline."""
        if self._unread:
            return 0.0
        left = None if deadline is None else deadline - time.monotonic()
        if self._cycle is not None or (left is not None and left <= 0.0):
            return left if left is None else max(0.0, left)  # in lock-step the clock moves only between two calls
        when = self._traffic.next_event()
        until_event = None if when == transit.NEVER else when - self._clock()
        until_deadline = None if left is None else int(left * 1e9)
        self._alarm.set(min((d for d in (until_event, until_deadline) if d is not None), default=None))
        return None

    def _pass_on(self, n: int, *, ticks: bool = False) -> None:
        """Send n carried frames to everybody else; `ticks`: and behind them, the word that the cycles owed are over."""
        notices = self._notices() if ticks and self._ticks_owed else None
        if notices is not None:
            self._ticks_owed = 0
        for node in list(self._nodes.values()):
            if not node.greeted or node.control:
                continue
            skip = -1 if node.own_frames else node.number
            wanted = node.outbound
            if self._traffic.impaired:
                wanted = wanted.copy()
                every = np.arange(len(self.channels))
                wanted[: len(every)][~self._traffic.hears(np.full(len(every), node.number), every)] = -1
            count = select_records(self._ordered, self._ordered_node, n, skip, wanted, self._selected)
            if notices is not None and node.ticks:
                self._selected[WORDS * count : WORDS * count + len(notices)] = notices
                count += len(notices) // WORDS
            for start in range(0, count, wire.MAX_RECORDS):
                stop = min(count, start + wire.MAX_RECORDS)
                self._send(node, self._selected_bytes[BYTES * start : BYTES * stop])

    def _send(self, node: Node, datagram: memoryview) -> None:
        waits = node.waiting
        self.dropped += node.send(datagram, self._clock)
        if node.waiting and not waits:
            self._epoll.modify(node.connection, select.EPOLLIN | select.EPOLLOUT)


def _listen(path: Path) -> socket.socket:
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    try:
        if path.is_socket():
            with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as probe:
                if probe.connect_ex(os.fspath(path)) == 0:
                    raise OSError(f"CAN hub: another hub listens at {path}; stop it, or use another runtime folder")
            path.unlink()  # left over from a hub that was killed
        listener.bind(os.fspath(path))
        listener.listen(_MOST_NODES)
        listener.setblocking(False)
    except OSError:
        listener.close()
        raise
    return listener


def main(arguments: Sequence[str] | None = None) -> None:
    """Run a hub by itself until SIGTERM or SIGINT."""
    parser = argparse.ArgumentParser(prog="python -m hal.can.hub", description="A virtual CAN bus without a robot.")
    parser.add_argument("--runtime", help="the robot's runtime folder (default: $HANDRAIL_RUNTIME, else this user's)")
    parser.add_argument("--channels", default="can0", help="channel names, separated by commas (default: can0)")
    parser.add_argument("--bitrate", type=int, default=1_000_000, help="bit/s (default: 1000000)")
    parser.add_argument(
        "--data-bitrate", type=int, default=5_000_000, help="bit/s of CAN FD's data phase (default: 5000000)"
    )
    parser.add_argument("--timing", action="store_true", help="frames take the time that they would on a real bus")
    parser.add_argument("--faults", help="YAML file of faults that lie on the bus from the start")
    options = parser.parse_args(arguments)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: sys.exit(0))
    try:
        channels = [BusTiming(name, options.bitrate, options.data_bitrate) for name in options.channels.split(",")]
        script = faults.read(options.faults) if options.faults else []
        hub = Hub(Runtime.at(options.runtime).bus, channels, timing=options.timing)
        for fault in script:
            hub.add_fault(fault)
    except (ConfigError, OSError, ValueError) as error:
        sys.exit(str(error))
    if options.timing:  # a bus that sleeps through a frame's end has lost the time until it wakes
        for warning in RealTime(priority=_PRIORITY).warnings:
            print(f"hub: {warning}", file=sys.stderr)
    print("hub ready", flush=True)
    with contextlib.closing(hub):
        while True:
            hub.poll(None)


if __name__ == "__main__":
    main()
