"""The robot's drives as one piece of hardware: what the loop reads and writes, whatever carries it.

Drives live by CiA 402. Set-points are written only while every drive is in operation enabled; at any other time the drives are
polled with controlwords that take them, one transition a cycle, to where `goal` says, or keep them there.
"""

from __future__ import annotations

import enum
import time
from typing import Protocol

import numpy as np
import numpy.typing as npt
from numba import njit

from hal.can import frames
from hal.can.port import Port
from hal.device import DeviceCommand, DeviceState
from hal.drives.lifecycle import CONTROLWORD, STATE_OF_STATUSWORD, Command, State, controlword_towards
from hal.joint import JointCommand, JointState
from handrail.robot.description import RobotDescription

LOST_AFTER = 50
"""cycles without an answer after which a drive counts as lost. More than the drives' own watchdog (20 cycles): where the host is
not heard, they have stopped by themselves by then; where only it does not hear, they go on following it meanwhile"""

_NEVER = 1 << 30
"""cycles; the age of a reply that never came grows no further"""
_OPERATION_ENABLED = int(State.OPERATION_ENABLED)
_GATHER_S = 0.02
"""wall time that a lock-step read waits for the rest of the replies when some have come"""


class Goal(enum.Enum):
    """Where the drives shall go."""

    INACTIVE = enum.auto()
    """switched off, brakes closed; faults stay as they are, to be seen"""
    OPERATIONAL = enum.auto()
    """operation enabled; faults are reset on the way"""
    QUICK_STOP = enum.auto()
    """quick stop active"""


class DriveProtocol(Protocol):
    """A drive family's frames (hal.drives.limb_fd.LimbProtocol)."""

    def encode_commands(
        self, command: JointCommand, sequence: int, watchdog: int, out: npt.NDArray[np.void]
    ) -> int: ...

    def encode_control(self, controlwords: npt.NDArray[np.uint8], sequence: int, out: npt.NDArray[np.void]) -> int: ...

    def encode_sync(self, cycle: int, out: npt.NDArray[np.void]) -> int: ...

    def encode_hold_time(self, cycle: int, out: npt.NDArray[np.void]) -> int: ...

    def decode_status(self, records: npt.NDArray[np.void], n: int, state: JointState) -> tuple[int, int]: ...

    def quantise(self, command: JointCommand) -> JointCommand: ...


