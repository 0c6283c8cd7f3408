"""What a hub reports of its bus, found out about any bus by listening: frames and load by identifier."""

from __future__ import annotations

import threading
import time
from collections import defaultdict

import can
import numpy as np

from hal.can.control import BusReport, ChannelState, IdentifierLoad, NodeState
from hal.can.controller_state import of_bus
from hal.can.convert import to_record
from hal.can.frames import WORDS
from hal.can.timing import LoadMeter, frame_ns


class ListenedBus:
    """Counts what one channel of a real bus carries, from now on. Of its nodes only this computer's controller may tell how it
    fares; the others can't be heard."""

    def __init__(self, bus: can.BusABC, name: str, bitrate: int, data_bitrate: int, interface: str = ""):
        """`bus` is closed by `close`; `name`: what to call the channel; rates in bit/s, which the load is counted by;
        `interface`: python-can's name of it, by which its controller is asked."""
        self._bus, self._name, self._rates, self._interface = bus, name, (bitrate, data_bitrate), interface
        self._counts: defaultdict[tuple[int, bool], list[int]] = defaultdict(lambda: [0, 0])
        self._error_frames, self._began, self._lock = 0, time.monotonic_ns(), threading.Lock()
        self._meter = LoadMeter()
        self._problem: Exception | None = None
        self._record = np.zeros(WORDS, np.uint64)
        frame_ns(self._record, 0, bitrate, data_bitrate)  # compile before the first frame waits
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        while not self._ending.is_set():
            try:
                message = self._bus.recv(0.1)
            except (can.CanError, OSError, ValueError) as error:
                self._problem = error
                return
            if message is None:
                continue
            if message.is_error_frame:
                self._error_frames += 1
                continue
            self._record.view(np.uint8).data[:] = to_record(message, 0)
            busy = int(frame_ns(self._record, 0, *self._rates))
            with self._lock:
                of = self._counts[message.arbitration_id, message.is_extended_id]
                of[0] += 1
                of[1] += busy

    def report(self) -> BusReport:
        """What was heard so far. Raises can.CanOperationError when the bus has ended."""
        if self._problem is not None:
            raise can.CanOperationError(f"{self._name}: {self._problem}")
        now = time.monotonic_ns() - self._began
        with self._lock:
            identifiers = [
                IdentifierLoad(can_id=can_id, extended=extended, frames=frames, busy_ns=busy)
                for (can_id, extended), (frames, busy) in self._counts.items()
            ]
        busy = sum(of.busy_ns for of in identifiers)
        channel = ChannelState(
            name=self._name,
            bitrate=self._rates[0],
            data_bitrate=self._rates[1],
            frames=sum(of.frames for of in identifiers),
            busy_ns=busy,
            error_frames=self._error_frames,
            load=self._meter.update(now, busy),
            identifiers=identifiers,
        )
        return BusReport(time_ns=now, timing=True, channels=[channel], nodes=self._controller(), faults={}, hits={})

    def _controller(self) -> list[NodeState]:
        told = of_bus(self._bus, self._interface, self._name)
        if told is None:
            return []
        node = NodeState(
            name="this computer", channel=self._name, state=told.state, transmit_errors=told.transmit_errors,
            receive_errors=told.receive_errors, waiting=0, overflows=0,
        )  # fmt: skip
        return [node]

    def close(self) -> None:
        """Stop listening and leave the bus."""
        self._ending.set()
        self._thread.join()
        self._bus.shutdown()
