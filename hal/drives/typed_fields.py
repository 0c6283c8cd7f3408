"""What a family's messages carry, signal by signal, as people would type it: names, kinds, units, ranges from its description."""

from __future__ import annotations

import keyword
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from cantools.database.can import Signal as DbcSignal

from hal.drives.family import Family, Message, Signal, placeholders, signal_of
from hal.drives.fields import Field, Role

Number = float | int | bool

COUNTED = (Role.CONTROL, Role.COMMAND, Role.PARAMETER_REQUEST, Role.DEVICE_COMMAND, Role.DEVICE_STATUS)
"""Roles whose sender counts its frames; the others echo the number of what they answer."""

_LARGEST = {32: float(np.finfo(np.float32).max), 64: float(np.finfo(np.float64).max)}
_SINGLE = re.compile(r"_?\{[a-z]+\}")
_HUMP = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")
_TAKEN = {"encode", "decode", "record", "field"}
_WHOLE = (Field.TIME, Field.WATCHDOG)  # whole numbers, though they have a unit


@dataclass(frozen=True)
class Kind:
    """One message of a family."""

    name: str
    """of its class"""
    role: Role | None
    """None: the DBC has it, the family's description gives it no role"""
    template: str
    """name in the DBC, with {limb}, {axis}, {device}"""
    message: Message

    @property
    def numbers(self) -> tuple[str, ...]:
        """Which of limb, axis and device tell its instances apart."""
        return tuple(name for name in ("limb", "axis", "device") if name in placeholders(self.template))


@dataclass(frozen=True)
class TypedField:
    """One signal, or one of every axis."""

    name: str
    """of the attribute"""
    signal: str
    """name in the DBC, with {axis}"""
    axes: int
    """how many the message carries; 0: one signal"""
    kind: Literal["float", "int", "bool"]
    choices: dict[int, str]
    """raw value → name, where the DBC has a table"""
    complete: bool
    """every raw value has a name"""
    bits: int
    scale: float
    low: float
    high: float
    """physical; both ends included"""
    unit: str
    log: tuple[float, float] | None
    comment: str
    meaning: Field | None

    @property
    def bounded(self) -> bool:
        """It travels in equal steps from `low` to `high`."""
        return not self.log and self.high < _LARGEST[32]

    @property
    def range(self) -> str:
        """What fits, for people."""
        if self.kind == "bool":
            return "False or True"
        if self.log:
            return f"0, or {self.log[0]:g} to {self.log[1]:g}"
        if not self.bounded:
            return "a finite number"
        return f"{self.low:.10g} to {self.high:.10g}"

    def check(self, value: Number, where: str) -> float:
        """A value as the codec takes it: physical, or the raw value of a logarithmic scale.

        Raises ValueError with `where`, value, range and unit.
        """
        unit = f" {self.unit}" if self.unit else ""
        try:
            number = float(value)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{where}: {value!r}; expected {self.range}{unit}") from error
        slack = 1e-6 * self.scale
        if not math.isfinite(number) or not self.low - slack <= number <= self.high + slack:
            raise ValueError(f"{where}: {value}{unit}; expected {self.range}{unit}")
        if self.kind != "float" and number != round(number):
            raise ValueError(f"{where}: {value}; expected a whole number, {self.range}{unit}")
        return self._log_raw(number) if self.log else number

    def meant(self, value: float) -> Number:
        """What the codec's value means."""
        if self.log:
            low, high = self.log
            return 0.0 if value == 0 else low * (high / low) ** ((value - 1) / ((1 << self.bits) - 2))
        return bool(value) if self.kind == "bool" else round(value) if self.kind == "int" else value

    def _log_raw(self, number: float) -> float:
        assert self.log
        (low, high), top = self.log, (1 << self.bits) - 1
        if number < 0.5 * low:
            return 0.0
        return min(max(round(1 + (top - 1) * math.log(number / low) / math.log(high / low)), 1), top)


def snake(name: str) -> str:
    """TemperatureRotor_{axis} → temperature_rotor."""
    made = re.sub(r"\W", "_", _HUMP.sub("_", _SINGLE.sub("", name))).strip("_").lower()
    return f"{made}_" if keyword.iskeyword(made) or made in _TAKEN or not made.isidentifier() else made


