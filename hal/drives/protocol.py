"""A robot's frames, host side and drive side, whatever families its limbs and devices are of: batches of frames against arrays.

What a frame says comes from the families' folders (hal.drives.family); here joints and devices meet them. A robot may mix
families from limb to limb.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from hal.can import frames
from hal.device import DeviceCommand, DeviceState
from hal.drives import kernels
from hal.drives.fields import ENTITY, Field, Role
from hal.drives.parameters import ParameterResult
from hal.drives.program import Program
from hal.joint import JointCommand, JointState

_PARAMETER_COLUMNS = 8
_REPLIES = 3


@dataclass(frozen=True)
class ParameterRequest:
    """A ParameterRequest that a drive received."""

    joint: int
    index: int
    write: bool
    sequence: int
    value: float


@dataclass(frozen=True)
class ParameterReply:
    """A ParameterReply that the host received."""

    joint: int
    index: int
    write: bool
    sequence: int
    result: int
    """a ParameterResult, or a number that only this drive knows"""
    value: float


class DriveTargets:
    """What drives and devices were told by the frames of one `LimbProtocol.decode`; arrays have one row a joint (or device)."""

    def __init__(self, n: int, devices: int = 0):
        self.command = JointCommand(n)
        """Last set-points received; stiffness N·m/rad, damping N·m·s/rad as quantised on the bus."""
        self.flags = np.zeros((6, n), np.uint8)
        self.commanded = self.flags[kernels.COMMANDED].view(np.bool_)
        """a command came in this batch"""
        self.controlled = self.flags[kernels.CONTROLLED].view(np.bool_)
        """a controlword came in this batch"""
        self.controlword = self.flags[kernels.WORD]
        """Last CiA 402 controlword received, low byte (hal.drives.lifecycle)."""
        self.sequence = self.flags[kernels.ECHO]
        """Sequence number of the last frame received, to be echoed."""
        self.watchdog = self.flags[kernels.WATCHDOG]
        """Host cycles without a command until quick stop, as last commanded; 0: the drive's own."""
        self.devices = DeviceCommand(devices)
        """Last commands received; `commanded`: one came in this batch"""
        self.device_flags = np.zeros((6, devices), np.uint8)
        self.devices.commanded = self.device_flags[kernels.COMMANDED].view(np.bool_)
        self.device_watchdog = self.device_flags[kernels.WATCHDOG]
        """Host cycles without a command until the device is disabled, as last commanded; 0: never."""
        self.parameters = np.zeros((kernels.MOST_REQUESTS + 1, _PARAMETER_COLUMNS), np.int64)
        self.host = self.parameters[kernels.MOST_REQUESTS]

    @property
    def answer(self) -> npt.NDArray[np.bool_]:
        """(n,) the drives that owe an answer for this batch."""
        return self.commanded | self.controlled

    @property
    def syncs(self) -> int:
        """Sync frames on channel 0 in this batch."""
        return int(self.host[kernels.SYNCS])

    @property
    def cycle(self) -> int:
        """The host's cycle counter in the last Sync or HoldTime seen on channel 0."""
        return int(self.host[kernels.CYCLE])

    @property
    def holds(self) -> int:
        """HoldTime frames on channel 0 in this batch."""
        return int(self.host[kernels.HOLDS])

    @property
    def repeated(self) -> int:
        """Commands so far that counted for nothing, since their sequence number did not go on."""
        return int(self.host[kernels.REPEATED])


