"""A robot's frames, host side and drive side, whatever families its limbs and devices are of: batches of frames against arrays.

What a frame says comes from the families' folders (hal.drives.family); here joints and devices meet them. A robot may mix
families from limb to limb.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from hal.can import frames
from hal.device import COMMANDED, DeviceCommand, DeviceState
from hal.drives import drive_side, host_side
from hal.drives.drive_side import decode_host
from hal.drives.fields import ENTITY, Field, Role
from hal.drives.host_side import encode_host, hear
from hal.drives.parameter_frames import MOST_PARAMETERS, PARAMETER_COLUMNS, encode_parameter
from hal.drives.parameters import ParameterResult
from hal.drives.program import Program
from hal.drives.watch import DriveWatch
from hal.joint import JointCommand, JointState

WATCHDOG_CYCLES = 20
"""host cycles without a command after which a node that nobody told otherwise stops"""

_CONTROLS, _COMMANDS, _DEVICES = 1 << Role.CONTROL, 1 << Role.COMMAND, 1 << Role.DEVICE_COMMAND
_SYNCS, _HOLDS = 1 << Role.SYNC, 1 << Role.HOLD_TIME
_MOVE, _POLL = _COMMANDS | _DEVICES | _SYNCS, _CONTROLS | _DEVICES | _SYNCS
_SOME_MOVE = _MOVE | _CONTROLS


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

    def __init__(self, n: int, devices: int = 0, watchdog_cycles: int = WATCHDOG_CYCLES):
        """watchdog_cycles: of drives and devices that the host tells none, 1..255."""
        self.nodes = n + devices
        """drives, then devices, as the rows of `flags` are"""
        flags_at, command_at, devices_at, end = drive_side.places(n, self.nodes)
        self.memory = np.zeros(end, np.int64)
        """everything below, in one piece for kernels"""
        self.memory[[drive_side.PATIENCE, drive_side.DRIVES, drive_side.NODES]] = watchdog_cycles, n, self.nodes
        self.command = JointCommand(n, self.memory[command_at:devices_at])
        """Last set-points received; stiffness N·m/rad, damping N·m·s/rad as quantised on the bus."""
        flags = self.memory[flags_at:].view(np.uint8)
        self.flags = flags[: drive_side.FLAGS * self.nodes].reshape(drive_side.FLAGS, self.nodes)
        drives = self.flags[:, :n]
        self.commanded = drives[drive_side.COMMANDED].view(np.bool_)
        """a command came in this batch"""
        self.controlled = drives[drive_side.CONTROLLED].view(np.bool_)
        """a controlword came in this batch"""
        self.answer = drives[drive_side.ANSWERS].view(np.bool_)
        """the drives that owe an answer for this batch"""
        self.owed = self.flags[drive_side.OWED].view(np.bool_)
        """(nodes,) drives that owe an answer, and devices whose turn it is; whoever sends their frames clears it"""
        self.controlword = drives[drive_side.WORD]
        """Last CiA 402 controlword received, low byte (hal.drives.lifecycle)."""
        self.sequence = drives[drive_side.ECHO]
        """Sequence number of the last frame received, to be echoed."""
        self.watchdog = drives[drive_side.WATCHDOG]
        """Host cycles without a command until quick stop, as last commanded; 0: the drive's own."""
        self.devices = DeviceCommand(devices, self.memory[devices_at:])
        """Last commands received; `commanded`: one came in this batch"""
        self.devices.commanded = self.flags[drive_side.COMMANDED, n:].view(np.bool_)
        self.device_watchdog = self.flags[drive_side.WATCHDOG, n:]
        """Host cycles without a command until the device is disabled, as last commanded; 0: never."""
        self.device_order = self.flags[drive_side.ORDER, n:]
        """what the last command was taken for (hal.drives.order)"""
        self.deaf = self.flags[drive_side.DEAF].view(np.bool_)
        """(nodes,) drives and devices that frames do not reach"""

    @property
    def syncs(self) -> int:
        """Sync frames on channel 0 in this batch."""
        return int(self.memory[drive_side.SYNCS])

    @property
    def cycle(self) -> int:
        """The host's cycle counter in the last Sync or HoldTime seen on channel 0."""
        return int(self.memory[drive_side.CYCLE])

    @property
    def holds(self) -> int:
        """HoldTime frames on channel 0 in this batch."""
        return int(self.memory[drive_side.HOLDS])

    @property
    def repeated(self) -> int:
        """Commands and controlwords so far that counted for nothing, since their sequence number did not go on."""
        return int(self.memory[drive_side.REPEATED])


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
        self._sent = -1
        self._notes = np.zeros(host_side.NOTES + n + 2 * d, np.int64)
        self._replies = self._notes[: host_side.NOTES].reshape(MOST_PARAMETERS, PARAMETER_COLUMNS)
        self._clocks = self._notes[host_side.NOTES :][: n + d].view(np.float64)
        self._clocks[:] = np.nan
        self._device_sequence = self._notes[host_side.NOTES + n + d :]
        # What a batch leaves out.
        self._no_command, self._no_words, self._no_joints = JointCommand(n), np.zeros(n, np.uint8), JointState(n)
        self._no_commands, self._no_states = DeviceCommand(d), DeviceState(d)
        self._unwatched, self.reply_count = DriveWatch(n), 0
        # Who hears or says something in every cycle does so with the same array again and again.
        self._heard, self._written = frames.WordViews(), frames.empty(0)
        self._written_words = frames.words(self._written)
        self._nobody, self._senders = np.zeros(n + d, np.bool_), np.zeros(n + d, np.int64)
        self._no_sequences = np.zeros(d, np.uint8)
        self.every = np.array([program.families[device.family].every for device in description.devices], np.int64)
        """(d,) host cycles from one frame of a device to the next"""
        family = [program.families[name] for name in program.joint_family]
        self.protocol_version = np.array([f.protocol_version if f.parameters else 0 for f in family], np.int64)
        """(n,) what each joint's drive must say that it speaks; 0: drives of its family say nothing"""
        self.repeated = 0
        """answers so far whose sequence number did not go on: replays, and nodes that are stuck"""
        self.frames_a_cycle = n + 2 * d + len(description.limbs) + 4 * len(description.channels) + MOST_PARAMETERS
        """Records that the longest of this protocol's batches fills."""
        self._scratch, self._seen = frames.empty(self.frames_a_cycle), DriveTargets(n, d)
        self._fitting = self._seen
        self._warm(n, d)

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
    ) -> int:
        """Write all that a host sends in a cycle: the joints' commands, or where there is none their controlwords (n,); the
        commands of the devices that somebody commands and whose turn it is; last of all a Sync a channel. Returns how many frames.

        some_follow: commands only for the limbs whose controlwords are lifecycle.FOLLOW, controlwords for the others.

        sequence: 0..255; watchdog: host cycles, 0..255. Values beyond the range of their signal saturate. Raises ValueError
        naming joint and field, or device and column, for a value that is not finite; nothing of `out` may be sent then.
        """
        self._sent = sequence & 0xFF
        roles, moved = _SOME_MOVE if some_follow else _MOVE, command
        if moved is None:
            roles, moved = _POLL, self._no_command
        return self._encode(out, roles, moved, controlwords, devices, cycle, sequence, watchdog)

    def encode_commands(self, command: JointCommand, sequence: int, watchdog: int, out: npt.NDArray[np.void]) -> int:
        """Write the joints' commands only; as `encode_cycle`."""
        self._sent = sequence & 0xFF
        return self._encode(out, _COMMANDS, command, self._no_words, self._no_commands, 0, sequence, watchdog)

    def encode_control(self, controlwords: npt.NDArray[np.uint8], sequence: int, out: npt.NDArray[np.void]) -> int:
        """Write the joints' controlwords (n,) only; as `encode_cycle`."""
        self._sent = sequence & 0xFF
        return self._encode(out, _CONTROLS, self._no_command, controlwords, self._no_commands, 0, sequence, 0)

    def encode_devices(
        self, command: DeviceCommand, cycle: int, sequence: int, watchdog: int, out: npt.NDArray[np.void]
    ) -> int:
        """Write the devices' commands only; as `encode_cycle`."""
        return self._encode(out, _DEVICES, self._no_command, self._no_words, command, cycle, sequence, watchdog)

    def encode_sync(self, cycle: int, out: npt.NDArray[np.void]) -> int:
        """Write one Sync a channel; returns how many. They go last in a cycle."""
        return self._encode(out, _SYNCS, self._no_command, self._no_words, self._no_commands, cycle, 0, 0)

    def encode_hold_time(self, cycle: int, out: npt.NDArray[np.void]) -> int:
        """Write one HoldTime a channel; returns how many."""
        return self._encode(out, _HOLDS, self._no_command, self._no_words, self._no_commands, cycle, 0, 0)

    def _encode(
        self,
        out: npt.NDArray[np.void],
        roles: int,
        command: JointCommand,
        controlwords: npt.NDArray[np.uint8],
        devices: DeviceCommand,
        cycle: int,
        sequence: int,
        watchdog: int,
    ) -> int:
        if out is not self._written:
            self._written, self._written_words = out, out.view(np.uint64)
        words, code = self._written_words, self._code
        count: int = encode_host(
            words, code, roles, command.memory, controlwords, devices.memory, cycle, sequence, watchdog
        )
        return count if count >= 0 else self._refuse(count, command, devices)

    def _refuse(self, count: int, command: JointCommand, devices: DeviceCommand) -> NoReturn:
        """Raises ValueError for the value that is not finite of which `encode_host` tells by a negative count."""
        joint, field = divmod(-1 - count, 8)
        if joint < len(self.joints):
            name = Field(field).name.lower()
            value = getattr(command, name)[joint]
            raise ValueError(f"command: {name} of {self.joints[joint]}: {value}; expected a finite number")
        row, column = divmod(-1 - count - 8 * len(self.joints), COMMANDED)
        value = devices.values[row, column]
        raise ValueError(f"command: column {column} of {self.devices[row]}: {value}; expected a finite number")

    def decode_status(
        self, records: npt.NDArray[np.void], n: int, state: JointState, devices: DeviceState | None = None
    ) -> tuple[int, int]:
        """Take the answers among the first n records into `state` and `devices`; returns (good, refused).

        Refused are frames with a bad CRC, of the wrong format, or with a number that is none (of a joint's, `error` then says
        lifecycle.NO_NUMBER); other frames are passed over. A device that was heard gets
        age 0, a joint how many cycles ago what it answers was sent (0 where its frames echo no sequence number, or nothing was
        sent yet); the caller counts ages up once a cycle before this. Frames whose sequence number does not go on
        count for nothing, but in `repeated`.
        """
        return self.hear(records, n, state, self._no_states if devices is None else devices, self._unwatched, 0)

    def hear(
        self,
        records: npt.NDArray[np.void],
        n: int,
        state: JointState,
        devices: DeviceState,
        watch: DriveWatch,
        older: int,
    ) -> tuple[int, int]:
        """The same, of what has become `older` cycles older since; and see then how the drives fare, for `watch`."""
        good, refused, repeated, self.reply_count, watch.late, watch.lost, watch.silent, watch.heard_ns = hear(
            self._heard.of(records),
            n,
            self._code,
            state.memory,
            devices.memory,
            self._notes,
            watch.memory,
            self._sent,
            older,
        )
        self.repeated += repeated
        return good, refused

    def replies(self) -> list[ParameterReply]:
        """The parameter replies among the records of the last `decode_status` or `hear`."""
        if not self.reply_count:  # as in nearly every cycle
            return []
        return [
            ParameterReply(row[0], row[2], bool(row[3]), row[7], row[4], _float(row[5]))
            for row in self._replies[: self.reply_count].tolist()
        ]

    def encode_request(
        self, joint: int, index: int, value: float | None, sequence: int, out: npt.NDArray[np.void]
    ) -> int:
        """Write a request to read (`value` None) or write a parameter of a joint's drive; returns 1, or 0 when drives of its
        family have no parameters."""
        limb, axis = int(self.program.limb_of_joint[joint]), int(self.program.axis_of_joint[joint])
        row = (limb, axis, index, int(value is not None), 0, _bits(value or 0.0), 0, sequence & 0xFF)
        return self._encode_parameter(Role.PARAMETER_REQUEST, row, out)

    def decode(
        self,
        records: npt.NDArray[np.void],
        n: int,
        targets: DriveTargets,
        cycle: int = -1,
        *,
        check_sequence: bool = True,
    ) -> tuple[int, int]:
        """Drive side: take the host's frames among the first n records into `targets`; returns (good, refused).

        Of several frames to one limb the last counts. What came in this batch begins anew. cycle: host cycles that have passed
        on the drives' own clock; left out, as many as Syncs have come. `check_sequence`: a frame whose sequence number does not
        go on (hal.drives.order) counts for nothing, and one that begins a stream does not switch a drive on. Targets without
        devices hear nothing of what devices are told. Raises ValueError for targets of another robot.
        """
        if targets is not self._fitting:
            self._check_fit(targets)
        told: tuple[int, int] = decode_host(records, n, self._code, targets.memory, cycle, check_sequence)
        return told

    def _check_fit(self, targets: DriveTargets) -> None:
        """Kernels do not look how long an array is."""
        joints, devices = len(self.joints), len(targets.devices)
        if len(targets.command) != joints or devices not in (0, len(self.devices)):
            raise ValueError(
                f"targets: room for {len(targets.command)} joints and {devices} devices; "
                f"expected {joints} and {len(self.devices)}, as the protocol has"
            )
        self._fitting = targets

    def requests(self, targets: DriveTargets) -> list[ParameterRequest]:
        """Drive side: the parameter requests of the last batch, to drives that there are."""
        count = int(targets.memory[drive_side.REQUESTS])
        rows = targets.memory[drive_side.HOST : drive_side.ROWS].reshape(-1, PARAMETER_COLUMNS)[:count].tolist()
        joints = [(int(self.program.axis_joint[row[0], row[1]]) if row[1] < 16 else -1, row) for row in rows]
        return [
            ParameterRequest(joint, row[2], bool(row[3]), row[7], _float(row[5])) for joint, row in joints if joint >= 0
        ]

    def encode_reply(
        self, request: ParameterRequest, result: ParameterResult, value: float, out: npt.NDArray[np.void]
    ) -> int:
        """Drive side: write the answer to a request; returns 1."""
        row = (
            request.joint, 0, request.index, int(request.write), int(result), _bits(value), 0, request.sequence,
        )  # fmt: skip
        return self._encode_parameter(Role.PARAMETER_REPLY, row, out)

    def encode_answers(
        self,
        owed: npt.NDArray[np.bool_],
        state: JointState,
        mode: npt.NDArray[np.uint8],
        devices: DeviceState,
        sequences: npt.NDArray[np.uint8],
        time_ns: int,
        out: npt.NDArray[np.void],
        senders: npt.NDArray[np.int64],
    ) -> int:
        """Drive side: write the frames of the drives and devices that owe one (nodes,), and which they are into `senders`;
        returns how many frames.

        state.sequence is what drives echo; mode (n,): hal.joint.Mode in use; sequences (d,): of the devices, which are counted
        up; time_ns: of the nodes' clock. Values beyond their signal's range saturate, and what is not finite is sent as 0 (a
        broken sensor is reported by the error byte). A limb's master answers for all axes when its first one owes an answer.
        """
        count: int = drive_side.encode_answers(
            out, self._code, owed, state.memory, mode, devices.values, sequences, time_ns // 1000 & 0xFFFFFFFF, senders
        )
        return count

    def encode_status(
        self,
        state: JointState,
        mode: npt.NDArray[np.uint8],
        answer: npt.NDArray[np.bool_],
        out: npt.NDArray[np.void],
        time_ns: int = 0,
    ) -> int:
        """Drive side: write the answers of the joints whose `answer` (n,) is set; as `encode_answers`."""
        self._nobody[: len(answer)] = answer
        count = self.encode_answers(
            self._nobody, state, mode, self._no_states, self._no_sequences, time_ns, out, self._senders
        )
        self._nobody[:] = False
        return count

    def encode_device_status(
        self,
        state: DeviceState,
        due: npt.NDArray[np.bool_],
        sequences: npt.NDArray[np.uint8],
        out: npt.NDArray[np.void],
        time_ns: int = 0,
    ) -> int:
        """Device side: write what the devices that are `due` (d,) measured; as `encode_answers`."""
        self._nobody[len(self.joints) :] = due
        count = self.encode_answers(
            self._nobody, self._no_joints, self._no_words, state, sequences, time_ns, out, self._senders
        )
        self._nobody[:] = False
        return count

    def quantise(self, command: JointCommand, out: JointCommand | None = None) -> JointCommand:
        """What the drives will see of a command, in `out` (made when None). Raises ValueError as `encode_commands` does."""
        sent = self._sent
        count = self.encode_commands(command, 0, 0, self._scratch)
        self._sent = sent
        self.decode(self._scratch, count, self._seen, check_sequence=False)
        out = JointCommand(len(command)) if out is None else out
        out.copy_from(self._seen.command)
        return out

    def _encode_parameter(self, role: Role, row: tuple[int, ...], out: npt.NDArray[np.void]) -> int:
        """Write the frame of this role of the limb or joint that a row begins with; 0 where its family has none."""
        for f in range(*self.program.span(role)):
            if self.program.frames[f, ENTITY] == row[0]:
                count: int = encode_parameter(out, f, self._code, np.array(row, np.int64))
                return count
        return 0

    def _warm(self, n: int, d: int) -> None:
        """Compile every kernel with the types that it will be called with."""
        out = self._scratch
        self.quantise(JointCommand(n))
        count = self.encode_device_status(self._no_states, np.zeros(d, np.bool_), self._no_sequences, out)
        self.decode_status(out, count, self._no_joints)
        for role in (Role.PARAMETER_REQUEST, Role.PARAMETER_REPLY):
            for f in range(*self.program.span(role))[:1]:
                self._encode_parameter(role, (int(self.program.frames[f, ENTITY]), *[0] * (PARAMETER_COLUMNS - 1)), out)
        self._sent = -1


def _bits(value: float) -> int:
    return int(np.float32(value).view(np.uint32))


def _float(bits: int) -> float:
    return float(np.uint32(bits).view(np.float32))
