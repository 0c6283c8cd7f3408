"""The control loop's way to its CAN channels: records in, records out, whether the bus is virtual or real.

A record's `bus` is the index of its channel in the robot's description. `HubPort` speaks to the virtual bus and allocates
nothing but array views; `CanPort` (hal.can.real_port) speaks to any python-can interface (SocketCAN, PCAN, Kvaser, ...);
`MixedPort` (hal.can.mixed_port) to both. `open_port` finds out which, and refuses what can't work before anything moves.
"""

from __future__ import annotations

import errno
import os
import select
import socket
import struct
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from hal.awake import Awake
from hal.can import datagrams, wire
from hal.can.counting import Ledger
from hal.can.frames import BYTES, RECORD, WORDS
from hal.can.wire import BusLost
from handrail.runtime import Runtime

ROOM = 8 * wire.MAX_RECORDS
"""Records that one receive takes in."""


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
        ticks: bool = False,
    ):
        """Join the hub at `path` (Runtime.bus) for these channels, in this order; None: all, in the hub's order.

        own_frames: also receive what this port sent. name: what reports and faults call this node. ticks: count `ticks`.
        Raises BusLost when no hub is there within `timeout_s`, ValueError when it has no such channel.
        """
        self._buffer = np.zeros(WORDS * ROOM, np.uint64)
        self._bytes = self._buffer.data.cast("B")
        self._records = self._buffer.view(RECORD)
        # Compile before joining: a slow start would let the socket fill.
        warm = Ledger([]).memory
        datagrams.send(-1, self._buffer, 0, warm)
        datagrams.receive(-1, self._buffer, 0, False, warm)
        self._path = path
        self._socket, infos = wire.join(
            path,
            None if channels is None else list(channels),
            own_frames=own_frames,
            timeout_s=timeout_s,
            name=name,
            ticks=ticks,
        )
        self.channels = infos
        """The channels joined, in this port's order."""
        self._ledger = Ledger(infos)
        self.counters = self._ledger.counters
        self.refused = 0
        self.lost = 0
        self.ticks = 0
        """how often the plant said that a cycle is over, where this port asked for it"""
        # Whoever waits for frames waits in `recv` itself: one call where asking first would be two.
        self._socket.setblocking(True)
        self._descriptor = self._socket.fileno()
        self._patience_s = 0.0
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)
        self._awake: Awake | None = None
        # Who sends or receives in every cycle does so with the same array again and again: its views are made once.
        self._batch, self._received = self._records[:0], {0: self._records[:0]}
        self._words = self._buffer[:0]

    def take_turns(self) -> None:
        """Wait for frames awake from now on, where there are cores for that: who sends them waits for this process's, too."""
        self._awake = Awake()

    def send(self, records: npt.NDArray[np.void]) -> None:
        """Queue frames without waiting, all of them in one datagram where they fit; see Port.send."""
        if records is self._batch:
            self._send(len(records))
        elif len(records) <= wire.MAX_RECORDS and records.flags.c_contiguous:
            self._batch, self._words = records, records.view(np.uint64)
            self._send(len(records))
        else:
            for start in range(0, len(records), wire.MAX_RECORDS):
                self.send(np.ascontiguousarray(records[start : start + wire.MAX_RECORDS]))

    def _send(self, n: int) -> None:
        if n == 0:
            return  # an empty datagram means that this process leaves
        if told := datagrams.send(self._descriptor, self._words, n, self._ledger.memory):
            if told != errno.EAGAIN:
                raise self._bus_lost(told)
            self.refused += n

    def receive(self, timeout_s: float = 0.0) -> npt.NDArray[np.void]:
        """All frames that have arrived, in the order in which the buses carried them; see Port.receive.

        Where it was waited for, and what came ends with the plant's word that a cycle is over, what may have come behind that is
        left for the next call.
        """
        awaited, ledger = timeout_s > 0.0, self._ledger.memory
        if awaited and self._awake is not None:
            self._awake.look(self._poll.poll)
        n, lost, ticks, told = datagrams.receive(self._descriptor, self._buffer, 0, awaited, ledger)
        if told == datagrams.NOTHING and awaited and (count := self._sleep(timeout_s)):
            n, lost, ticks, told = datagrams.receive(self._descriptor, self._buffer, count, True, ledger)
        if told and told != datagrams.NOTHING:
            raise self._bus_lost(told)
        self.lost += lost
        self.ticks += ticks
        if (received := self._received.get(n)) is None:
            received = self._received[n] = self._records[:n]
        return received

    def _sleep(self, timeout_s: float) -> int:
        """Wait for a datagram; how many records it was, 0: none came."""
        if timeout_s != self._patience_s:
            self._set_patience(timeout_s)
        try:
            count = self._socket.recv_into(self._bytes) // BYTES
        except BlockingIOError:
            return 0
        except OSError as error:
            raise BusLost(f"CAN bus at {self._path}: {error}") from error
        if count == 0:
            raise self._bus_lost(datagrams.ENDED)
        if self._awake is not None:
            self._awake.woken()
        return count

    def _bus_lost(self, told: int) -> BusLost:
        why = "the hub has ended" if told == datagrams.ENDED else os.strerror(told)
        return BusLost(f"CAN bus at {self._path}: {why}")

    def _set_patience(self, timeout_s: float) -> None:
        """Let `recv` wait at most so long (socket(7), SO_RCVTIMEO, where 0 would be for ever)."""
        seconds, microseconds = divmod(max(1, round(timeout_s * 1e6)), 1_000_000)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("@ll", seconds, microseconds))
        self._patience_s = timeout_s

    @property
    def hub_process(self) -> int:
        """Id of the hub's process (unix(7), SO_PEERCRED)."""
        return int(struct.unpack("3i", self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))[0])

    def fileno(self) -> int:
        """Readable when frames wait."""
        return self._socket.fileno()

    def close(self) -> None:
        """Leave the bus."""
        self._descriptor = -1
        self._socket.close()