def kinds(family: Family) -> list[Kind]:
    """Every message of a family: those with a role, then what else its DBC has."""
    made: list[Kind] = []
    for role in sorted(family.messages):
        message = family.messages[role]
        name = _SINGLE.sub("", message.message).strip("_")
        if message.payloads or name in {kind.name for kind in made}:
            name = role.name.title().replace("_", "")
        made.append(Kind(name, role, message.message, message))
    known = {family.layout(role, **numbers).name for role in family.messages for numbers in family.instances(role)}
    for other in family.codec.database.messages:
        if other.name not in known and not other.is_multiplexed():
            made.append(Kind(other.name, None, other.name, Message(message=other.name)))
    return made


def fields(family: Family, kind: Kind) -> tuple[TypedField, ...]:
    """A message's fields in the DBC's order, without those that the codec fills in by itself: CRC and constants."""
    first = {"limb": 0, "axis": 0, "device": 0}
    definition = family.codec.database.get_message_by_name(kind.template.format_map(first))
    entries = dict(_entries(kind.message))
    meant: dict[str, tuple[str, Field | None, Signal, int]] = {}
    for template, (meaning, signal) in entries.items():
        repeated = "axis" in placeholders(template) and "axis" not in kind.numbers
        for axis in range(family.axes if repeated else 1):
            name = template.format_map({**first, "axis": axis})
            meant[name] = (template, meaning, signal, family.axes if repeated else 0)
    left_out = {name for name, (_, meaning, signal, _) in meant.items() if meaning is Field.CRC}
    left_out |= {name.format_map(first) for name in kind.message.constants}
    made: dict[str, TypedField] = {}
    for item in definition.signals:
        template, meaning, signal, axes = meant.get(item.name, (item.name, None, Signal(signal=item.name), 0))
        if item.name in left_out or template in {field.signal for field in made.values()}:
            continue
        name = snake(template)
        while name in made or name in kind.numbers:
            name += "_"
        made[name] = _field(name, template, axes, item, meaning, signal)
    return tuple(made.values())


def _entries(message: Message) -> Iterator[tuple[str, tuple[Field | None, Signal]]]:
    for key, given in message.fields.items():
        if name := signal_of(given).signal:
            yield name, (Field[key.upper()], signal_of(given))
    for given in message.columns.values():
        if name := signal_of(given).signal:
            yield name, (Field.COLUMN, signal_of(given))


def _field(name: str, template: str, axes: int, item: DbcSignal, meaning: Field | None, signal: Signal) -> TypedField:
    scale, offset, bits = float(item.scale), float(item.offset), item.length
    low_raw, high_raw = (-(1 << bits - 1), (1 << bits - 1) - 1) if item.is_signed else (0, (1 << bits) - 1)
    low, high = sorted((low_raw * scale + offset, high_raw * scale + offset))
    if item.is_float:
        low, high = -_LARGEST[bits], _LARGEST[bits]
    elif item.minimum is not None and item.maximum is not None and item.minimum < item.maximum:
        low, high = max(low, float(item.minimum)), min(high, float(item.maximum))
    if signal.log:
        low, high = 0.0, float(signal.log[1])
    whole = not item.is_float and not signal.log and scale == round(scale) and offset == round(offset)
    counted = whole and (not item.unit or meaning in _WHOLE)
    choices = {int(raw): str(text) for raw, text in sorted((item.choices or {}).items())} if counted else {}
    kind: Literal["float", "int", "bool"] = "int" if counted else "float"
    if counted and bits == 1 and not item.is_signed and not choices:
        kind = "bool"
    return TypedField(
        name=name, signal=template, axes=axes, kind=kind, choices=choices,
        complete=len(choices) == high_raw - low_raw + 1, bits=bits, scale=scale, low=low, high=high,
        unit=_unit(meaning) if signal.log else item.unit or "", log=signal.log, comment=item.comment or "",
        meaning=meaning,
    )  # fmt: skip


def _unit(meaning: Field | None) -> str:
    """Of a logarithmic scale, whose DBC can't say it."""
    return {Field.STIFFNESS: "N*m/rad", Field.DAMPING: "N*m*s/rad"}.get(meaning, "") if meaning is not None else ""
