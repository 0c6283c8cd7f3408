"""What a typed message's class must know of its family's description: found out when it is first needed."""

from __future__ import annotations

import enum
import typing
from typing import Any

import numpy as np

from hal.can import frames
from hal.can.layout import MessageLayout
from hal.drives import crc, typed_fields
from hal.drives.family import Family, load, number, signal_of
from hal.drives.fields import Role
from hal.drives.lifecycle import Command
from hal.drives.typed_fields import Kind, TypedField


class Plan:
    """What a class knows of its message."""

    def __init__(self, cls: Any):
        """`cls`: a subclass of hal.drives.typed.TypedMessage. Raises ConfigError for a family that is not there, ValueError for a
        class that was made from another description."""
        self.family: Family = load(cls._family)
        by_name = {kind.name: kind for kind in typed_fields.kinds(self.family)}
        stale = (
            f"{cls.__module__}.{cls.__name__} was made from another description of family {cls._family}: "
            f"`handrail drives types {cls._family}` writes it anew"
        )
        if cls._kind not in by_name:
            raise ValueError(stale)
        self.kind: Kind = by_name[cls._kind]
        self.payloads = {key: bytes.fromhex(text) for key, text in self.kind.message.payloads.items()}
        self.fields = () if self.payloads else typed_fields.fields(self.family, self.kind)
        names = {*self.kind.numbers, *(item.name for item in self.fields), *(["command"] if self.payloads else [])}
        if names != set(cls.__dataclass_fields__):
            raise ValueError(stale)
        control = self.family.messages.get(Role.CONTROL)
        shared = control.payloads if control and self.kind.role in (Role.CONTROL, Role.COMMAND) else {}
        self._commands = {bytes.fromhex(shared[c.name.lower()]): c for c in reversed(Command)} if shared else {}
        crc_entry = self.kind.message.fields.get("crc")
        self.crc_signal = signal_of(crc_entry).signal if crc_entry else ""
        self._by_id: dict[tuple[int, bool], dict[str, int]] = {}
        for numbers in self._instances():
            head = self.layout(numbers).head
            self._by_id[head & 0xFFFFFFFF, bool(head >> 40 & frames.EXTENDED)] = numbers
        self._enums = {name: _enum_of(hint) for name, hint in typing.get_type_hints(cls).items()}

    def _instances(self) -> list[dict[str, int]]:
        return (
            self.family.instances(self.kind.role)
            if self.kind.role is not None
            else [{"limb": 0, "axis": 0, "device": 0}]
        )

    def layout(self, numbers: dict[str, int]) -> MessageLayout:
        return self.family.codec.layout(self.kind.template.format_map(numbers))

    @property
    def identifiers(self) -> str:
        ids = sorted(can_id for can_id, _ in self._by_id)
        return f"{ids[0]:#x}" if len(ids) == 1 else f"{ids[0]:#x} to {ids[-1]:#x}"

    def numbers_of(self, record: np.ndarray) -> dict[str, int] | None:
        """limb, axis and device of a frame; None: it is none of these."""
        return self._by_id.get((int(record["can_id"][0]), bool(record["flags"][0] & frames.EXTENDED)))

    def command_of(self, data: bytes) -> Command | None:
        """Which of the family's fixed frames this is."""
        return self._commands.get(data)

    def constants(self, numbers: dict[str, int]) -> list[tuple[str, int]]:
        """(signal, raw value) of what always reads the same."""
        layout, found = self.layout(numbers), []
        for name, given in self.kind.message.constants.items():
            bits = int(layout.rows([name])[0][0, 1])
            found.append((name, number(given, numbers) & (1 << bits) - 1))
        return found

    def crc(self, layout: MessageLayout, numbers: dict[str, int], record: np.ndarray) -> int:
        """What a frame's CRC should be."""
        start = int(layout.rows([self.crc_signal.format_map(numbers)])[0][0, 0])
        begin, end = self.family.crc_bytes or (0, start // 8)
        return int(crc.crc_of(frames.words(record), frames.DATA, begin, end, self.family.algorithm))

    def typed(self, item: TypedField, value: typed_fields.Number) -> Any:
        """A value as a member of its field's enum, where it has one that knows it."""
        kind = self._enums.get(item.name)
        return kind(int(value)) if kind is not None and value in set(kind) else value


_plans: dict[type, Plan] = {}


def plan_of(cls: type) -> Plan:
    """Made when it is first needed: reading a DBC takes a moment, importing its classes shall not."""
    if cls not in _plans:
        _plans[cls] = Plan(cls)
    return _plans[cls]


def _enum_of(hint: Any) -> type[enum.IntEnum] | None:
    if isinstance(hint, type) and issubclass(hint, enum.IntEnum):
        return hint
    return next((found for part in typing.get_args(hint) if (found := _enum_of(part))), None)
