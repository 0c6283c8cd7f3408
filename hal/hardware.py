"""The robot's drives as one piece of hardware: what the loop reads and writes, whatever carries it.

Drives live by CiA 402. Set-points are written only while every drive is in operation enabled; at any other time the drives are
polled with controlwords that take them, one transition a cycle, to where `goal` says, or keep them there. Limbs that are isolated
are out of this: they are stopped, or on their way back, while the others follow set-points.
"""

from __future__ import annotations

import enum
import time
from collections.abc import Callable, Iterable
from typing import Protocol

import numpy as np
import numpy.typing as npt

from hal.can import frames
from hal.can.port import Port
from hal.device import DeviceCommand, DeviceState
from hal.drives.lifecycle import CONTROLWORD, FOLLOW, Command, State, controlword_towards
from hal.drives.parameters import Parameter, ParameterResult
from hal.drives.protocol import ParameterReply
from hal.drives.watch import LOST_AFTER, DriveWatch
from hal.joint import JointCommand, JointState, Mode
from hal.punctuality import Punctuality
from handrail.robot.description import RobotDescription

_OPERATION_ENABLED = int(State.OPERATION_ENABLED)
_GATHER_S = 0.02
"""wall time that a lock-step read waits for the rest of the replies when some have come"""
_REQUESTS_A_CYCLE, _PATIENCE = 2, 50
"""parameter requests that go out with a cycle's frames until every drive has said who it is; how often one drive is asked"""


class Goal(enum.Enum):
    """Where the drives shall go."""

    INACTIVE = enum.auto()
    """switched off, brakes closed; faults stay as they are, to be seen"""
    OPERATIONAL = enum.auto()
    """operation enabled; faults are reset on the way"""
    QUICK_STOP = enum.auto()
    """quick stop active"""


class DriveProtocol(Protocol):
    """A drive family's frames (hal.drives.protocol.LimbProtocol)."""

    def encode_cycle(
        self,
        command: JointCommand | None,
        controlwords: npt.NDArray[np.uint8],
        devices: DeviceCommand,
        cycle: int,
        sequence: int,
        watchdog: int,
        out: npt.NDArray[np.void],
        some_follow: bool = False,
    ) -> int: ...

    def encode_sync(self, cycle: int, out: npt.NDArray[np.void]) -> int: ...

    def encode_hold_time(self, cycle: int, out: npt.NDArray[np.void]) -> int: ...

    def hear(
        self,
        records: npt.NDArray[np.void],
        n: int,
        state: JointState,
        devices: DeviceState,
        watch: DriveWatch,
        older: int,
    ) -> tuple[int, int]: ...

    def encode_request(
        self, joint: int, index: int, value: float | None, sequence: int, out: npt.NDArray[np.void]
    ) -> int: ...

    def replies(self) -> list[ParameterReply]: ...

    @property
    def reply_count(self) -> int: ...

    @property
    def frames_a_cycle(self) -> int: ...

    @property
    def protocol_version(self) -> npt.NDArray[np.int64]: ...

    def quantise(self, command: JointCommand) -> JointCommand: ...


