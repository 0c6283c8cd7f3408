"""Real CAN channels: any interface of python-can, opened with the options that its own hardware needs.

What differs between interfaces is how their controller is told its bit rates. SocketCAN has them from `ip link`; PCAN and Kvaser
want bit timings; slcan takes two rates only by timings too. Sources: python-can's documentation of each interface, 4.6.
"""

from __future__ import annotations

import errno
import select
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import can
import numpy as np
import numpy.typing as npt

from hal.can import convert
from hal.can.controller_state import ControllerState, of_bus
from hal.can.counting import RECEIVED, SENT, count_frames
from hal.can.frames import BYTES, RECORD
from hal.can.port import ROOM
from hal.can.timing import BusTiming
from hal.can.wire import BusLost

_SAMPLE_POINT = 80.0
"""percent of a bit, at both rates (CiA 601-3 recommends the same for all nodes; Kvaser's and PEAK's defaults are near)"""
_CLOCK = 80_000_000
"""Hz, of the CAN FD controllers in PCAN and Kvaser hardware"""
_SLCAN_RATES = (10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 750_000, 1_000_000, 83_300)
_SLCAN_DATA_RATES = (2_000_000, 5_000_000)

Options = Mapping[str, Any]


def _timing(bitrate: int, data_bitrate: int) -> can.BitTimingFd:
    return can.BitTimingFd.from_sample_point(_CLOCK, bitrate, _SAMPLE_POINT, data_bitrate, _SAMPLE_POINT)


def _socketcan(channel: str, bitrate: int, data_bitrate: int) -> dict[str, Any]:
    # The rates are the network interface's (hal.can.bus_check compares them); the socket takes none.
    return {"channel": channel, "fd": True}


def _timed(channel: str, bitrate: int, data_bitrate: int) -> dict[str, Any]:
    return {"channel": channel, "timing": _timing(bitrate, data_bitrate)}


def _slcan(channel: str, bitrate: int, data_bitrate: int) -> dict[str, Any]:
    # The protocol has letters for rates, not timings; only those two data rates (CANable 2.0's firmware).
    if data_bitrate not in _SLCAN_DATA_RATES:
        raise ValueError(f"slcan has no such data rate; expected {' or '.join(map(str, _SLCAN_DATA_RATES))}")
    if bitrate not in _SLCAN_RATES:
        raise ValueError(f"slcan has no such bit rate; expected one of {', '.join(map(str, _SLCAN_RATES))}")
    return _timed(channel, bitrate, data_bitrate)


def _kvaser(channel: str, bitrate: int, data_bitrate: int) -> dict[str, Any]:
    # `bitrate` and `data_bitrate` alone would only do for the five rates that CANlib has by name, which 5 Mbit/s is not.
    if not channel.isdecimal():
        raise ValueError(f"got channel {channel!r}; expected CANlib's number of it, e.g. 0 (`handrail can interfaces`)")
    return {"channel": int(channel), "timing": _timing(bitrate, data_bitrate)}


def _virtual(channel: str, bitrate: int, data_bitrate: int) -> dict[str, Any]:
    return {"channel": channel, "protocol": can.CanProtocol.CAN_FD}


def _others(channel: str, bitrate: int, data_bitrate: int) -> dict[str, Any]:
    return {"channel": channel, "fd": True, "bitrate": bitrate, "data_bitrate": data_bitrate}


_ARGUMENTS: dict[str, Callable[[str, int, int], dict[str, Any]]] = {
    "socketcan": _socketcan,
    "pcan": _timed,
    "kvaser": _kvaser,
    "slcan": _slcan,
    "virtual": _virtual,
}


def interfaces() -> list[str]:
    """The names of all interfaces that python-can has here, ours included."""
    return sorted(can.VALID_INTERFACES)


def check_interface(interface: str) -> None:
    """Raises ValueError, with all names that there are, when python-can has no such interface."""
    if interface not in can.VALID_INTERFACES:
        raise ValueError(
            f"interface {interface!r} is none that python-can has; expected handrail (the virtual bus) or one of "
            f"{', '.join(name for name in interfaces() if name != 'handrail')}"
        )


def arguments(
    interface: str, channel: str, bitrate: int, data_bitrate: int, options: Options | None = None
) -> dict[str, Any]:
    """What `can.Bus` is called with for a channel with these bit rates (bit/s). `options` come last and win.

    Raises ValueError for an unknown interface, a channel that it can't have, or rates that its hardware can't make.
    """
    check_interface(interface)
    try:
        made = _ARGUMENTS.get(interface, _others)(channel, bitrate, data_bitrate)
    except ValueError as error:
        raise ValueError(
            f"CAN channel {channel} (interface {interface}, {bitrate} and {data_bitrate} bit/s): {error}"
        ) from error
    return {"interface": interface, **made, **(options or {})}


