"""The limb FD protocol, host side and drive side: batches of frames against arrays with one row a joint.

`limb_fd.dbc` says where every signal lies and how it scales; this file adds what a DBC can't say: the logarithmic scale of
stiffness and damping, the CRC, which joint is which axis of which limb, and that a frame with a bad CRC counts for nothing.

A drive answers each LimbCommand or LimbControl addressed to its limb with one DriveStatus, at most one a cycle.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import numpy.typing as npt

from hal.can import frames
from hal.can.codec import LENGTH, START, Codec, MessageLayout
from hal.drives import DBC_FILES
from hal.drives import limb_fd_kernels as kernels
from hal.drives.limb_fd_kernels import AXES, DAMPING_OF_RAW, LIMBS, STIFFNESS_OF_RAW
from hal.joint import JointCommand, JointState

__all__ = ["AXES", "DAMPING_OF_RAW", "DBC", "LIMBS", "STIFFNESS_OF_RAW", "DriveTargets", "LimbProtocol"]

DBC = DBC_FILES["limb_fd"]
"""The protocol's DBC file."""

_AXIS_FIELDS = ("Position", "Velocity", "Torque", "Stiffness", "Damping", "Mode")
_STATUS_FIELDS = ("Position", "Velocity", "Torque", "Statusword", "Temperature", "Error", "Sequence", "Mode", "Crc")


class DriveTargets:
    """What the drives were told by the frames of one `LimbProtocol.decode`; arrays have shape (n,), one row a joint."""

    def __init__(self, n: int):
        self.command = JointCommand(n)
        """Last set-points received; stiffness N·m/rad, damping N·m·s/rad as quantised on the bus."""
        self.commanded = np.zeros(n, np.bool_)
        """a LimbCommand came in this batch"""
        self.controlword = np.zeros(n, np.uint8)
        """Last CiA 402 controlword received, low byte (hal.drives.lifecycle)."""
        self.controlled = np.zeros(n, np.bool_)
        """a LimbControl came in this batch"""
        self.sequence = np.zeros(n, np.uint8)
        """Sequence number of the last frame received, to be echoed."""
        self.watchdog = np.zeros(n, np.uint8)
        """Host cycles without a command until quick stop, as last commanded."""
        self._host = np.zeros(4, np.int64)

    @property
    def answer(self) -> npt.NDArray[np.bool_]:
        """(n,) the drives that owe a DriveStatus for this batch."""
        return self.commanded | self.controlled

    @property
    def syncs(self) -> int:
        """Sync frames on channel 0 in this batch."""
        return int(self._host[kernels.SYNCS])

    @property
    def cycle(self) -> int:
        """The host's cycle counter in the last Sync or HoldTime seen on channel 0."""
        return int(self._host[kernels.CYCLE])

    @property
    def holds(self) -> int:
        """HoldTime frames on channel 0 in this batch."""
        return int(self._host[kernels.HOLDS])