class Hardware:
    """All drives and devices of one robot. Arrays have one row a joint (or device) in the description's order."""

    def __init__(self, description: RobotDescription, port: Port, protocol: DriveProtocol):
        n, d = len(description.joints), len(description.devices)
        self.state, self.devices = JointState(n), DeviceState(d)
        """what was last read"""
        self.device_command = DeviceCommand(d)
        """what devices are told: those of them that are `commanded`, whatever the drives do"""
        self.protocol_version, self.firmware_version = np.full(n, np.nan), np.full(n, np.nan)
        """what each drive says of itself once it was heard; NaN: not yet, or its family can't"""
        self.identities = 0
        """goes up whenever those may have changed"""
        self.goal = Goal.INACTIVE
        self.crc_errors = 0
        """replies whose CRC was wrong, since the start"""
        self.stale_replies = 0
        """replies that came later than their channel's usually do (hal.punctuality), since the start"""
        self.bus_time_ns = 0
        """when the first of the last replies came, on the clock of whoever runs the bus"""
        self.counters = port.counters
        """(channels, 3) int64: frames sent, frames received, ns of bus time in use"""
        self.waits_on: Callable[[bool], bool] = lambda patient: patient
        """asked whether to wait on for late replies, where the wall clock says so: what is read may rest on it"""
        self._watch = watch = DriveWatch(n)
        self.isolated = watch.isolated
        """(n,) joints of limbs that are out of the robot; whole limbs only (`isolate`, `rejoin`)"""
        self.returning = False
        """isolated limbs are on their way back"""
        self._some_isolated = False
        self._port, self._protocol = port, protocol
        self._watchdog = description.watchdog_cycles
        self._sequence = 0
        self._asked = False
        self._ticks_due = 0
        self._controlwords = np.zeros(n, np.uint8)
        self._drive_state, self._nothing = watch.state, frames.empty(0)
        self._identified, self._asked_for = False, np.zeros(n, np.int64)
        self._says_version = protocol.protocol_version > 0
        self._stranger = self._unknown = -1
        channels = [channel.name for channel in description.channels]
        of_joint = {joint: channels.index(limb.channel) for limb in description.limbs for joint in limb.joints}
        self._punctuality = Punctuality([of_joint[joint] for joint in description.joints], len(channels), LOST_AFTER)
        self._hear(self._nothing, 0)
        self._out = frames.empty(protocol.frames_a_cycle)
        self._batches = [self._out[:count] for count in range(len(self._out) + 1)]

    def representable_gains(
        self, stiffness: npt.NDArray[np.float64], damping: npt.NDArray[np.float64]
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """The stiffness and damping (n,) nearest to these that the drives can be told, so that host and drives compute alike."""
        command = JointCommand(len(stiffness))
        command.stiffness[:], command.damping[:], command.mode[:] = stiffness, damping, Mode.IMPEDANCE
        seen = self._protocol.quantise(command)
        return seen.stiffness.copy(), seen.damping.copy()

    def largest_command(self) -> JointCommand:
        """The largest set-points that the drives can be told (velocity, torque, stiffness, damping): more saturates there."""
        command = JointCommand(len(self.state))
        command.table[1:] = 1e100
        command.mode[:] = Mode.IMPEDANCE
        largest = JointCommand(len(self.state))
        largest.copy_from(self._protocol.quantise(command))
        return largest

    @property
    def drive_state(self) -> npt.NDArray[np.uint8]:
        """(n,) hal.drives.lifecycle.State of each drive."""
        return self._drive_state

    @property
    def operational(self) -> bool:
        """Every drive answers and is in operation enabled, those of isolated limbs aside."""
        return self._watch.lost < 0

    def first_lost(self) -> int:
        """Row of the first drive that does not answer, or is not in operation enabled, those of isolated limbs aside; −1: none."""
        return self._watch.lost

    def lost(self) -> npt.NDArray[np.bool_]:
        """(n,) drives that do not answer, or are not in operation enabled."""
        return (self.state.age > LOST_AFTER) | (self._drive_state != _OPERATION_ENABLED)

    def isolate(self, joints: npt.NDArray[np.bool_]) -> None:
        """Take just these joints (n,), whole limbs, out of the robot: their drives quick-stop and stay so, the others go on."""
        self.isolated[:] = joints
        self._some_isolated, self.returning = bool(joints.any()), False
        self._hear(self._nothing, 0)

    def rejoin(self) -> None:
        """Take the isolated limbs' drives to operation enabled, faults reset on the way; `returned` says when they are there."""
        self.returning = True

    @property
    def returned(self) -> bool:
        """Every drive, of isolated limbs too, answers and is in operation enabled."""
        return not self.lost().any()

    def first_silent(self) -> int:
        """Row of the first drive that does not answer; −1: all do."""
        return self._watch.silent

    def first_stranger(self) -> int:
        """Row of the first drive that says that it speaks another version of its family's protocol; −1: none does."""
        return self._stranger

    def first_unknown(self) -> int:
        """Row of the first drive that was asked for that version often and in vain; −1: none was."""
        return self._unknown

    @property
    def acquainted(self) -> bool:
        """Every drive whose family has a protocol version has said which one it speaks."""
        return not (self._says_version & np.isnan(self.protocol_version)).any()

    def expected_protocol_version(self, joint: int) -> int:
        """The version that a joint's drive must speak; 0: its family has none."""
        return int(self._protocol.protocol_version[joint])

    def read(self, wait_s: float = 0.0) -> bool:
        """Take in the replies that have arrived, once a cycle.

        `wait_s` > 0 (lock-step): wait at most so long for the plant's word that the cycle is over, or where nobody gives it
        (hal.can.frames.TICK) for the first reply to what was last written, then for those of all drives that are not lost.
        False when nothing came: call again, or `give_up`. Raises hal.can.port.BusLost.
        """
        if not self._asked:
            return True
        watch = self._watch
        good = self._receive(wait_s, older=1)
        if wait_s > 0.0 and (watch.late or not good) and not self._wait_for_late(good, wait_s):
            return False
        if watch.late or self._punctuality.behind:
            self.stale_replies += self._punctuality.late(self.state.age, watch.late > 0)
        return True

    def _wait_for_late(self, good: int, wait_s: float) -> bool:
        """Wait on for replies that are not there yet, where `good` ones have come. False when none has."""
        watch = self._watch
        if watch.late:
            good += self._receive(0.0)  # behind the word that a cycle is over, if that was an earlier one
        # A plant that has once told when its cycles end always does: what is not there by then will not come.
        told = self._ticks > 0
        gives_up = time.monotonic() + wait_s
        while told and watch.late and self._ticks < self._ticks_due and self.waits_on(time.monotonic() < gives_up):
            good += self._receive(wait_s)
        if not good and not (told and self._ticks >= self._ticks_due):
            self._hear(self._nothing, -1)
            return False
        while watch.late and not told and self._receive(_GATHER_S):
            pass
        if watch.late and told and self._ticks < self._ticks_due:
            self._ticks_due = self._ticks  # a word of the plant's was lost: count anew
        return True

    def give_up(self) -> None:
        """Nobody answered for so long that every drive counts as lost."""
        self.state.age += LOST_AFTER + 1
        self._hear(self._nothing, 0)

    @property
    def _ticks(self) -> int:
        """How often a plant in lock-step said that a cycle is over; only the virtual bus carries that."""
        return getattr(self._port, "ticks", 0)

    def _receive(self, wait_s: float, older: int = 0) -> int:
        """Take in what has arrived, while what was read before has become `older` cycles older; replies that were good."""
        good = self._hear(self._port.receive(wait_s), older)
        if self._protocol.reply_count:  # a tool may have asked, too
            self._take_identities(self._protocol.replies())
        return good

    def _hear(self, records: npt.NDArray[np.void], older: int) -> int:
        """Take these in, and look at every drive's age and status; replies that were good."""
        good, bad = self._protocol.hear(records, len(records), self.state, self.devices, self._watch, older)
        self.crc_errors += bad
        if self._watch.heard_ns:
            self.bus_time_ns = self._watch.heard_ns
        if self._watch.silent >= 0:  # whoever answers there later may be another drive
            self._forget_identities()
        return good

    def write(self, command: JointCommand | None, cycle: int) -> None:
        """Write one cycle's frames and Sync, as one datagram where the bus takes one.

        `command`: set-points of all joints, written only while `operational`; None: nobody commands the robot.
        """
        self._sequence = (self._sequence + 1) & 0xFF
        out = self._out
        if command is not None and not (self.goal is Goal.OPERATIONAL and self.operational):
            command = None
        some_follow = command is not None and self._some_isolated
        if command is None:
            self._next_controlwords()
        elif some_follow:
            self._controlwords_of_isolated()
        count = self._protocol.encode_cycle(
            command, self._controlwords, self.device_command, cycle, self._sequence, self._watchdog, out, some_follow
        )
        if not self._identified:  # Sync goes last
            count -= len(self.counters)
            count += self._ask_who(out[count:], cycle)
            count += self._protocol.encode_sync(cycle, out[count:])
        # More words than cycles: another process's Sync moved the plant, too. The next word is this cycle's.
        self._ticks_due = max(self._ticks_due, self._ticks) + 1
        self._port.send(self._batches[count])
        self._asked = True

    def hold_time(self, cycle: int) -> None:
        """Keep a plant in lock-step from running free while time is held."""
        self._port.send(self._batches[self._protocol.encode_hold_time(cycle, self._out)])

    def close(self) -> None:
        """Leave the buses; the drives' watchdogs do the rest."""
        self._port.close()

    def _ask_who(self, out: npt.NDArray[np.void], cycle: int) -> int:
        """Ask some of the drives that are there for the versions that are not known yet; frames written.

        Who has never said its protocol version is asked on after `_PATIENCE` times, but seldom: it may have been updated.
        """
        unknown = self._says_version & np.isnan(self.protocol_version)
        due = unknown | (self._says_version & np.isnan(self.firmware_version))
        due &= (self._asked_for < _PATIENCE) | (unknown & (cycle % _PATIENCE == 0))
        self._identified = not unknown.any() and not due.any() and self._watch.silent < 0
        rows = np.flatnonzero(due & (self.state.age < LOST_AFTER))
        count = 0
        for row in rows[np.argsort(self._asked_for[rows], kind="stable")][:_REQUESTS_A_CYCLE].tolist():
            known = not np.isnan(self.protocol_version[row])
            index = Parameter.FIRMWARE_VERSION if known else Parameter.PROTOCOL_VERSION
            self._asked_for[row] += 1
            count += self._protocol.encode_request(row, index, None, self._sequence, out[count:])
        self._look_at_identities()
        return count

    def _take_identities(self, replies: Iterable[ParameterReply]) -> None:
        known = {
            int(Parameter.PROTOCOL_VERSION): self.protocol_version,
            int(Parameter.FIRMWARE_VERSION): self.firmware_version,
        }
        for reply in replies:
            if reply.index in known and reply.result == ParameterResult.OK:
                known[reply.index][reply.joint] = reply.value
        self._look_at_identities()

    def _look_at_identities(self) -> None:
        """After whatever may have changed them, so that no cycle has to look."""
        self.identities += 1
        versions, expected = self.protocol_version, self._protocol.protocol_version
        self._stranger = _first(self._says_version & ~np.isnan(versions) & (versions != expected))
        self._unknown = _first(self._says_version & np.isnan(versions) & (self._asked_for >= _PATIENCE))

    def _forget_identities(self) -> None:
        gone = self.state.age > LOST_AFTER
        self.protocol_version[gone] = self.firmware_version[gone] = np.nan
        self._asked_for[gone] = 0
        self._identified = False
        self._look_at_identities()

    def _next_controlwords(self) -> None:
        words, state = self._controlwords, self._drive_state
        match self.goal:
            case Goal.INACTIVE:
                words[:] = CONTROLWORD[Command.DISABLE_VOLTAGE]
            case Goal.QUICK_STOP:
                words[:] = CONTROLWORD[Command.QUICK_STOP]
            case Goal.OPERATIONAL:
                # No brake opens before every drive is ready to: a robot never stands with half of its joints held.
                ready = ((state == State.SWITCHED_ON) | (state == State.OPERATION_ENABLED)).all()
                rung = State.OPERATION_ENABLED if ready else State.SWITCHED_ON
                words[:] = controlword_towards(rung, state, words)

    def _controlwords_of_isolated(self) -> None:
        """Theirs alone: the others follow."""
        out, state = self.isolated, self._drive_state[self.isolated]
        if self.returning:
            ready = ((state == State.SWITCHED_ON) | (state == State.OPERATION_ENABLED)).all()
            rung = State.OPERATION_ENABLED if ready else State.SWITCHED_ON
            self._controlwords[out] = controlword_towards(rung, state, self._controlwords[out])
        else:
            self._controlwords[out] = CONTROLWORD[Command.QUICK_STOP]
        self._controlwords[~out] = FOLLOW


def _first(rows: npt.NDArray[np.bool_]) -> int:
    """The first row that is set; −1: none is."""
    return int(np.argmax(rows)) if rows.any() else -1
