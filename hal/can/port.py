"""The control loop's way to its CAN channels: records in, records out, whether the bus is virtual or real.

A record's `bus` is the index of its channel in the robot's description. `HubPort` speaks to the virtual bus and allocates
nothing but array views; `CanPort` speaks to any python-can interface (SocketCAN, PCAN, Kvaser, ...).
"""

from __future__ import annotations

import os
import select
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from numba import njit

from hal.can import wire
from hal.can.arbitration import bus_of
from hal.can.frames import BYTES, LOST, MAX_CHANNELS, RECORD, WORDS
from hal.can.timing import BusTiming, frame_ns
from hal.can.wire import BusLost
from handrail.runtime import Runtime

_ROOM = 8 * wire.MAX_RECORDS
"""Records that one receive takes in."""

SENT, RECEIVED, BUSY_NS = 0, 1, 2
"""Columns of `Port.counters`."""


class Port(Protocol):
    """What the loop needs of its buses."""

    counters: npt.NDArray[np.int64]
    """(channels, 3): frames sent, frames received, ns in which the channel was in use, since the port was opened"""
    refused: int
    """frames that a full transmit queue did not take"""
    lost: int
    """frames that the bus says this process did not read in time"""

    def send(self, records: npt.NDArray[np.void]) -> None:
        """Queue frames, without waiting. What a full queue does not take is counted in `refused`. Raises BusLost."""

    def receive(self, timeout_s: float = 0.0) -> npt.NDArray[np.void]:
        """All frames that have arrived; waits at most `timeout_s` for the first. The view holds until the next call.
        Raises BusLost."""

    def fileno(self) -> int:
        """Readable when frames wait."""

    def close(self) -> None:
        """Leave the bus."""


@njit(cache=True)
def _count(words, n, bitrates, column, counters):
    for row in range(n):
        bus = bus_of(words, row)
        if bus < counters.shape[0]:
            counters[bus, column] += 1
            counters[bus, BUSY_NS] += frame_ns(words, row, bitrates[bus, 0], bitrates[bus, 1])


@njit(cache=True)
def _without_notices(words, n):
    """Take the hub's notices of loss out of n records: (records left, frames lost)."""
    lost, k = np.int64(0), 0
    for row in range(n):
        head = words[WORDS * row + 1]
        if (head >> np.uint64(40)) & np.uint64(LOST):
            lost += np.int64(head & np.uint64(0xFFFFFFFF))
            continue
        if k != row:
            for i in range(WORDS):
                words[WORDS * k + i] = words[WORDS * row + i]
        k += 1
    return k, lost