class LimbProtocol:
    """Encodes and decodes for one robot. Frame arrays are hal.can.frames.RECORD; `out` needs room for `frames_a_cycle`."""

    def __init__(self, description: Any):
        """`description`: a RobotDescription: joints, channels, limbs, devices.

        Raises ValueError naming the limb or device whose number, channel, joints or family the network can't carry.
        """
        self.program = program = Program(description)
        self.joints = tuple(description.joints)
        self.devices = tuple(device.name for device in description.devices)
        n, d = len(self.joints), len(self.devices)
        self._code = program.code
        self._command, self._control = program.span(Role.COMMAND), program.span(Role.CONTROL)
        self._sync, self._hold = program.span(Role.SYNC), program.span(Role.HOLD_TIME)
        # Limbs that answer by themselves and limbs whose masters do are neighbours in the program.
        self._status = program.span(Role.STATUS), program.span(Role.MASTER_STATUS)
        self._device_command, self._device_status = program.span(Role.DEVICE_COMMAND), program.span(Role.DEVICE_STATUS)
        self._requests, self._replies = program.span(Role.PARAMETER_REQUEST), program.span(Role.PARAMETER_REPLY)
        self._clocks = np.full(n + d, np.nan)
        self._sent = -1
        self._parameters = np.zeros((kernels.MOST_REQUESTS + 1, _PARAMETER_COLUMNS), np.int64)
        self._counts = self._parameters[kernels.MOST_REQUESTS]
        self._no_devices, self._device_sequence = DeviceState(d), np.zeros(d, np.uint8)
        self.every = np.array([program.families[device.family].every for device in description.devices], np.int64)
        """(d,) host cycles from one frame of a device to the next"""
        family = [program.families[name] for name in program.joint_family]
        self.protocol_version = np.array([f.protocol_version if f.parameters else 0 for f in family], np.int64)
        """(n,) what each joint's drive must say that it speaks; 0: drives of its family say nothing"""
        self.repeated = 0
        """answers so far whose sequence number did not go on: replays, and nodes that are stuck"""
        self.frames_a_cycle = n + 2 * d + len(description.limbs) + 4 * len(description.channels) + kernels.MOST_REQUESTS
        """Records that the longest of this protocol's batches fills."""
        self._views: list[tuple[npt.NDArray[np.void], npt.NDArray[np.uint64]]] = []
        self._scratch, self._seen = frames.empty(self.frames_a_cycle), DriveTargets(n, d)
        self._fitting = self._heard = self._seen
        self._warm(n, d)

    def encode_commands(self, command: JointCommand, sequence: int, watchdog: int, out: npt.NDArray[np.void]) -> int:
        """Write the joints' commands; returns how many frames. Values beyond the range of their signal saturate.

        sequence: 0..255; watchdog: host cycles, 0..255. Raises ValueError naming joint and field for a value that is not
        finite; nothing of `out` may be sent then.
        """
        self._sent = sequence & 0xFF
        count = kernels.encode_commands(
            self._words(out), *self._command, self._code, command.table, command.mode, self._sent,
            min(max(watchdog, 0), 255),
        )  # fmt: skip
        if count < 0:
            joint, field = divmod(-1 - count, 8)
            name = Field(field).name.lower()
            value = getattr(command, name)[joint]
            raise ValueError(f"command: {name} of {self.joints[joint]}: {value}; expected a finite number")
        return count

    def encode_control(self, controlwords: npt.NDArray[np.uint8], sequence: int, out: npt.NDArray[np.void]) -> int:
        """Write the joints' controlwords (n,); returns how many frames."""
        self._sent = sequence & 0xFF
        return kernels.encode_control(out.view(np.uint64), *self._control, self._code, controlwords, self._sent)

    def encode_sync(self, cycle: int, out: npt.NDArray[np.void]) -> int:
        """Write one Sync a channel; returns how many. They go last in a cycle."""
        return kernels.encode_cycle(out.view(np.uint64), *self._sync, self._code, cycle)

    def encode_hold_time(self, cycle: int, out: npt.NDArray[np.void]) -> int:
        """Write one HoldTime a channel; returns how many."""
        return kernels.encode_cycle(out.view(np.uint64), *self._hold, self._code, cycle)

    def encode_devices(
        self,
        command: DeviceCommand,
        due: npt.NDArray[np.bool_],
        sequence: int,
        watchdog: int,
        out: npt.NDArray[np.void],
    ) -> int:
        """Write the commands of the devices that somebody commands and that are `due` (d,); returns how many.

        Raises ValueError naming device and column for a value that is not finite; nothing of `out` may be sent then.
        """
        count = kernels.encode_device_commands(
            out.view(np.uint64), *self._device_command, self._code, command.values, command.commanded, due,
            sequence & 0xFF, min(max(watchdog, 0), 255),
        )  # fmt: skip
        if count < 0:
            row, column = divmod(-1 - count, 16)
            value = command.values[row, column]
            raise ValueError(f"command: column {column} of {self.devices[row]}: {value}; expected a finite number")
        return count

    def decode_status(
        self, records: npt.NDArray[np.void], n: int, state: JointState, devices: DeviceState | None = None
    ) -> tuple[int, int]:
        """Take the answers among the first n records into `state` and `devices`; returns (good, refused).

        Refused are frames with a bad CRC or of the wrong format; other frames are passed over. A device that was heard gets
        age 0, a joint how many cycles ago what it answers was sent (0 where its frames echo no sequence number, or nothing was
        sent yet); the caller counts ages up once a cycle before this. Frames whose sequence number does not go on
        count for nothing, but in `repeated`.
        """
        devices = self._no_devices if devices is None else devices
        kernels.decode_status(
            self._words(records), n, self._code, len(state), state.memory, len(devices), devices.memory,
            self._device_sequence, self._clocks, self._sent, self._parameters,
        )  # fmt: skip
        good, refused, repeated = self._counts[:_REPLIES].tolist()
        self.repeated += repeated
        return good, refused

    def replies(self) -> list[ParameterReply]:
        """The parameter replies among the records of the last `decode_status`."""
        count = int(self._counts[_REPLIES])
        return [
            ParameterReply(row[0], row[2], bool(row[3]), row[7], row[4], _float(row[5]))
            for row in self._parameters[:count].tolist()
        ]

    def encode_request(
        self, joint: int, index: int, value: float | None, sequence: int, out: npt.NDArray[np.void]
    ) -> int:
        """Write a request to read (`value` None) or write a parameter of a joint's drive; returns 1, or 0 when drives of its
        family have no parameters."""
        limb = int(self.program.limb_of_joint[joint])
        for f in range(*self._requests):
            if self.program.frames[f, ENTITY] == limb:
                row = (
                    limb,
                    int(self.program.axis_of_joint[joint]),
                    index,
                    int(value is not None),
                    0,
                    _bits(value or 0.0),
                    0,
                )
                return self._encode_parameter(f, (*row, sequence & 0xFF), out)
        return 0

    def decode(
        self, records: npt.NDArray[np.void], n: int, targets: DriveTargets, *, check_sequence: bool = True
    ) -> tuple[int, int]:
        """Drive side: take the host's frames among the first n records into `targets`; returns (good, refused).

        Of several frames to one limb the last counts. What came in this batch begins anew. `check_sequence`: a command whose
        sequence number does not go on from that of the last frame counts for nothing. Targets without devices hear nothing
        of what devices are told. Raises ValueError for targets of another robot.
        """
        if targets is not self._fitting:
            self._fitting, self._heard = targets, self._devices_of(targets)
        devices = self._heard
        return kernels.decode_host(
            self._words(records), n, self._code, targets.command.table, targets.command.mode, targets.flags,
            devices.devices.values, devices.device_flags, targets.parameters, check_sequence,
        )  # fmt: skip

    def _devices_of(self, targets: DriveTargets) -> DriveTargets:
        """Whose devices are told what the batch says: kernels do not look how long an array is."""
        heard = targets if len(targets.devices) else self._seen
        if len(targets.command) != len(self.joints) or len(heard.devices) != len(self.devices):
            raise ValueError(
                f"targets: room for {len(targets.command)} joints and {len(targets.devices)} devices; "
                f"expected {len(self.joints)} and {len(self.devices)}, as the protocol has"
            )
        return heard

    def requests(self, targets: DriveTargets) -> list[ParameterRequest]:
        """Drive side: the parameter requests of the last batch, to drives that there are."""
        rows = targets.parameters[: int(targets.host[kernels.REQUESTS])].tolist()
        joints = [(int(self.program.axis_joint[row[0], row[1]]) if row[1] < 16 else -1, row) for row in rows]
        return [
            ParameterRequest(joint, row[2], bool(row[3]), row[7], _float(row[5])) for joint, row in joints if joint >= 0
        ]

    def encode_reply(
        self, request: ParameterRequest, result: ParameterResult, value: float, out: npt.NDArray[np.void]
    ) -> int:
        """Drive side: write the answer to a request; returns 1."""
        for f in range(*self._replies):
            if self.program.frames[f, ENTITY] == request.joint:
                row = (
                    request.joint,
                    0,
                    request.index,
                    int(request.write),
                    int(result),
                    _bits(value),
                    0,
                    request.sequence,
                )
                return self._encode_parameter(f, row, out)
        return 0

    def encode_status(
        self,
        state: JointState,
        mode: npt.NDArray[np.uint8],
        answer: npt.NDArray[np.bool_],
        out: npt.NDArray[np.void],
        time_ns: int = 0,
    ) -> int:
        """Drive side: write the answers of the joints whose `answer` (n,) is set; returns how many frames.

        state.sequence is what is echoed; mode (n,): hal.joint.Mode in use; time_ns: of the drives' clock. Values beyond
        their signal's range saturate, and what is not finite is sent as 0 (a broken sensor is reported by the error byte). A
        limb's master answers for all axes when its first one owes an answer.
        """
        count = 0
        for span in self._status:
            if span[0] != span[1]:
                words = self._words(out) if count == 0 else out[count:].view(np.uint64)
                count += kernels.encode_status(
                    words, *span, self._code, answer, state.memory, mode, time_ns // 1000 & 0xFFFFFFFF
                )  # fmt: skip
        return count

    def encode_device_status(
        self,
        state: DeviceState,
        due: npt.NDArray[np.bool_],
        sequences: npt.NDArray[np.uint8],
        out: npt.NDArray[np.void],
        time_ns: int = 0,
    ) -> int:
        """Device side: write what the devices that are `due` (d,) measured; returns how many. Counts their `sequences` up."""
        return kernels.encode_device_status(
            out.view(np.uint64), *self._device_status, self._code, state.values, due, sequences,
            time_ns // 1000 & 0xFFFFFFFF,
        )  # fmt: skip

    def quantise(self, command: JointCommand, out: JointCommand | None = None) -> JointCommand:
        """What the drives will see of a command, in `out` (made when None). Raises ValueError as `encode_commands` does."""
        sent = self._sent
        count = self.encode_commands(command, 0, 0, self._scratch)
        self._sent = sent
        self.decode(self._scratch, count, self._seen, check_sequence=False)
        out = JointCommand(len(command)) if out is None else out
        out.copy_from(self._seen.command)
        return out

    def _words(self, records: npt.NDArray[np.void]) -> npt.NDArray[np.uint64]:
        """The records as words; who works in the same array cycle by cycle has its view made once."""
        for known, words in self._views:
            if known is records:
                return words
        self._views = [(records, records.view(np.uint64)), *self._views[:1]]
        return self._views[0][1]

    def _encode_parameter(self, f: int, row: tuple[int, ...], out: npt.NDArray[np.void]) -> int:
        return kernels.encode_parameter(out.view(np.uint64), f, self._code, np.array(row, np.int64))

    def _warm(self, n: int, d: int) -> None:
        """Compile every kernel with the types that it will be called with."""
        out, state, words = frames.empty(self.frames_a_cycle), JointState(n), np.zeros(n, np.uint8)
        due = np.zeros(d, np.bool_)
        self.encode_control(words, 0, out)
        self.encode_sync(0, out)
        self.quantise(JointCommand(n))
        self.encode_devices(DeviceCommand(d), due, 0, 0, out)
        self.encode_device_status(DeviceState(d), due, self._device_sequence, out)
        for span in (self._requests, self._replies):
            if span[0] != span[1]:
                self._encode_parameter(span[0], (0,) * _PARAMETER_COLUMNS, out)
        self.decode_status(out, self.encode_status(state, words, np.zeros(n, np.bool_), out), state)
        self._sent = -1


def _bits(value: float) -> int:
    return int(np.float32(value).view(np.uint32))


def _float(bits: int) -> float:
    return float(np.uint32(bits).view(np.float32))