class LimbProtocol:
    """Encodes and decodes for one robot. Frame arrays are hal.can.frames.RECORD; `out` needs room for `frames_a_cycle`."""

    def __init__(self, description: Any):
        """`description`: a RobotDescription: joints, channels and limbs (name, index, channel, joints).

        Raises ValueError naming the limb whose number, channel or joints the protocol can't carry.
        """
        self.codec = _codec()
        joints, channels = list(description.joints), [channel.name for channel in description.channels]
        _check(description.limbs, joints, channels)
        n = len(joints)
        self.joints = tuple(joints)
        self._channels = len(channels)
        self._axis_joint = np.full((len(description.limbs), AXES), -1, np.int64)
        self._limb_of_id = np.full((2, 2048), -1, np.int64)
        self._joint_of_id = np.full(2048, -1, np.int64)
        self._limb_bus, self._joint_bus = np.zeros(len(description.limbs), np.int64), np.zeros(n, np.int64)
        self._command_heads = np.zeros(len(description.limbs), np.uint64)
        self._control_heads = np.zeros(len(description.limbs), np.uint64)
        self._status_heads = np.zeros(n, np.uint64)
        for row, limb in enumerate(description.limbs):
            bus = channels.index(limb.channel)
            command = self.codec.layout(f"LimbCommand_{limb.index}")
            control = self.codec.layout(f"LimbControl_{limb.index}")
            self._limb_bus[row] = bus
            self._command_heads[row], self._control_heads[row] = _head(command, bus), _head(control, bus)
            self._limb_of_id[kernels.COMMAND, command.frame_id] = row
            self._limb_of_id[kernels.CONTROL, control.frame_id] = row
            for axis, name in enumerate(limb.joints):
                joint = joints.index(name)
                status = self.codec.layout(f"DriveStatus_{limb.index}_{axis}")
                self._axis_joint[row, axis] = joint
                self._joint_of_id[status.frame_id], self._joint_bus[joint] = joint, bus
                self._status_heads[joint] = _head(status, bus)
        names = [f"{field}_{axis}" for axis in range(AXES) for field in _AXIS_FIELDS] + ["Sequence", "Watchdog", "Crc"]
        self._command = self._same([f"LimbCommand_{i}" for i in range(LIMBS)], names)
        names = [f"Controlword_{axis}" for axis in range(AXES)] + ["Sequence", "Crc"]
        self._control = self._same([f"LimbControl_{i}" for i in range(LIMBS)], names)
        every = [f"DriveStatus_{i}_{axis}" for i in range(LIMBS) for axis in range(AXES)]
        self._status = self._same(every, _STATUS_FIELDS)
        self._sync, self._hold = self.codec.layout("Sync"), self.codec.layout("HoldTime")
        self.frames_a_cycle = max(n, len(description.limbs) + self._channels)
        """Records that the longest of this protocol's batches fills."""
        self._scratch, self._seen = frames.empty(len(description.limbs)), DriveTargets(n)
        self._warm(n)

    def encode_commands(self, command: JointCommand, sequence: int, watchdog: int, out: npt.NDArray[np.void]) -> int:
        """Write one LimbCommand a limb; returns how many. Values beyond the range of their signal saturate.

        sequence: 0..255; watchdog: host cycles, 0..255. Raises ValueError naming joint and field for a value that is not
        finite; nothing of `out` may be sent then.
        """
        count = kernels.encode_commands(
            out.view(np.uint64), self._command_heads, self._axis_joint, command.position, command.velocity, command.torque,
            command.stiffness, command.damping, command.mode, sequence & 0xFF, min(max(watchdog, 0), 255), *self._command,
        )  # fmt: skip
        if count < 0:
            joint, field = divmod(-1 - count, 8)
            name = _AXIS_FIELDS[field].lower()
            value = getattr(command, name)[joint]
            raise ValueError(f"command: {name} of {self.joints[joint]}: {value}; expected a finite number")
        return count

    def encode_control(self, controlwords: npt.NDArray[np.uint8], sequence: int, out: npt.NDArray[np.void]) -> int:
        """Write one LimbControl a limb with the joints' controlwords (n,); returns how many."""
        return kernels.encode_control(
            out.view(np.uint64), self._control_heads, self._axis_joint, controlwords, sequence & 0xFF, *self._control
        )

    def encode_sync(self, cycle: int, out: npt.NDArray[np.void]) -> int:
        """Write one Sync a channel; returns how many. They go last in a cycle."""
        return kernels.encode_cycle(out.view(np.uint64), np.uint64(_head(self._sync, 0)), self._channels, cycle)

    def encode_hold_time(self, cycle: int, out: npt.NDArray[np.void]) -> int:
        """Write one HoldTime a channel; returns how many."""
        return kernels.encode_cycle(out.view(np.uint64), np.uint64(_head(self._hold, 0)), self._channels, cycle)

    def decode_status(self, records: npt.NDArray[np.void], n: int, state: JointState) -> tuple[int, int]:
        """Take the drives' answers among the first n records into `state`; returns (good, refused).

        Refused are answers with a bad CRC or of the wrong length; other frames are passed over. A joint that answered
        gets age 0; the caller counts `state.age` up once a cycle before this.
        """
        return kernels.decode_status(
            records.view(np.uint64), n, self._joint_of_id, self._joint_bus, state.position, state.velocity, state.torque,
            state.temperature, state.status, state.error, state.sequence, state.age, *self._status,
        )  # fmt: skip

    def decode(self, records: npt.NDArray[np.void], n: int, targets: DriveTargets) -> tuple[int, int]:
        """Drive side: take the host's frames among the first n records into `targets`; returns (good, refused).

        Of several frames to one limb the last counts. `targets.commanded`, `controlled`, `syncs` and `holds` begin anew.
        """
        c = targets.command
        return kernels.decode_host(
            records.view(np.uint64), n, self._limb_of_id, self._limb_bus, self._axis_joint, self._sync.frame_id,
            self._hold.frame_id, c.position, c.velocity, c.torque, c.stiffness, c.damping, c.mode, targets.commanded,
            targets.controlword, targets.controlled, targets.sequence, targets.watchdog, targets._host,
            *self._command, self._control[0],
        )  # fmt: skip

    def encode_status(
        self,
        state: JointState,
        mode: npt.NDArray[np.uint8],
        answer: npt.NDArray[np.bool_],
        out: npt.NDArray[np.void],
    ) -> int:
        """Drive side: write the DriveStatus of every joint whose `answer` (n,) is set; returns how many.

        state.sequence is what is echoed; mode (n,): hal.joint.Mode in use. Values beyond their signal's range saturate, and
        what is not finite is sent as 0 (a broken sensor is reported by the error byte).
        """
        return kernels.encode_status(
            out.view(np.uint64), self._status_heads, answer, state.position, state.velocity, state.torque, state.status,
            state.temperature, state.error, state.sequence, mode, *self._status,
        )  # fmt: skip

    def quantise(self, command: JointCommand, out: JointCommand | None = None) -> JointCommand:
        """What the drives will see of a command, in `out` (made when None). Raises ValueError as `encode_commands` does."""
        count = self.encode_commands(command, 0, 0, self._scratch)
        self.decode(self._scratch, count, self._seen)
        out = JointCommand(len(command)) if out is None else out
        for name in ("position", "velocity", "torque", "stiffness", "damping", "mode"):
            getattr(out, name)[:] = getattr(self._seen.command, name)
        return out

    def _same(self, messages: list[str], names: Any) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
        """The tables of `names`, which all these messages must share."""
        first = self.codec.layout(messages[0])
        places, scales = first.rows(names)
        for message in messages[1:]:
            other = self.codec.layout(message)
            if not all(np.array_equal(a, b) for a, b in zip(other.rows(names), (places, scales), strict=True)):
                raise ValueError(
                    f"{DBC.name}: message {message}: laid out unlike {messages[0]}; expected the same signals"
                )
        crc = places[-1]
        if crc[START] % 8 or crc[LENGTH] != 16:
            raise ValueError(f"{DBC.name}: message {first.name}: Crc; expected 16 bits that begin with a byte")
        return places, scales

    def _warm(self, n: int) -> None:
        """Compile every kernel with the types that it will be called with."""
        out, state, mode = frames.empty(self.frames_a_cycle), JointState(n), np.zeros(n, np.uint8)
        self.encode_control(mode, 0, out)
        self.encode_sync(0, out)
        self.quantise(JointCommand(n))
        self.decode_status(out, self.encode_status(state, mode, np.ones(n, np.bool_), out), state)


@functools.cache
def _codec() -> Codec:
    return Codec.from_file(DBC)  # reading the file takes most of the time that a protocol takes to build


def _head(layout: MessageLayout, bus: int) -> int:
    return layout.head | bus << 48


def _check(limbs: Any, joints: list[str], channels: list[str]) -> None:
    seen: set[int] = set()
    carried: list[str] = []
    for limb in limbs:
        where = f"limb {limb.name}"
        if not 0 <= limb.index < LIMBS or limb.index in seen:
            raise ValueError(f"{where}: index {limb.index}; expected 0 to {LIMBS - 1}, each once")
        if not 1 <= len(limb.joints) <= AXES:
            raise ValueError(f"{where}: {len(limb.joints)} joints; expected 1 to {AXES}")
        if limb.channel not in channels:
            raise ValueError(f"{where}: channel {limb.channel}; expected one of {', '.join(channels)}")
        seen.add(limb.index)
        carried += limb.joints
    if sorted(carried) != sorted(joints):
        odd = sorted(set(carried) ^ set(joints)) or sorted({name for name in carried if carried.count(name) > 1})
        raise ValueError(f"limbs: joints {', '.join(odd)}; expected every joint of the robot in exactly one limb")