def open_bus(
    interface: str, channel: str, bitrate: int, data_bitrate: int, options: Options | None = None
) -> can.BusABC:
    """Open one channel. Raises ValueError as `arguments` does, BusLost with what to do when it can't be opened."""
    wanted = arguments(interface, channel, bitrate, data_bitrate, options)
    try:
        # Not python-can's own configuration file: what a robot needs is in its description.
        return can.Bus(ignore_config=True, **wanted)
    except (can.CanError, OSError, ValueError, TypeError, KeyError, ImportError, NameError, AttributeError) as error:
        # Interfaces whose driver or library is missing fail in any of these ways.
        missing = isinstance(error, can.CanInterfaceNotImplementedError | ImportError | NameError)
        said = "its driver's library or Python package is missing" if missing else str(error) or type(error).__name__
        raise BusLost(f"CAN channel {channel} (interface {interface}): {said}; {_advice(interface, error)}") from error


def _advice(interface: str, error: Exception) -> str:
    if interface == "socketcan" and isinstance(error, OSError):
        if error.errno in (errno.EAFNOSUPPORT, errno.EPROTONOSUPPORT):
            return "this kernel has no SocketCAN (`modprobe can_raw`)"
        return (
            "expected a CAN network interface that is up: `ip link` shows them, and `ip link set can0 up type can "
            "bitrate 1000000 dbitrate 5000000 fd on` starts one"
        )
    if interface == "slcan":
        return "expected the adapter's serial port, e.g. /dev/ttyACM0, that this user may open (group dialout)"
    if isinstance(error, can.CanInterfaceNotImplementedError | ImportError | NameError):
        return f"install what python-can's page on `{interface}` names"
    return "`handrail can interfaces` lists the channels that its driver shows"


class CanPort:
    """Places on real buses, one python-can bus a channel. Allocates a message a frame, as python-can does."""

    def __init__(self, channels: Sequence[Any]):
        """Open every channel: anything with name, interface (python-can's name), bitrate and data_bitrate (bit/s), and maybe
        channel (python-can's, where it is not the name) and options (for `can.Bus`).

        Raises BusLost or ValueError naming the channel that can't be opened.
        """
        self.channels = [BusTiming(c.name, c.bitrate, c.data_bitrate) for c in channels]
        self._bitrates = np.array([(c.bitrate, c.data_bitrate) for c in channels], np.int64).reshape(-1, 2)
        self.counters = np.zeros((len(channels), 3), np.int64)
        self.refused = 0
        self.lost = 0
        self.error_frames = np.zeros(len(channels), np.int64)
        """(channels,) error frames that the controllers have reported since the port was opened"""
        self._records = np.zeros(ROOM, RECORD)
        self._bytes = self._records.view(np.uint8).data
        self._names = [channel.name for channel in channels]
        self._places = [(channel.interface, getattr(channel, "channel", "") or channel.name) for channel in channels]
        self._buses: list[can.BusABC] = []
        self._poll = select.epoll()
        self._unwaitable: can.BusABC | None = None
        for channel, (_, python_cans) in zip(channels, self._places, strict=True):
            options = getattr(channel, "options", None)
            try:
                bus = open_bus(channel.interface, python_cans, channel.bitrate, channel.data_bitrate, options)
            except (BusLost, ValueError):
                self.close()
                raise
            self._buses.append(bus)
            try:
                self._poll.register(bus.fileno(), select.EPOLLIN)
            except (NotImplementedError, OSError, ValueError):
                self._unwaitable = bus

    @property
    def states(self) -> dict[str, ControllerState | None]:
        """How each channel's controller fares; None where nobody can tell. Asks the system: not for the loop."""
        return {
            name: of_bus(bus, interface, channel)
            for name, bus, (interface, channel) in zip(self._names, self._buses, self._places, strict=True)
        }

    def send(self, records: npt.NDArray[np.void]) -> None:
        """Queue frames without waiting; see Port.send."""
        data = np.ascontiguousarray(records).view(np.uint8).data
        for row in range(len(records)):
            bus = int(records[row]["bus"])
            message = convert.to_message(data[BYTES * row : BYTES * (row + 1)], self._names, rx=False)
            try:
                self._buses[bus].send(message, timeout=0)
            except can.CanOperationError:
                self.refused += 1
            except (can.CanError, OSError) as error:
                raise BusLost(f"CAN channel {self._names[bus]}: {error}") from error
            else:
                count_frames(records[row : row + 1].view(np.uint64), 1, self._bitrates, SENT, self.counters)

    def receive(self, timeout_s: float = 0.0) -> npt.NDArray[np.void]:
        """All frames that have arrived, channel by channel; see Port.receive."""
        n = self._drain(0, 0.0)
        if n == 0 and timeout_s > 0.0:
            if self._unwaitable is None:
                self._poll.poll(timeout_s)
                n = self._drain(0, 0.0)
            else:
                n = self._drain(0, timeout_s)
        count_frames(self._records.view(np.uint64), n, self._bitrates, RECEIVED, self.counters)
        return self._records[:n]

    def _drain(self, n: int, timeout_s: float) -> int:
        for index, bus in enumerate(self._buses):
            wait = timeout_s if bus is self._unwaitable else 0.0
            try:
                while n < ROOM and (message := bus.recv(wait)) is not None:
                    wait = 0.0
                    if message.is_error_frame:
                        self.error_frames[index] += 1
                        continue
                    self._bytes[BYTES * n : BYTES * (n + 1)] = convert.to_record(message, index)
                    n += 1
            except (can.CanError, OSError) as error:
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
