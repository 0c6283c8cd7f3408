"""A robot's network as tables: every message of its limbs' and devices' families, ready for the kernels (hal.drives.signals)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from hal.can.frames import EXTENDED
from hal.can.layout import BIG_ENDIAN, FLOAT, MessageLayout
from hal.drives import fields
from hal.drives.family import Family, Message, Signal, load, number, placeholders, signal_of, table
from hal.drives.fields import ACROSS, FRAME_COLUMNS, OP_COLUMNS, Field, Role
from hal.drives.lifecycle import Command
from hal.drives.signals import LOGS, LOOKUP_COLUMNS, RAWS, log2_nearly, packed
from hal.joint import Mode

TABLE_SIZE = 256
_SYNC_FAMILY = "limb_fd"
"""whose Sync and HoldTime the host sends where no family of the robot has its own"""
_ADDRESSED = (Role.CONTROL, Role.COMMAND, Role.DEVICE_COMMAND, Role.STATUS, Role.MASTER_STATUS)


class Program:
    """What the kernels walk. Frames of a role are neighbours: `span(role)`."""

    def __init__(self, description: Any):
        """`description`: a RobotDescription: joints, channels, limbs (name, index, channel, joints, family, answer), devices.

        Raises ValueError naming the limb or device whose number, channel, joints or family the network can't carry.
        """
        joints, channels = list(description.joints), [channel.name for channel in description.channels]
        families = {limb.family: load(limb.family) for limb in description.limbs}
        families |= {device.family: load(device.family) for device in description.devices}
        check_network(description, families, joints, channels)
        self.families: dict[str, Family] = families
        self.joint_family = [""] * len(joints)
        """(n,) the family of each joint's drive"""
        self.limb_of_joint, self.axis_of_joint = np.zeros(len(joints), np.int64), np.zeros(len(joints), np.int64)
        self.axis_joint = np.full((len(description.limbs), 16), -1, np.int64)
        """(limbs, 16) joint of each limb's axes, −1: none"""
        self._frames: list[tuple[Role, list[int]]] = []
        self._ops: list[list[int]] = []
        self._scales: dict[tuple[float, ...], int] = {}
        self._tables: dict[Any, int] = {}
        self._payloads: list[int] = []
        self._table_rows: list[np.ndarray] = []
        for row, limb in enumerate(description.limbs):
            for axis, name in enumerate(limb.joints):
                joint = joints.index(name)
                self.joint_family[joint] = limb.family
                self.limb_of_joint[joint], self.axis_of_joint[joint], self.axis_joint[row, axis] = row, axis, joint
            self._add_limb(families[limb.family], row, limb, joints, channels.index(limb.channel))
        for row, device in enumerate(description.devices):
            for role in (Role.DEVICE_COMMAND, Role.DEVICE_STATUS):
                if role in families[device.family].messages:
                    numbers = {"limb": 0, "axis": 0, "device": device.index}
                    bus = channels.index(device.channel)
                    self._add(families[device.family], role, numbers, bus, row, [row])
        sync = next((f for f in families.values() if Role.SYNC in f.messages), None) or load(_SYNC_FAMILY)
        for role in (Role.SYNC, Role.HOLD_TIME):
            for bus in range(len(channels)):
                self._add(sync, role, {"limb": 0, "axis": 0, "device": 0}, bus, bus, [0])
        self._finish(description, len(channels))

    def span(self, role: Role) -> tuple[int, int]:
        """First frame of a role, and the one after its last."""
        return self._spans[role]

    def _add_limb(self, family: Family, row: int, limb: Any, joints: list[str], bus: int) -> None:
        status = Role.MASTER_STATUS if limb.answer == "master" else Role.STATUS
        roles = (Role.CONTROL, Role.COMMAND, status, Role.PARAMETER_REQUEST, Role.PARAMETER_REPLY)
        for role in roles:
            if role not in family.messages:
                continue
            members = [joints.index(name) for name in limb.joints]
            if "axis" in placeholders(family.messages[role].message):
                for axis, joint in enumerate(members):
                    self._add(family, role, {"limb": limb.index, "axis": axis, "device": 0}, bus, joint, [joint])
            else:
                entity = row if role is Role.PARAMETER_REQUEST else members[0]
                self._add(family, role, {"limb": limb.index, "axis": 0, "device": 0}, bus, entity, members)

    def _add(
        self, family: Family, role: Role, numbers: dict[str, int], bus: int, entity: int, members: Sequence[int]
    ) -> None:
        """One message of the robot: `members` are the joints (or the device) of its axes, in order."""
        message, layout = family.messages[role], family.layout(role, **numbers)
        frame, first = [0] * FRAME_COLUMNS, len(self._ops)
        frame[fields.HEAD], frame[fields.ROLE] = layout.head | bus << 48, int(role)
        frame[fields.BYTES], frame[fields.ENTITY], frame[fields.ALGORITHM] = layout.length, entity, family.algorithm
        frame[fields.SEQUENCE] = frame[fields.TIME] = frame[fields.CRC] = frame[fields.PAYLOAD] = -1
        frame[fields.MEMBERS], frame[fields.EVERY] = -1, family.every
        for field, column, signal in _in_order(message, role):
            named = "axis" in placeholders(signal.signal)
            spread = named or field in (Field.SEQUENCE, Field.TEMPERATURE, Field.MODE, Field.WATCHDOG)
            for axis, member in enumerate(members if spread else members[:1]):
                own = {**numbers, "axis": axis} if named else numbers
                at = self._op(layout, field, member, column, signal, own)
                if field is Field.SEQUENCE and frame[fields.MEMBERS] < 0:
                    frame[fields.MEMBERS] = at
                place = {Field.SEQUENCE: fields.SEQUENCE, Field.TIME: fields.TIME, Field.CRC: fields.CRC}.get(field)
                if place is not None and frame[place] < 0 and signal.signal:
                    frame[place] = at
        for name, value in message.constants.items():
            raw = number(value, numbers) & (1 << int(layout.rows([name])[0][0, 1])) - 1
            self._op(layout, Field.CONSTANT, entity, 0, Signal(signal=name), numbers, raw)
            frame[fields.CONSTANTS] = 1
        if frame[fields.CRC] >= 0:
            begin, end = family.crc_bytes or (0, self._ops[frame[fields.CRC]][fields.START] // 8)
            frame[fields.CRC_FROM], frame[fields.CRC_TO] = begin, end
        control = family.messages.get(Role.CONTROL)
        if role in (Role.CONTROL, Role.COMMAND) and control is not None and control.payloads:
            frame[fields.PAYLOAD] = self._payload(control.payloads)
        frame[fields.LAW] = int(role is Role.COMMAND and not signal_of(message.fields.get("mode", "")).signal)
        frame[fields.FIRST], frame[fields.END] = first, len(self._ops)
        frame[fields.FLOATS] = int(any(op[fields.KIND] & FLOAT for op in self._ops[first:]))
        self._frames.append((role, frame))

    def _op(
        self,
        layout: MessageLayout,
        field: Field,
        row: int,
        column: int,
        signal: Signal,
        numbers: dict[str, int],
        raw: int | None = None,
    ) -> int:
        """`raw`: of a signal that always has the same."""
        op = [0] * OP_COLUMNS
        op[fields.FIELD], op[fields.ROW], op[fields.COLUMN] = int(field), row, column
        op[fields.TABLE] = -1
        scale = (1.0, 0.0, 0.0, 0.0)
        if signal.signal:
            places, scales = layout.rows([signal.signal.format_map(numbers)])
            op[fields.START], op[fields.LENGTH], op[fields.KIND] = (int(value) for value in places[0])
            scale = tuple(scales[0].tolist())
            start, length = op[fields.START], op[fields.LENGTH]
            if op[fields.KIND] & BIG_ENDIAN or start % 64 + length > 64:
                op[fields.KIND] |= ACROSS
            op[fields.TABLE] = self._table(signal, op[fields.LENGTH])
            if raw is not None:
                scale = (1.0, 0.0, float(raw), float(raw))
        elif signal.constant is not None:
            scale = (1.0, float(number(signal.constant, numbers)), 0.0, 0.0)
        op[fields.SCALING] = self._scales.setdefault(scale, len(self._scales))
        self._ops.append(op)
        return len(self._ops) - 1

    def _table(self, signal: Signal, bits: int) -> int:
        """Number of the look-up table that a signal needs; −1: none, it is linear."""
        if signal.log is None and signal.values is None:
            return -1
        key = (signal.log, tuple((signal.values or {}).items()), bits)
        if key not in self._tables:
            self._tables[key] = len(self._table_rows)
            self._table_rows.append(_log_table(*signal.log, bits) if signal.log else _value_table(signal.values or {}))
        return self._tables[key]

    def _payload(self, payloads: dict[str, str]) -> int:
        words = [int.from_bytes(bytes.fromhex(payloads[command.name.lower()]), "little") for command in Command]
        for at in range(0, len(self._payloads), len(words)):
            if self._payloads[at : at + len(words)] == words:
                return at
        self._payloads += words
        return len(self._payloads) - len(words)

    def _finish(self, description: Any, channels: int) -> None:
        self._frames.sort(key=lambda entry: entry[0])  # stable: limbs and joints stay in order
        roles = [role for role, _ in self._frames]
        self._spans = {}
        for role in Role:
            count = roles.count(role)
            begin = roles.index(role) if count else 0
            self._spans[role] = (begin, begin + count)
        self.frames = np.array([frame for _, frame in self._frames], np.int64).reshape(-1, FRAME_COLUMNS)
        self.ops = np.array(self._ops, np.int16).reshape(-1, OP_COLUMNS)
        self.scales = np.array(list(self._scales), np.float64).reshape(-1, 4)
        self.lookups = np.array(self._table_rows or [np.zeros(LOOKUP_COLUMNS)])
        self.payloads = np.array(self._payloads or [0], np.uint64)
        self.ids = np.full((channels, 2048), -1, np.int64)
        long_ids: dict[int, int] = {}
        for index, (role, frame) in enumerate(self._frames):
            head = frame[fields.HEAD]
            can_id, bus = head & 0xFFFFFFFF, head >> 48
            if role is Role.CONTROL and frame[fields.PAYLOAD] >= 0:
                continue  # the same identifier as the command's
            if head >> 40 & EXTENDED:
                taken, long_ids[bus << 32 | can_id] = long_ids.get(bus << 32 | can_id, -1), index
            else:
                taken, self.ids[bus, can_id] = int(self.ids[bus, can_id]), index
            if taken >= 0:
                name = description.channels[bus].name
                raise ValueError(f"channel {name}: identifier {can_id:#x} has two messages; expected one")
        self.long_ids: npt.NDArray[np.int64] = np.array(
            [sorted(long_ids), [long_ids[key] for key in sorted(long_ids)]], np.int64
        )
        spans = np.array([self._spans[role] for role in Role], np.int64)
        self.code = packed(
            self.frames, self.ops, self.scales, self.lookups, self.ids, self.long_ids, self.payloads, spans,
            len(description.joints), len(description.devices),
        )  # fmt: skip
        """all tables as the kernels take them"""


def _in_order(message: Message, role: Role) -> list[tuple[Field, int, Signal]]:
    """(field, column, signal) in the order in which kernels must work through them."""
    found = [(Field[key.upper()], 0, signal_of(given)) for key, given in message.fields.items()]
    found += [(Field.COLUMN, column, signal_of(given)) for column, given in enumerate(message.columns.values())]
    if role in _ADDRESSED and all(field is not Field.SEQUENCE for field, _, _ in found):
        found.append((Field.SEQUENCE, 0, Signal()))  # marks the joints or the device as heard
    if role is Role.COMMAND and all(field is not Field.MODE for field, _, _ in found):
        found.append((Field.MODE, 0, Signal(constant=int(Mode.IMPEDANCE))))
    return sorted(found, key=lambda entry: (entry[0], entry[1]))


def _log_table(low: float, high: float, bits: int) -> np.ndarray:
    """A row of look-up tables: raw 0 → 0, raw r ≥ 1 → low (high/low)^((r−1)/(top−1))."""
    row, top = np.zeros(LOOKUP_COLUMNS), (1 << bits) - 1
    row[1 : top + 1] = low * (high / low) ** (np.arange(top) / (top - 1))
    # From where on a value is nearer to raw r than to the one below it.
    row[RAWS + 1] = 0.5 * low
    row[RAWS + 2 : RAWS + top + 1] = low * (high / low) ** ((np.arange(2, top + 1) - 1.5) / (top - 1))
    row[LOGS:] = low, top, (top - 1.0) / math.log2(high / low), log2_nearly(low)
    return row


def _value_table(given: dict[str, int | str]) -> np.ndarray:
    """A row of look-up tables: raw → value as given, the rest 0; of several raws of one value the first is what is sent."""
    row = np.zeros(LOOKUP_COLUMNS)
    for raw, value in reversed(table(given).items()):
        row[raw], row[TABLE_SIZE + value] = value, raw
    return row


def check_network(description: Any, families: dict[str, Family], joints: list[str], channels: list[str]) -> None:
    """Raises ValueError naming the limb or device that the frames can't carry."""
    seen: set[tuple[str, int]] = set()
    carried: list[str] = []
    for limb in description.limbs:
        where, family = f"limb {limb.name}", families[limb.family]
        if family.serves != "joints":
            raise ValueError(f"{where}: family {family.name} is one of devices; expected one of joints")
        if not 0 <= limb.index < family.limbs or (family.name, limb.index) in seen:
            raise ValueError(f"{where}: index {limb.index}; expected 0 to {family.limbs - 1}, each once")
        if not 1 <= len(limb.joints) <= family.axes:
            raise ValueError(f"{where}: {len(limb.joints)} joints; expected 1 to {family.axes}")
        if limb.channel not in channels:
            raise ValueError(f"{where}: channel {limb.channel}; expected one of {', '.join(channels)}")
        if limb.answer == "master" and Role.MASTER_STATUS not in family.messages:
            raise ValueError(f"{where}: answer master; family {family.name} has no limb masters")
        seen.add((family.name, limb.index))
        carried += limb.joints
    if sorted(carried) != sorted(joints):
        odd = sorted(set(carried) ^ set(joints)) or sorted({name for name in carried if carried.count(name) > 1})
        raise ValueError(f"limbs: joints {', '.join(odd)}; expected every joint of the robot in exactly one limb")
    for device in description.devices:
        where, family = f"device {device.name}", families[device.family]
        if family.serves != "devices":
            raise ValueError(f"{where}: family {family.name} is one of joints; expected one of devices")
        if not 0 <= device.index < family.devices:
            raise ValueError(f"{where}: index {device.index}; expected 0 to {family.devices - 1}")
        if device.channel not in channels:
            raise ValueError(f"{where}: channel {device.channel}; expected one of {', '.join(channels)}")
