"""Replay: the same loop and controllers, driven by what a loop took in when it was recorded, cycle for cycle in lock-step.

Nothing is waited for but what is made beside the loop, and nothing moves: what the loop commands is compared, bit for bit, with
what it commanded then. As long as that is the same, the replayed loop is in the recorded one's state.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from daemon.actions.motion_maker import MotionMaker
from daemon.controllers.base import Gains, MotionController
from daemon.controllers.workshop import Done, Workshop
from daemon.exchange import ControllerState
from daemon.inputs import Inputs
from daemon.loop import Loop
from daemon.replay.recorded_loop import Cycle
from daemon.safety.stop_socket import StopRequest
from hal.can import frames
from hal.drives.protocol import DriveTargets, LimbProtocol
from hal.hardware import Hardware
from hal.joint import COMMANDED, JointCommand, JointState, Mode
from handrail.robot.kinematics import Kinematics
from handrail.runtime import Runtime

MAKING_S = 300.0
"""s of wall time that a controller may take to be made: where nothing was compiled yet, minutes"""


@dataclass(frozen=True)
class Difference:
    """The first command, or other thing that the loop did, that is another one than was recorded."""

    cycle: int
    time_ns: int
    """of the robot's clock"""
    node: str
    """joint, device, channel, or part of the loop"""
    field: str
    recorded: str
    replayed: str
    more: int = 0
    """of its fields and other joints' that differ in this cycle"""


