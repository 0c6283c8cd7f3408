"""A test's place on the bus: it hears every frame, lays faults on the bus, sends frames of its own."""

from __future__ import annotations

import contextlib
import fnmatch
import os
import select
import threading
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import can
import msgspec
import numpy as np
import numpy.typing as npt

from hal.can import convert, frames
from hal.can.control import BusReport, HubControl
from hal.can.faults import Fault, Kind
from hal.can.port import BusLost, HubPort
from hal.drives.protocol import LimbProtocol
from hal.hil.traffic import Traffic
from handrail.robot.description import RobotDescription
from handrail.runtime import Runtime

KEPT = 400_000
"""frames that are remembered, the newest: half a minute of a robot with 18 drives"""
_LOOK_S, _HOLD_S = 0.05, 0.1
_NODE, _CATCH_UP_S = "test", 20.0
_CAN_TIME_STEP = 1e-9


class LaidFault:
    """A fault that is on the bus."""

    def __init__(self, control: HubControl, number: int, fault: Fault):
        self._control, self.number, self.fault = control, number, fault

    @property
    def hits(self) -> int:
        """frames hit so far"""
        return self._control.report().hits.get(self.number, 0)


class Bus:
    """Everything about the virtual bus that a test wants."""

    def __init__(self, runtime: Runtime, description: RobotDescription):
        self._runtime, self._description = runtime, description
        self._protocol = LimbProtocol(description)
        self._port = HubPort(runtime.bus, own_frames=True, name=_NODE)
        self.channels = [channel.name for channel in self._port.channels]
        self._control = HubControl(runtime.bus)
        self._kept: deque[npt.NDArray[np.void]] = deque()
        self._first = self._count = 0
        self._asked = self._reached = 0
        """how often somebody wanted all that is on its way, and how often the listener has seen the end of it"""
        self._changed = threading.Condition()
        self._outbox: deque[npt.NDArray[np.void]] = deque()
        self._closing = self.holding = False
        self._wake = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        """the listener has something to send"""
        self._thread = threading.Thread(target=self._listen, name="hil-bus", daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        poll = select.poll()
        poll.register(self._port.fileno(), select.POLLIN)
        poll.register(self._wake, select.POLLIN)
        hold, next_hold = frames.empty(self._protocol.frames_a_cycle), 0.0
        try:
            while not self._closing:
                poll.poll(_LOOK_S * 1000)
                with contextlib.suppress(BlockingIOError):
                    os.eventfd_read(self._wake)
                asked = self._asked
                while len(records := self._port.receive()):
                    self._keep(records.copy())
                self._reach(asked)
                while self._outbox:
                    self._port.send(self._outbox.popleft())
                if self.holding and (now := time.monotonic()) >= next_hold:
                    self._port.send(hold[: self._protocol.encode_hold_time(0, hold)])
                    next_hold = now + _HOLD_S
        except BusLost:
            return  # the plant has ended
        finally:
            self._closing = True
            self._reach(self._asked)

    def _reach(self, asked: int) -> None:
        if asked > self._reached or self._closing:
            with self._changed:
                self._reached = asked
                self._changed.notify_all()

    def _catch_up(self) -> None:
        """Hear all that was on the bus before this call: on a busy machine a robot in lock-step is seconds ahead."""
        deadline = time.monotonic() + _CATCH_UP_S
        with contextlib.suppress(BusLost):  # a bus that has ended says nothing more, and what it said is in the socket
            while not self._closing and (waiting := max(at.unread for at in self._control.node(_NODE))):
                assert time.monotonic() < deadline, f"{waiting} frames still wait on the bus after {_CATCH_UP_S:g} s"
                with self._changed:
                    self._changed.wait(_LOOK_S)
        with self._changed:
            self._asked += 1
            asked = self._asked
            os.eventfd_write(self._wake, 1)
            came = self._changed.wait_for(lambda: self._reached >= asked or self._closing, _CATCH_UP_S)
        assert came, f"the frames on the bus did not end in {_CATCH_UP_S:g} s"

    def _keep(self, records: npt.NDArray[np.void]) -> None:
        with self._changed:
            self._kept.append(records)
            self._count += len(records)
            while self._kept and self._count - self._first - len(self._kept[0]) > KEPT:
                self._first += len(self._kept.popleft())
            self._changed.notify_all()

    # ------------------------------------------------------------------------------------------------------------ listening

    @property
    def mark(self) -> int:
        """How many frames have come until now: give it to `traffic(since=...)` later."""
        self._catch_up()
        return self._count

    def records(self, since: int = 0) -> npt.NDArray[np.void]:
        """Frames (hal.can.frames.RECORD) since a mark until now, as far as they are remembered."""
        self._catch_up()
        with self._changed:
            everything, first = list(self._kept), self._first
        joined = np.concatenate(everything) if everything else frames.empty(0)
        return joined[max(0, since - first) :]

    def traffic(self, since: int = 0) -> Traffic:
        """Frames since a mark, to be asked what they mean."""
        return Traffic(self.records(since), self._description, self._protocol)

    def wait_frames(self, count: int, timeout_s: float = 10.0) -> None:
        """Wait until so many more frames have come. Raises AssertionError when they don't."""
        wanted = self._count + count
        with self._changed:
            came = self._changed.wait_for(lambda: self._count >= wanted, timeout_s)
        assert came, f"{count - (wanted - self._count)} of {count} frames came in {timeout_s:g} s"

    def messages(self, since: int = 0) -> Iterator[can.Message]:
        """Frames since a mark as python-can's messages."""
        data = self.records(since).view(np.uint8).data
        for start in range(0, len(data), frames.BYTES):
            yield convert.to_message(data[start : start + frames.BYTES], self.channels)

    def save(self, file: Path, since: int = 0) -> Path:
        """A capture in any format of python-can's, by the file's suffix (.asc, .blf, .log, ...)."""
        with can.Logger(file) as log:
            for message in self.messages(since):
                log.on_message_received(message)
        return file

    def report(self) -> BusReport:
        """The hub's own account: load, error states, faults."""
        return self._control.report()

    # -------------------------------------------------------------------------------------------------------------- sending

    def send(self, *messages: can.Message) -> None:
        """Send frames as one more node. `channel` names the channel; without one, the first. Raises ValueError for another."""
        for message in messages:
            if message.channel is not None and message.channel not in self.channels:
                raise ValueError(f"channel {message.channel!r}: expected one of {', '.join(self.channels)}")
        data = b"".join(
            convert.to_record(message, 0 if message.channel is None else self.channels.index(str(message.channel)))
            for message in messages
        )
        self._outbox.append(np.frombuffer(data, frames.RECORD).copy())
        os.eventfd_write(self._wake, 1)

    @contextlib.contextmanager
    def fault(self, kind: str, **fields: Any) -> Iterator[LaidFault]:
        """A fault of hal.can.faults while the block runs, e.g. `bus.fault("drop", node="arm_left_*", probability=0.2)`."""
        laid = self.lay(kind, **fields)
        try:
            yield laid
        finally:
            # A plant that has ended took its faults with it, and one that ended by itself is gone.
            with contextlib.suppress(BusLost, ValueError):
                self._control.clear(laid.number)

    def lay(self, kind: str, **fields: Any) -> LaidFault:
        """The same until `clear`. Raises ValueError naming the field for what is no fault, or a node that is not on the bus."""
        try:
            fault = msgspec.convert({"kind": kind, **fields}, Fault)
        except msgspec.ValidationError as problem:
            known = f"kinds are {', '.join(get_args(Kind))}; fields {', '.join(Fault.__struct_fields__[1:])}"
            raise ValueError(f"fault: {problem}; got { ({'kind': kind, **fields}) }; {known}") from problem
        nodes = sorted({node.name for node in self._control.report().nodes})
        if fault.node is not None and not fnmatch.filter(nodes, fault.node):
            raise ValueError(
                f"fault: node {fault.node!r}: not on the bus; expected a name, or a glob, of {', '.join(nodes)}"
            )
        return LaidFault(self._control, self._control.add(fault), fault)

    def clear(self) -> None:
        """Take back every fault."""
        self._control.clear()

    def cut(self, node: str, **fields: Any) -> contextlib.AbstractContextManager[LaidFault]:
        """The cable of a node (`daemon`, a joint's or device's name) is cut while the block runs."""
        return self.fault("cut", node=node, **fields)

    def close(self) -> None:
        self._closing = True
        self._thread.join(5.0)
        with contextlib.suppress(BusLost, OSError):
            self._control.close()
        self._port.close()
        os.close(self._wake)
