"""The virtual CAN bus: a hub that arbitrates frames by identifier and sends every frame to everybody else.

Processes join over a Unix seqpacket socket (hal.can.wire); the simulated drives sit in the hub's own process and use `poll`
and `transmit`. No listener can hold up the bus: what a slow one has not taken waits in a bounded queue, then is dropped,
counted, and told to it (hal.can.frames.LOST). Timestamps are when a frame would have ended on a real bus of that bit rate,
counted on the hub's clock; frames are passed on at once.

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

from hal.can import control, tally, wire
from hal.can.arbitration import admit, arbitrate, by_priority
from hal.can.arbitration import select as select_records
from hal.can.control import BusReport, ChannelState, IdentifierLoad, NodeState
from hal.can.faults import Fault
from hal.can.frames import BYTES, MAX_CHANNELS, RECORD, TICK, WORDS
from hal.can.node import Node
from hal.can.timing import BusTiming, LoadMeter
from handrail.runtime import Runtime

_CAPACITY = 8192
"""Records that one poll takes in."""
_TURN = 16
"""Datagrams that one poll takes from one node, so that a flood from one can't starve the others."""
_QUEUE = 65536
"""Records that wait for one slow listener, about 5 MB."""
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
    ):
        """Listens at `path`. `channels`: names, or anything with name, bitrate and data_bitrate (bit/s).

        clock: ns for the frames' timestamps; the plant gives its own. queue: records that may wait for a slow listener.
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
        self._ordered = np.zeros(WORDS * _CAPACITY, np.uint64)
        self._selected = np.zeros(WORDS * _CAPACITY, np.uint64)
        self._inbox_bytes = self._inbox.data.cast("B")
        self._selected_bytes = self._selected.data.cast("B")
        self._records = self._ordered.view(RECORD)
        self._node, self._ordered_node = np.zeros(_CAPACITY, np.int64), np.zeros(_CAPACITY, np.int64)
        self._as_they_came, self._order = np.arange(_CAPACITY), np.zeros(_CAPACITY, np.int64)
        self._heads, self._following = np.full((count, _MOST_NODES, 2), -1, np.int64), np.zeros(_CAPACITY, np.int64)
        self._own_names: tuple[str, ...] = ()
        self._own_channels: tuple[int, ...] = ()
        self._faults: dict[int, Fault] = {}
        self._next_fault = 1
        self._own = np.where(np.arange(MAX_CHANNELS) < count, np.arange(MAX_CHANNELS), -1)
        self._warm()
        self._nodes: dict[int, Node] = {}
        self._path = Path(path)
        self._listener = _listen(self._path)
        self._epoll = select.epoll()
        self._epoll.register(self._listener, select.EPOLLIN)

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
        self._own_names, self._own_channels = tuple(names), tuple(known.index(channel) for channel in channels)
        self._heads = np.full((len(known), _MOST_NODES + len(names), 2), -1, np.int64)

    def poll(self, timeout_s: float | None = 0.0) -> npt.NDArray[np.void]:
        """Frames from the other processes since the last call, in the order in which the buses carry them.

        Waits at most `timeout_s` for the first (None: for ever, 0: not at all). A datagram is never split between two
        calls. The frames have been passed on to everybody else; the view holds until the next `poll` or `transmit`.
        """
        deadline = None if timeout_s is None else time.monotonic() + timeout_s
        wait = timeout_s
        while True:
            n = 0
            for descriptor, event in self._epoll.poll(wait):
                if descriptor == self._listener.fileno():
                    self._accept()
                elif (node := self._nodes.get(descriptor)) is not None:
                    if event & select.EPOLLOUT and not node.flush(self._clock):
                        self._epoll.modify(node.connection, select.EPOLLIN)
                    if event & ~select.EPOLLOUT:
                        n = self._take(node, n)
            if n:
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
        if senders is None:
            by_priority(self._inbox, n, self._order)
            self._node[:n] = 0
            self._arbitrate(self._order, n, self._clock())
        else:
            if len(senders) != n or (n and not 0 <= senders.min() <= senders.max() < len(self._own_names)):
                raise ValueError(f"hub: senders {senders}; expected {n} places in {len(self._own_names)} own nodes")
            np.add(senders, _MOST_NODES, out=self._node[:n])
            self._arbitrate(self._as_they_came, n, self._clock())
        self._pass_on(n)
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
            (node.name, bus)
            for node in self._nodes.values()
            if node.greeted and not node.control
            for bus in range(len(channels))
            if node.outbound[bus] >= 0
        ]
        return BusReport(
            time_ns=self._clock(),
            timing=False,
            channels=channels,
            nodes=[
                NodeState(
                    name=name,
                    channel=self.channels[bus].name,
                    state="error_active",
                    transmit_errors=0,
                    receive_errors=0,
                    waiting=0,
                    overflows=0,
                )
                for name, bus in [*zip(self._own_names, self._own_channels, strict=True), *places]
            ],
            faults=dict(self._faults),
            hits=dict.fromkeys(self._faults, 0),
        )

    def add_fault(self, fault: Fault) -> int:
        """Lay a fault on the bus; returns its number. Raises ValueError when it can't ever act here."""
        names = [channel.name for channel in self.channels]
        if fault.channel is not None and fault.channel not in names:
            raise ValueError(f"fault: channel {fault.channel!r}; expected one of {names}")
        if fault.node is None and fault.kind in ("babble", "bus_off"):
            raise ValueError(f"fault {fault.kind}: node is missing; expected a node's name")
        number, self._next_fault = self._next_fault, self._next_fault + 1
        self._faults[number] = fault
        return number

    def clear_fault(self, number: int | None = None) -> int:
        """Take back one fault, or all (None); returns how many. Raises ValueError when there is no such fault."""
        if number is None:
            count = len(self._faults)
            self._faults.clear()
            return count
        if self._faults.pop(number, None) is None:
            raise ValueError(f"fault {number}: there is none of that number; expected one of {sorted(self._faults)}")
        return 1

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
        self._epoll.close()
        self._listener.close()
        with contextlib.suppress(FileNotFoundError):
            self._path.unlink()

    def tick(self) -> None:
        """Tell those who want to know that a cycle of the plant's is over: all that was said in it has been passed on."""
        notice = np.zeros(1, RECORD)
        notice["flags"], notice["time_ns"] = TICK, self._clock()
        for node in self._nodes.values():
            if node.ticks:
                waits = node.waiting
                node.send(notice.view(np.uint8).data, self._clock)
                if node.waiting and not waits:
                    self._epoll.modify(node.connection, select.EPOLLIN | select.EPOLLOUT)

    def _accept(self) -> None:
        with contextlib.suppress(BlockingIOError):
            connection, _ = self._listener.accept()
            wire.prepare(connection)
            taken = {node.number for node in self._nodes.values()}
            number = next((i for i in range(1, _MOST_NODES) if i not in taken), None)
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

    def _take(self, node: Node, n: int) -> int:
        """Read a node's datagrams behind the n records that are there; returns how many there are then."""
        for _ in range(_TURN):
            if n + wire.MAX_RECORDS > _CAPACITY:
                return n
            try:
                size = node.connection.recv_into(self._inbox_bytes[BYTES * n :], wire.MAX_BYTES + 1)
            except BlockingIOError:
                return n
            except OSError:
                size = 0
            if size and not node.greeted:
                if self._greet(node, bytes(self._inbox_bytes[BYTES * n : BYTES * n + size])):
                    continue
                size = 0
            if size and node.control:
                self._serve(node, bytes(self._inbox_bytes[BYTES * n : BYTES * n + size]))
                continue
            if size == 0 or size > wire.MAX_BYTES or size % BYTES:
                # It left, or speaks something else: nothing that it says can be trusted.
                self._part(node)
                return n
            count = size // BYTES
            good = admit(self._inbox, n, count, node.inbound)
            self.refused += count - good
            self._node[n : n + good] = node.number
            n += good
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
        node.name, node.control = hello.name or node.name, hello.role == "control"
        node.ticks = hello.ticks
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

    def _pass_on(self, n: int) -> None:
        for node in list(self._nodes.values()):
            if not node.greeted or node.control:
                continue
            skip = -1 if node.own_frames else node.number
            count = select_records(self._ordered, self._ordered_node, n, skip, node.outbound, self._selected)
            for start in range(0, count, wire.MAX_RECORDS):
                stop = min(count, start + wire.MAX_RECORDS)
                waits = node.waiting
                self.dropped += node.send(self._selected_bytes[BYTES * start : BYTES * stop], self._clock)
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
    options = parser.parse_args(arguments)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: sys.exit(0))
    try:
        channels = [BusTiming(name, options.bitrate, options.data_bitrate) for name in options.channels.split(",")]
        hub = Hub(Runtime.at(options.runtime).bus, channels)
    except (OSError, ValueError) as error:
        sys.exit(str(error))
    print("hub ready", flush=True)
    with contextlib.closing(hub):
        while True:
            hub.poll(None)


if __name__ == "__main__":
    main()
