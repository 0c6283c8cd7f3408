"""A robot whose channels are partly virtual and partly real: some drives emulated, some on the bench."""

from __future__ import annotations

import select
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from hal.can.controller_state import ControllerState
from hal.can.frames import MAX_CHANNELS, RECORD
from hal.can.port import ROOM, HubPort
from hal.can.real_port import CanPort
from handrail.runtime import Runtime

_GLANCE_S = 0.001
"""wait between two looks at a real interface that can't be waited on"""


class MixedPort:
    """A place on the virtual bus and places on real buses as one port; records count the channels as the robot does.

    The virtual frames come first in what `receive` returns: their times are the plant's clock, the others' the wall's.
    """

    def __init__(self, channels: Sequence[Any], runtime: Runtime, *, timeout_s: float = 5.0, name: str | None = None):
        """Join the virtual channels (interface `handrail`) of `runtime`, open the others as CanPort does.

        Raises BusLost or ValueError naming the channel that can't be opened.
        """
        virtual = [index for index, channel in enumerate(channels) if channel.interface == "handrail"]
        real = [index for index, channel in enumerate(channels) if channel.interface != "handrail"]
        # The real ones first: who only misspelled one shall not wait for a hub.
        self._real = CanPort([channels[index] for index in real])
        try:
            names = [channels[index].name for index in virtual]
            self._virtual = HubPort(runtime.bus, names, timeout_s=timeout_s, name=name)
        except (OSError, ValueError):
            self._real.close()
            raise
        self._sides = ((self._virtual, np.array(virtual, np.uint8)), (self._real, np.array(real, np.uint8)))
        # Robot's channel → its index in the port that carries it, for the records that go out.
        self._local = np.zeros(MAX_CHANNELS, np.uint8)
        self._is_real = np.zeros(MAX_CHANNELS, np.bool_)
        for local, index in enumerate(virtual):
            self._local[index] = local
        for local, index in enumerate(real):
            self._local[index], self._is_real[index] = local, True
        by_index = dict(zip([*virtual, *real], [*self._virtual.channels, *self._real.channels], strict=True))
        self.channels = [by_index[index] for index in range(len(channels))]
        """the channels, as the robot counts them"""
        self.counters = np.zeros((len(channels), 3), np.int64)
        self.refused = self.lost = 0
        self._records = np.zeros(2 * ROOM, RECORD)
        self._poll = select.epoll()
        self._poll.register(self._virtual.fileno(), select.EPOLLIN)
        self._waits = True
        try:
            self._poll.register(self._real.fileno(), select.EPOLLIN)
        except NotImplementedError:
            self._waits = False

    @property
    def error_frames(self) -> npt.NDArray[np.int64]:
        """(channels,) error frames that the controllers of real channels have reported."""
        counted = np.zeros(len(self.counters), np.int64)
        counted[self._sides[1][1]] = self._real.error_frames
        return counted

    @property
    def states(self) -> dict[str, ControllerState | None]:
        """How the controllers of real channels fare; see CanPort.states."""
        return self._real.states

    def send(self, records: npt.NDArray[np.void]) -> None:
        """Queue frames without waiting; see Port.send."""
        goes = self._is_real[records["bus"]]
        for port, chosen in ((self._virtual, ~goes), (self._real, goes)):
            if np.count_nonzero(chosen):
                batch = records[chosen]
                batch["bus"] = self._local[batch["bus"]]
                port.send(batch)
        self._count()

    def receive(self, timeout_s: float = 0.0) -> npt.NDArray[np.void]:
        """All frames that have arrived, the virtual bus's first; see Port.receive."""
        n = self._take()
        if n == 0 and timeout_s > 0.0:
            deadline = time.monotonic() + timeout_s
            while n == 0 and (left := deadline - time.monotonic()) > 0.0:
                self._poll.poll(left if self._waits else min(left, _GLANCE_S))
                n = self._take()
        self._count()
        return self._records[:n]

    def _take(self) -> int:
        n = 0
        for port, places in self._sides:
            got = port.receive(0.0)
            if len(got):
                self._records[n : n + len(got)] = got
                self._records["bus"][n : n + len(got)] = places[got["bus"]]
                n += len(got)
        return n

    def _count(self) -> None:
        for port, places in self._sides:
            self.counters[places] = port.counters
        self.refused = self._virtual.refused + self._real.refused
        self.lost = self._virtual.lost + self._real.lost

    def fileno(self) -> int:
        """Readable when frames wait. Raises NotImplementedError where a real interface can't be waited on."""
        if not self._waits:
            self._real.fileno()  # says which
        return self._poll.fileno()

    def close(self) -> None:
        """Leave the buses."""
        self._poll.close()
        self._virtual.close()
        self._real.close()
