"""The loop with a tape: the same loop, its port and its other inputs wrapped so that all that goes through is written down."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from daemon.actions.motion_maker import MotionMaker
from daemon.controllers.base import Gains, MotionController
from daemon.controllers.workshop import Done, Workshop
from daemon.exchange import CommandReader
from daemon.inputs import Inputs, Stops
from daemon.loop import Loop
from daemon.replay.recorded_loop import LoopStart
from daemon.replay.tape import Kind, TapeWriter, as_words
from daemon.safety.stop_socket import StopRequest
from hal.can.port import Port
from hal.core_pair import CorePair
from hal.hardware import Hardware
from hal.joint import JointState
from handrail.robot.description import RobotDescription
from handrail.robot.kinematics import Kinematics
from handrail.runtime import Runtime

# Plain numbers: an enum's members cost more than the entries.
_RECEIVED, _SENT, _COMMAND, _WAIT = (int(kind) for kind in (Kind.RECEIVED, Kind.SENT, Kind.COMMAND, Kind.WAIT))


def tape_loop(
    description: RobotDescription, clock: str, runtime: Runtime, port: Port
) -> tuple[Any, Callable[..., Loop]]:
    """A port for the loop's hardware, and what makes the loop itself: from now on the runtime folder has its tape."""
    tape = TapeWriter(runtime.tape)
    start = LoopStart.of(description, clock)
    return TapedPort(port, tape), partial(TapedLoop, tape, start)


class TapedLoop(Loop):
    """Make it with hardware whose port is a `TapedPort` of the same tape."""

    def __init__(
        self,
        tape: TapeWriter,
        start: LoopStart,
        hardware: Hardware,
        kinematics: Kinematics,
        lockstep: bool,
        runtime: Runtime,
        core: CorePair | None = None,
    ):
        tape.put(Kind.START, (), as_words(msgspec.json.encode(start)))
        super().__init__(hardware, kinematics, lockstep, runtime, core, TapedInputs(runtime, tape))
        self._tape = tape

    def cycle(self) -> None:
        tape = self._tape
        tape.cycle, tape.time_ns, tape.in_cycle = self.cycles + 1, self.time_ns, True
        super().cycle()
        tape.put(_COMMAND, (self.time_ns, self.late_ns), self.written.memory)
        tape.in_cycle = False

    def skip(self, periods: int) -> None:
        self._tape.put(Kind.SKIP, (periods,))
        super().skip(periods)

    def close(self) -> None:
        self._tape.put(Kind.END)
        self._tape.in_cycle = True
        super().close()


class TapedPort:
    """A port, and a tape of all that goes through it in a cycle; what keeps a plant waiting between two cycles is no command."""

    def __init__(self, port: Port, tape: TapeWriter):
        self._port, self._tape = port, tape
        self.counters = port.counters

    @property
    def refused(self) -> int:
        return self._port.refused

    @property
    def lost(self) -> int:
        return self._port.lost

    @property
    def ticks(self) -> int:
        return getattr(self._port, "ticks", 0)

    def receive(self, timeout_s: float = 0.0) -> npt.NDArray[np.void]:
        records = self._port.receive(timeout_s)
        self._tape.put(_RECEIVED, (self.ticks,), records)
        return records

    def send(self, records: npt.NDArray[np.void]) -> None:
        if self._tape.in_cycle:
            self._tape.put(_SENT, (), records)
        self._port.send(records)

    def fileno(self) -> int:
        return self._port.fileno()

    def close(self) -> None:
        self._port.close()


class TapedInputs(Inputs):
    """The inputs beside the bus."""

    def __init__(self, runtime: Runtime, tape: TapeWriter):
        super().__init__(runtime)
        self._tape = tape
        self.stops = _TapedStops(self.stops, tape)
        self.mailbox = _TapedMailbox(self.mailbox, tape)

    def waits_on(self, patient: bool) -> bool:
        self._tape.put(_WAIT, (int(patient),))
        return patient

    def workshop(self, kinematics: Kinematics, gains: Gains, joints: JointState, period: float, file: Path) -> Workshop:
        return _TapedWorkshop(self._tape, kinematics, gains, joints, period, file)

    def maker(self, kinematics: Kinematics, gains: Gains, period: float, lockstep: bool) -> MotionMaker:
        return _TapedMaker(self._tape, kinematics, gains, period, lockstep)


class _TapedStops:
    def __init__(self, stops: Stops, tape: TapeWriter):
        self._stops, self._tape = stops, tape
        self.fileno, self.waiting, self.close = stops.fileno, stops.waiting, stops.close

    def requests(self) -> Iterator[StopRequest]:
        for request in self._stops.requests():
            reason = request.reason.encode()
            self._tape.put(Kind.STOP, (int(request.stop), len(reason)), as_words(reason))
            yield request


class _TapedMailbox:
    def __init__(self, mailbox: CommandReader, tape: TapeWriter):
        self._mailbox, self._tape = mailbox, tape
        self.done = mailbox.done

    def take(self) -> tuple[np.ndarray, np.ndarray] | None:
        mail = self._mailbox.take()
        if mail is not None:
            self._tape.put(Kind.ORDER, (), *mail)
        return mail


class _TapedWorkshop(Workshop):
    def __init__(self, tape: TapeWriter, *parts: Any):
        super().__init__(*parts)
        self._tape = tape

    def finished(self) -> Done | None:
        done = super().finished()
        if done is not None:
            self._tape.put(Kind.CONTROLLER, (done.slot, int(done.state)))
        return done


class _TapedMaker(MotionMaker):
    def __init__(self, tape: TapeWriter, *parts: Any):
        super().__init__(*parts)
        self._tape = tape

    def take(self, serial: int) -> MotionController | None:
        made = super().take(serial)
        self._tape.put(Kind.MOTION, (serial, int(made is not None)))
        return made