class Replay:
    """A loop that is told again what another one took in."""

    def __init__(self, kinematics: Kinematics, lockstep: bool, folder: Path):
        """`folder`: of this replay's own, where the loop's shared memory lies meanwhile."""
        self._description = description = kinematics.description
        self._protocol = LimbProtocol(description)
        self._port, runtime = _FedPort(len(description.channels)), Runtime.at(folder)
        self._inputs = _FedInputs(self._port)
        hardware = Hardware(description, self._port, self._protocol)
        self.loop = Loop(hardware, kinematics, lockstep, runtime, inputs=self._inputs)
        self.compared = 0
        """cycles in which what it commanded was"""
        self._closed = False

    def run(self, recorded: Iterable[Cycle]) -> Difference | None:
        """Replay these cycles, from the loop's first on, up to the first difference; None: there is none."""
        for cycle in recorded:
            if cycle.command is None:  # the recording breaks off before it was known what it would command
                break
            if (found := self._run(cycle)) is not None:
                return found
        return None

    def close(self) -> None:
        """End the loop, if it has not come to the recorded one's end."""
        if not self._closed:
            self._closed = True
            self._port.feed(())
            self.loop.close()

    def _run(self, cycle: Cycle) -> Difference | None:
        loop, inputs, port = self.loop, self._inputs, self._port
        if not loop.lockstep:
            loop.time_ns = cycle.time_ns
        port.feed(cycle.received)
        inputs.feed(cycle)
        loop.cycle()
        found = self._unlike_made(cycle) or self._unlike_command(cycle) or self._unlike_frames(cycle, cycle.sent)
        if found is not None:
            return found
        self.compared += 1
        for then in cycle.then:
            if then.stop is not None:
                inputs.stops.told.append((0, then.stop))
                loop.serve_stop()
            elif then.order is not None:
                inputs.mailbox.told.append(then.order)
                loop.orders.serve(loop.written, loop.time_ns)
            else:
                loop.skip(then.skipped)
        if cycle.last_sent is None:
            return None
        self.close()
        return self._unlike_frames(cycle, cycle.last_sent)

    def _unlike_made(self, cycle: Cycle) -> Difference | None:
        if not self._inputs.unlike:
            return None
        node, field, then, now = self._inputs.unlike[0]
        return Difference(cycle.number, self.loop.time_ns, node, field, then, now)

    def _unlike_command(self, cycle: Cycle) -> Difference | None:
        """The set-points as the loop decided on them, before they are rounded to what the bus carries."""
        assert cycle.command is not None
        replayed = self.loop.written
        if np.array_equal(cycle.command, replayed.memory.view(np.uint64)):
            return None
        recorded = JointCommand(len(replayed))
        recorded.memory[...] = cycle.command.view(np.int64)
        return self._unlike_set_points(cycle, recorded, replayed)

    def _unlike_set_points(self, cycle: Cycle, recorded: JointCommand, replayed: JointCommand) -> Difference | None:
        unlike = recorded.table.view(np.uint64) != replayed.table.view(np.uint64)
        modes = recorded.mode != replayed.mode
        places = np.argwhere(np.vstack([unlike, modes]).T)
        if not len(places):
            return None
        joint, row = places[0].tolist()
        name = self._description.joints[joint]
        if row < len(COMMANDED):
            field, then, now = COMMANDED[row], *(_number(each.table[row, joint]) for each in (recorded, replayed))
        else:
            field, then, now = "mode", *(Mode(int(each.mode[joint])).name.lower() for each in (recorded, replayed))
        return Difference(cycle.number, self.loop.time_ns, name, field, then, now, len(places) - 1)

    def _unlike_frames(self, cycle: Cycle, sent: list[npt.NDArray[np.void]]) -> Difference | None:
        """What went out on the bus: set-points as the drives read them, controlwords, what devices and parameters are told."""
        recorded, replayed = _joined(sent), _joined(self._port.sent)
        if recorded.tobytes() == replayed.tobytes():
            return None
        n, d = len(self._description.joints), len(self._description.devices)
        heard = [DriveTargets(n, d), DriveTargets(n, d)]
        for batch, targets in zip((recorded, replayed), heard, strict=True):
            self._protocol.decode(batch, len(batch), targets, check_sequence=False)
        if found := self._unlike_set_points(cycle, heard[0].command, heard[1].command):
            return found
        for what in ("controlword", "commanded"):
            words = [getattr(targets, what) for targets in heard]
            for row in np.flatnonzero(words[0] != words[1]).tolist():
                then, now = (str(each[row]) for each in words)
                return Difference(cycle.number, self.loop.time_ns, self._description.joints[row], what, then, now)
        values = [targets.devices.values for targets in heard]
        for row, column in np.argwhere(values[0].view(np.uint64) != values[1].view(np.uint64)).tolist():
            then, now = (_number(each[row, column]) for each in values)
            name = self._description.devices[row].name
            return Difference(cycle.number, self.loop.time_ns, name, f"column {column} of its command", then, now)
        return self._unlike_bytes(cycle, recorded, replayed)

    def _unlike_bytes(self, cycle: Cycle, recorded: npt.NDArray[np.void], replayed: npt.NDArray[np.void]) -> Difference:
        """Where nothing that drives and devices obey differs: the first frame that does, as it is."""
        both = min(len(recorded), len(replayed))
        row = next((row for row in range(both) if recorded[row].tobytes() != replayed[row].tobytes()), both)
        then, now = (_frame(each[row]) if row < len(each) else "no such frame" for each in (recorded, replayed))
        first = (recorded if row < len(recorded) else replayed)[row]
        channel = self._description.channels[int(first["bus"])].name
        return Difference(cycle.number, self.loop.time_ns, f"channel {channel}", f"frame {row + 1}", then, now)


class _FedPort:
    """A bus on which frames come as they came then, look by look."""

    def __init__(self, channels: int):
        self.counters = np.zeros((channels, 3), np.int64)
        self.refused = self.lost = self.ticks = self.looked = 0
        self.sent: list[npt.NDArray[np.void]] = []
        self._nothing = frames.empty(0)
        self._waiting: deque[tuple[int, npt.NDArray[np.void]]] = deque()

    def feed(self, received: Iterable[tuple[int, npt.NDArray[np.void]]]) -> None:
        """What the next cycle shall find."""
        self._waiting, self.looked = deque(received), 0
        self.sent.clear()

    def receive(self, timeout_s: float = 0.0) -> npt.NDArray[np.void]:
        self.looked += 1
        if not self._waiting:
            return self._nothing
        self.ticks, records = self._waiting.popleft()
        return records

    def send(self, records: npt.NDArray[np.void]) -> None:
        self.sent.append(records.copy())

    def fileno(self) -> int:
        return -1

    def close(self) -> None:
        pass