class HubPort:
    """A place on the virtual bus."""

    def __init__(
        self,
        path: str | os.PathLike[str],
        channels: Sequence[str] | None = None,
        *,
        own_frames: bool = False,
        timeout_s: float = 5.0,
        name: str | None = None,
    ):
        """Join the hub at `path` (Runtime.bus) for these channels, in this order; None: all, in the hub's order.

        own_frames: also receive what this port sent. name: what reports and faults call this node.
        Raises BusLost when no hub is there within `timeout_s`, ValueError when it has no such channel.
        """
        # Compile before joining: a slow start would let the socket fill.
        self._buffer = np.zeros(WORDS * _ROOM, np.uint64)
        bitrates = np.ones((MAX_CHANNELS, 2), np.int64)
        _count(self._buffer, 0, bitrates, SENT, np.zeros((1, 3), np.int64))
        _without_notices(self._buffer, 0)
        self._bytes = self._buffer.data.cast("B")
        self._records = self._buffer.view(RECORD)
        self._path = path
        self._socket, infos = wire.join(
            path, None if channels is None else list(channels), own_frames=own_frames, timeout_s=timeout_s, name=name
        )
        self.channels = infos
        """The channels joined, in this port's order."""
        self._bitrates = np.array([(c.bitrate, c.data_bitrate) for c in infos], np.int64).reshape(-1, 2)
        self.counters = np.zeros((len(infos), 3), np.int64)
        self.refused = 0
        self.lost = 0
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)

    def send(self, records: npt.NDArray[np.void]) -> None:
        """Queue frames without waiting, all of them in one datagram where they fit; see Port.send."""
        for start in range(0, len(records), wire.MAX_RECORDS):
            batch = records[start : start + wire.MAX_RECORDS]
            try:
                self._socket.send(batch.data)
            except BlockingIOError:
                self.refused += len(batch)
            except OSError as error:
                raise BusLost(f"CAN bus at {self._path}: {error}") from error
            else:
                _count(batch.view(np.uint64), len(batch), self._bitrates, SENT, self.counters)

    def receive(self, timeout_s: float = 0.0) -> npt.NDArray[np.void]:
        """All frames that have arrived, in the order in which the buses carried them; see Port.receive."""
        size = 0
        while True:
            try:
                got = self._socket.recv_into(self._bytes[size:])
            except BlockingIOError:
                if size or timeout_s <= 0.0 or not self._poll.poll(timeout_s * 1000):
                    break
                timeout_s = 0.0
                continue
            except OSError as error:
                raise BusLost(f"CAN bus at {self._path}: {error}") from error
            if got == 0:
                raise BusLost(f"CAN bus at {self._path}: the hub has ended")
            size += got
            if size > BYTES * (_ROOM - wire.MAX_RECORDS):
                break
        n, lost = _without_notices(self._buffer, size // BYTES)
        self.lost += lost
        _count(self._buffer, n, self._bitrates, RECEIVED, self.counters)
        return self._records[:n]

    def fileno(self) -> int:
        """Readable when frames wait."""
        return self._socket.fileno()

    def close(self) -> None:
        """Leave the bus."""
        self._socket.close()


class CanPort:
    """Places on real buses, one python-can bus a channel. Allocates a message a frame, as python-can does."""

    def __init__(self, channels: Sequence[Any]):
        """Open every channel: anything with name, interface (python-can's name), bitrate and data_bitrate (bit/s).

        Raises BusLost naming the channel that can't be opened.
        """
        import can

        from hal.can import convert

        self._can, self._convert = can, convert
        self.channels = [BusTiming(c.name, c.bitrate, c.data_bitrate) for c in channels]
        self._bitrates = np.array([(c.bitrate, c.data_bitrate) for c in channels], np.int64).reshape(-1, 2)
        self.counters = np.zeros((len(channels), 3), np.int64)
        self.refused = 0
        self.lost = 0
        self._records = np.zeros(_ROOM, RECORD)
        self._bytes = self._records.view(np.uint8).data
        self._names = [channel.name for channel in channels]
        self._buses: list[can.BusABC] = []
        self._poll = select.epoll()
        self._unwaitable: can.BusABC | None = None
        for channel in channels:
            try:
                bus = can.Bus(
                    interface=channel.interface,
                    channel=channel.name,
                    fd=True,
                    bitrate=channel.bitrate,
                    data_bitrate=channel.data_bitrate,
                )
            except (can.CanError, OSError, ValueError, TypeError, ImportError) as error:
                self.close()
                raise BusLost(f"CAN channel {channel.name} (interface {channel.interface}): {error}") from error
            self._buses.append(bus)
            try:
                self._poll.register(bus.fileno(), select.EPOLLIN)
            except NotImplementedError:
                self._unwaitable = bus

    def send(self, records: npt.NDArray[np.void]) -> None:
        """Queue frames without waiting; see Port.send."""
        data = np.ascontiguousarray(records).view(np.uint8).data
        for row in range(len(records)):
            bus = int(records[row]["bus"])
            message = self._convert.to_message(data[BYTES * row : BYTES * (row + 1)], self._names, rx=False)
            try:
                self._buses[bus].send(message, timeout=0)
            except self._can.CanOperationError:
                self.refused += 1
            except (self._can.CanError, OSError) as error:
                raise BusLost(f"CAN channel {self._names[bus]}: {error}") from error
            else:
                _count(records[row : row + 1].view(np.uint64), 1, self._bitrates, SENT, self.counters)

    def receive(self, timeout_s: float = 0.0) -> npt.NDArray[np.void]:
        """All frames that have arrived, channel by channel; see Port.receive."""
        n = self._drain(0, 0.0)
        if n == 0 and timeout_s > 0.0:
            if self._unwaitable is None:
                self._poll.poll(timeout_s)
                n = self._drain(0, 0.0)
            else:
                n = self._drain(0, timeout_s)
        _count(self._records.view(np.uint64), n, self._bitrates, RECEIVED, self.counters)
        return self._records[:n]

    def _drain(self, n: int, timeout_s: float) -> int:
        for index, bus in enumerate(self._buses):
            wait = timeout_s if bus is self._unwaitable else 0.0
            try:
                while n < _ROOM and (message := bus.recv(wait)) is not None:
                    wait = 0.0
                    if not message.is_error_frame:
                        self._bytes[BYTES * n : BYTES * (n + 1)] = self._convert.to_record(message, index)
                        n += 1
            except (self._can.CanError, OSError) as error:
                raise BusLost(f"CAN channel {self._names[index]}: {error}") from error
        return n

    def fileno(self) -> int:
        """Readable when frames wait on any channel. Raises NotImplementedError where an interface can't be waited on."""
        if self._unwaitable is not None:
            raise NotImplementedError(
                f"CAN interface of {self._unwaitable.channel_info}: has no file descriptor to wait on"
            )
        return self._poll.fileno()

    def close(self) -> None:
        """Leave the buses."""
        self._poll.close()
        for bus in self._buses:
            bus.shutdown()


def open_port(description: Any, runtime: Runtime, *, timeout_s: float = 5.0, name: str | None = None) -> Port:
    """The port to a robot's channels, as its description says: interface `handrail` is the virtual bus of `runtime`.

    Raises BusLost when a bus is not there, ValueError when the channels mix the virtual bus with real ones.
    """
    virtual = [channel.interface == "handrail" for channel in description.channels]
    if all(virtual):
        return HubPort(runtime.bus, [channel.name for channel in description.channels], timeout_s=timeout_s, name=name)
    if any(virtual):
        raise ValueError(
            f"robot {description.name}: channels.interface: "
            f"{[channel.interface for channel in description.channels]}; expected `handrail` on all channels or on none"
        )
    return CanPort(description.channels)