class Hardware:
    """All drives of one robot. Arrays have one row a joint in the description's order."""

    def __init__(self, description: RobotDescription, port: Port, protocol: DriveProtocol):
        n = len(description.joints)
        self.state = JointState(n)
        """what was last read"""
        self.devices = DeviceState(len(description.devices))
        """what the nodes that are no joints measured last"""
        self.device_command = DeviceCommand(len(description.devices))
        """what is written to those of them that are commanded, with the next `write`"""
        self.goal = Goal.INACTIVE
        self.crc_errors = 0
        """replies whose CRC was wrong, since the start"""
        self.stale_replies = 0
        """replies that were not there in the cycle after their command, since the start"""
        self.bus_time_ns = 0
        """when the first of the last replies came, on the clock of whoever runs the bus"""
        self.counters = port.counters
        """(channels, 3) int64: frames sent, frames received, ns of bus time in use"""
        self._port, self._protocol = port, protocol
        self._watchdog = description.watchdog_cycles
        self._sequence = 0
        self._asked = False
        self._ticks_due = 0
        self._controlwords = np.zeros(n, np.uint8)
        self._drive_state = np.zeros(n, np.uint8)
        self._lost = self._silent = 0
        self._survey()
        self._out = frames.empty(len(description.limbs) + len(description.channels))

    def representable_gains(
        self, stiffness: npt.NDArray[np.float64], damping: npt.NDArray[np.float64]
    ) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
        """The stiffness and damping (n,) nearest to these that the drives can be told, so that host and drives compute alike."""
        command = JointCommand(len(stiffness))
        command.stiffness[:], command.damping[:] = stiffness, damping
        seen = self._protocol.quantise(command)
        return seen.stiffness.copy(), seen.damping.copy()

    @property
    def drive_state(self) -> npt.NDArray[np.uint8]:
        """(n,) hal.drives.lifecycle.State of each drive."""
        return self._drive_state

    @property
    def operational(self) -> bool:
        """Every drive answers and is in operation enabled."""
        return self._lost < 0

    def first_lost(self) -> int:
        """Row of the first drive that does not answer, or is not in operation enabled; −1: all are."""
        return self._lost

    def first_silent(self) -> int:
        """Row of the first drive that does not answer; −1: all do."""
        return self._silent

    def read(self, wait_s: float = 0.0) -> bool:
        """Take in the replies that have arrived, once a cycle.

        `wait_s` > 0 (lock-step): wait at most so long for the plant's word that the cycle is over, or where nobody gives it
        (hal.can.frames.TICK) for the first reply to what was last written, then for those of all drives that are not lost.
        False when nothing came: call again, or `give_up`. Raises hal.can.port.BusLost.
        """
        if not self._asked:
            return True
        self.state.age += 1
        good = self._receive(wait_s)
        late = self._survey()
        if wait_s > 0.0 and late:
            # A plant that has once told when its cycles end always does: what is not there by then will not come.
            told = self._ticks > 0
            gives_up = time.monotonic() + wait_s
            while told and late and self._ticks < self._ticks_due and time.monotonic() < gives_up:
                good += self._receive(wait_s)
                late = self._survey()
            if not good and not (told and self._ticks >= self._ticks_due):
                self.state.age -= 1
                return False
            while late and not told and self._receive(_GATHER_S):
                late = self._survey()
            if late and told and self._ticks < self._ticks_due:
                self._ticks_due = self._ticks  # a word of the plant's was lost: count anew
        self.stale_replies += late
        return True

    def give_up(self) -> None:
        """Nobody answered for so long that every drive counts as lost."""
        self.state.age += LOST_AFTER + 1
        self._survey()

    @property
    def _ticks(self) -> int:
        """How often a plant in lock-step said that a cycle is over; only the virtual bus carries that."""
        return getattr(self._port, "ticks", 0)

    def _receive(self, wait_s: float) -> int:
        """Take in what has arrived; replies that were good."""
        records = self._port.receive(wait_s)
        if not len(records):
            return 0
        self.bus_time_ns = int(records["time_ns"][0])
        good, bad = self._protocol.decode_status(records, len(records), self.state)
        self.crc_errors += bad
        return good

    def _survey(self) -> int:
        """Look at every drive's age and status; drives whose reply is late but that are not lost."""
        state = self.state
        late, self._lost, self._silent = _survey(state.age, state.status, STATE_OF_STATUSWORD, self._drive_state)
        return late

    def write(self, command: JointCommand | None, cycle: int) -> None:
        """Write one cycle's frames and Sync, as one datagram where the bus takes one.

        `command`: set-points of all joints, written only while `operational`; None: nobody commands the robot.
        """
        self._sequence = (self._sequence + 1) & 0xFF
        out = self._out
        if command is not None and self.goal is Goal.OPERATIONAL and self.operational:
            count = self._protocol.encode_commands(command, self._sequence, self._watchdog, out)
        else:
            self._next_controlwords()
            count = self._protocol.encode_control(self._controlwords, self._sequence, out)
        count += self._protocol.encode_sync(cycle, out[count:])
        self._ticks_due += 1
        self._port.send(out[:count])
        self._asked = True

    def hold_time(self, cycle: int) -> None:
        """Keep a plant in lock-step from running free while time is held."""
        self._port.send(self._out[: self._protocol.encode_hold_time(cycle, self._out)])

    def close(self) -> None:
        """Leave the buses; the drives' watchdogs do the rest."""
        self._port.close()

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


@njit(cache=True)
def _survey(age, status, state_of_statusword, drive_state):  # type: ignore[no-untyped-def]
    """Fill `drive_state`; (drives whose reply is late but not yet lost, first lost, first silent), −1: none."""
    stale, lost, silent = 0, -1, -1
    for j in range(age.shape[0]):
        drive_state[j] = state_of_statusword[status[j] & 0x7F]
        age[j] = min(age[j], _NEVER)
        if age[j] > LOST_AFTER:
            silent = j if silent < 0 else silent
        elif age[j] > 0:
            stale += 1
        if lost < 0 and (age[j] > LOST_AFTER or drive_state[j] != _OPERATION_ENABLED):
            lost = j
    return stale, lost, silent
