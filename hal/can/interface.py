"""The virtual bus as a python-can interface: ``can.Bus(interface="handrail", channel="can0", runtime=FOLDER)``.

Registered under the entry point ``can.interface``, so that every python-can tool can use it. Timestamps are seconds on the
bus's own clock: simulated time where a plant runs the bus.
"""

from __future__ import annotations

import logging
import os
import select
import time
from collections.abc import Sequence
from typing import Any

import can

from hal.can import wire
from hal.can.convert import to_message, to_record
from hal.can.frames import BYTES, LOST
from hal.can.replay import channel_of
from hal.can.wire import BusLost
from handrail.runtime import Runtime

_log = logging.getLogger(__name__)


class HandrailBus(can.BusABC):
    """A process's place on the virtual bus."""

    def __init__(
        self,
        channel: str | Sequence[str] | None = None,
        *,
        runtime: str | os.PathLike[str] | None = None,
        receive_own_messages: bool = False,
        can_filters: Any = None,
        timeout: float = 5.0,
        name: str | None = None,
        **_other: Any,
    ):
        """Join one channel, several (a list, or names with commas between), or all (None).

        runtime: the robot's runtime folder (default: $HANDRAIL_RUNTIME, else this user's). timeout: s to wait for the hub.
        name: what reports and faults call this node (default: program and process id).
        Bit rates and `fd` are accepted and ignored: the bus has what its hub was given. Raises can.CanInitializationError.
        """
        names = (
            None
            if channel is None
            else [n.strip() for n in channel.split(",")]
            if isinstance(channel, str)
            else list(channel)
        )
        folder = Runtime.at(runtime, make=False)
        try:
            self._socket, self.channels = wire.join(
                folder.bus, names, own_frames=receive_own_messages, timeout_s=timeout, name=name
            )
        except (BusLost, ValueError) as error:
            # The base class complains at deletion about buses that were not shut down.
            self._is_shutdown = True
            raise can.CanInitializationError(str(error)) from error
        self._names = [info.name for info in self.channels]
        self.channel_info = f"handrail {','.join(self._names)} at {folder.folder}"
        self._can_protocol = can.CanProtocol.CAN_FD
        self.lost = 0
        """frames that the hub dropped, since this process read too slowly"""
        self._view = memoryview(bytearray(wire.MAX_BYTES))
        self._at, self._end = 0, 0
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)
        # A datagram brings many messages, but whoever waits on `fileno` reads one a time: `_more` is readable while messages
        # are left of the last datagram.
        self._more = os.eventfd(0, os.EFD_NONBLOCK)
        self._more_is_set = False
        self._waitable = select.epoll()
        self._waitable.register(self._socket, select.EPOLLIN)
        self._waitable.register(self._more, select.EPOLLIN)
        super().__init__(channel=",".join(self._names), can_filters=can_filters)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        while True:
            while self._at < self._end:
                record = self._view[self._at : self._at + BYTES]
                self._at += BYTES
                if self._more_is_set != (self._at < self._end):
                    self._mark_more()
                if record[13] & LOST:
                    lost = int.from_bytes(record[8:12], "little")
                    self.lost += lost
                    _log.warning("%s: %d frames lost: this process reads too slowly", self.channel_info, lost)
                    continue
                return to_message(record, self._names), False
            try:
                self._at, self._end = 0, self._socket.recv_into(self._view)
            except BlockingIOError:
                if not self._poll.poll(None if timeout is None else max(0.0, timeout) * 1000):
                    return None, False
                continue
            except OSError as error:
                raise can.CanOperationError(f"{self.channel_info}: {error}") from error
            if self._end == 0:
                raise can.CanOperationError(f"{self.channel_info}: the bus has ended")

    def _mark_more(self) -> None:
        if self._more_is_set:
            os.eventfd_read(self._more)
        else:
            os.eventfd_write(self._more, 1)
        self._more_is_set = not self._more_is_set

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a message on the channel that it names (a log's by number), else on the first.

        Waits at most `timeout` s for room in the queue. Raises can.CanOperationError when there is no room in time or the bus
        is gone, ValueError for what is no frame.
        """
        bus = self._names.index(channel_of(msg.channel, self._names) or self._names[0])
        record = to_record(msg, bus)
        deadline = None if timeout is None else time.monotonic() + timeout
        writable = select.poll()
        writable.register(self._socket, select.POLLOUT)
        while True:
            try:
                self._socket.send(record)
                return
            except BlockingIOError as error:
                left = None if deadline is None else (deadline - time.monotonic()) * 1000
                if (left is not None and left <= 0) or not writable.poll(left):
                    raise can.CanOperationError(f"{self.channel_info}: the transmit queue is full") from error
            except OSError as error:
                raise can.CanOperationError(f"{self.channel_info}: {error}") from error

    def fileno(self) -> int:
        """Readable when messages wait."""
        return self._waitable.fileno()

    def shutdown(self) -> None:
        """Leave the bus."""
        if not self._is_shutdown:
            self._waitable.close()
            os.close(self._more)
            self._socket.close()
        super().shutdown()

    @staticmethod
    def _detect_available_configs() -> Sequence[can.typechecking.AutoDetectedConfig]:
        try:
            connection, channels = wire.join(Runtime.at(make=False).bus, timeout_s=0.0)
        except (BusLost, ValueError):
            return []
        connection.close()
        return [{"interface": "handrail", "channel": channel.name} for channel in channels]