def open_port(description: Any, runtime: Runtime, *, timeout_s: float = 5.0, name: str | None = None) -> Port:
    """The port to a robot's channels, as its description says: interface `handrail` is the virtual bus of `runtime`.

    name: what the virtual bus calls this node. Raises BusLost when a bus is not there, ValueError when the description asks
    for what none of python-can's interfaces or the hub can give, with what to do.
    """
    virtual = [channel.interface == "handrail" for channel in description.channels]
    if all(virtual):
        names = [channel.name for channel in description.channels]
        port = HubPort(runtime.bus, names, timeout_s=timeout_s, name=name, ticks=True)
        check_hub_rates(description, port, runtime)
        return port
    # Only robots with real channels pay for importing python-can.
    from hal.can.bus_check import check_channels
    from hal.can.mixed_port import MixedPort
    from hal.can.real_port import CanPort

    check_channels(description.channels)
    if not any(virtual):
        return CanPort(description.channels)
    mixed = MixedPort(description.channels, runtime, timeout_s=timeout_s, name=name)
    check_hub_rates(description, mixed, runtime)
    return mixed


def check_hub_rates(description: Any, port: Any, runtime: Runtime) -> None:
    """Close the port and raise ValueError where the hub runs a virtual channel at other rates than the robot's drives have."""
    for wanted, there in zip(description.channels, port.channels, strict=True):
        if (wanted.bitrate, wanted.data_bitrate) != (there.bitrate, there.data_bitrate):
            port.close()
            raise ValueError(
                f"CAN channel {wanted.name}: {description.name} has {wanted.bitrate} and {wanted.data_bitrate} bit/s, the hub "
                f"at {runtime.bus} runs it at {there.bitrate} and {there.data_bitrate}; start the hub with --bitrate "
                f"{wanted.bitrate} --data-bitrate {wanted.data_bitrate}, or change network.channels in the robot's robot.yaml"
            )