class _FedInputs(Inputs):
    """What came beside the bus, in the cycle in which it came."""

    stops: _FedStops
    mailbox: _FedMailbox

    def __init__(self, port: _FedPort):
        self.stops, self.mailbox = _FedStops(port), _FedMailbox()
        self.controllers: deque[tuple[int, ControllerState]] = deque()
        self.motions: deque[bool] = deque()
        self._waits: deque[bool] = deque()
        self.unlike: list[tuple[str, str, str, str]] = []
        """what was made beside the loop and is not what was made then: node, field, recorded, replayed"""

    def feed(self, cycle: Cycle) -> None:
        """What the next cycle shall find. What the one before did not ask for still lies there."""
        self.stops.told += cycle.stops
        self.mailbox.told += cycle.orders
        self.controllers += cycle.controllers
        self.motions += cycle.motions
        self._waits = deque(cycle.waits)

    def waits_on(self, patient: bool) -> bool:
        return self._waits.popleft() if self._waits else False

    def workshop(self, kinematics: Kinematics, gains: Gains, joints: JointState, period: float, file: Path) -> Workshop:
        return _FedWorkshop(self, kinematics, gains, joints, period, file)

    def maker(self, kinematics: Kinematics, gains: Gains, period: float, lockstep: bool) -> MotionMaker:
        return _FedMaker(self, kinematics, gains, period, True)


class _FedStops:
    def __init__(self, port: _FedPort):
        self.told: deque[tuple[int, StopRequest]] = deque()
        """how often the bus had been looked at in its cycle before it came"""
        self._port = port

    def fileno(self) -> int:
        return -1

    def waiting(self) -> bool:
        return bool(self.told) and self.told[0][0] <= self._port.looked

    def requests(self) -> Iterator[StopRequest]:
        while self.waiting():
            yield self.told.popleft()[1]

    def close(self) -> None:
        pass


class _FedMailbox:
    def __init__(self) -> None:
        self.told: deque[tuple[np.ndarray, np.ndarray]] = deque()

    def take(self) -> tuple[np.ndarray, np.ndarray] | None:
        return self.told[0] if self.told else None

    def done(self) -> None:
        self.told.popleft()


class _FedWorkshop(Workshop):
    """Controllers are made anew, by the code of now; they are there in the cycle in which they were."""

    def __init__(self, inputs: _FedInputs, *parts: Any):
        super().__init__(*parts)
        self._inputs = inputs

    def finished(self) -> Done | None:
        if not self._inputs.controllers:
            return None
        slot, state = self._inputs.controllers.popleft()
        done = self.wait(MAKING_S)
        if done is None:
            self._inputs.unlike.append((f"controller {slot}", "state", state.name.lower(), "not made yet"))
        elif (done.slot, done.state) != (slot, state):
            told = f"{done.state.name.lower()}: {self.error(done.name)}".removesuffix(": ")
            self._inputs.unlike.append((f"controller {done.name or slot}", "state", state.name.lower(), told))
        return done


class _FedMaker(MotionMaker):
    """The same for the controllers of whole-body motions."""

    def __init__(self, inputs: _FedInputs, *parts: Any):
        super().__init__(*parts)
        self._inputs = inputs

    def take(self, serial: int) -> MotionController | None:
        made, was_there = super().take(serial), self._inputs.motions.popleft() if self._inputs.motions else True
        if was_there and made is None:
            self._inputs.unlike.append((f"motion {serial}", "controller", "made", "can't be made"))
        return made if was_there else None


def _number(value: float) -> str:
    """A float64, such that no other one is written alike."""
    return repr(float(value)) if not math.isnan(value) else f"nan (bits {np.float64(value).view(np.uint64):#x})"


def _frame(record: np.void) -> str:
    return f"{int(record['can_id']):#05x} {bytes(record['data'][: int(record['length'])]).hex(' ')}"


def _joined(batches: list[npt.NDArray[np.void]]) -> npt.NDArray[np.void]:
    return np.concatenate(batches) if batches else frames.empty(0)
