"""A drive family as data: a folder with FAMILY.dbc, which lays the frames out, and family.yaml, which says what they mean.

Families are found by folder: the user's workspace (`drives/`) first, then hal/drives. docs/drives.md tells how to write one.
"""

from __future__ import annotations

import functools
import string
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from hal.can.codec import Codec
from hal.can.layout import MessageLayout
from hal.device import COMMANDED, MEASURED
from hal.drives import crc
from hal.drives.fields import Field, Role
from hal.drives.lifecycle import Command, State
from handrail import config, workspace


class Signal(msgspec.Struct, kw_only=True, forbid_unknown_fields=True, frozen=True):
    """How one field travels; the short form in YAML is the signal's name alone."""

    signal: str = ""
    """name in the DBC, with {axis} where a message carries several axes; empty: nothing travels, `constant` is what is meant"""
    log: tuple[Annotated[float, msgspec.Meta(gt=0)], Annotated[float, msgspec.Meta(gt=0)]] | None = None
    """raw 0 is 0; raw 1 to the largest are these two values, ends included, and what lies between on a logarithmic scale"""
    values: dict[str, int | str] | None = None
    """raw value → the field's: a number, or a name of hal.drives.lifecycle's State; raw values that are left out mean 0"""
    constant: int | str | None = None
    """raw value that the signal always has, a frame with another is refused; may be a sum over {limb}, {axis}"""


class Message(msgspec.Struct, kw_only=True, forbid_unknown_fields=True, frozen=True):
    """One message: which one of the DBC, and what its signals are."""

    message: str
    """name in the DBC: with {limb} one a limb, with {axis} too one an axis, with {device} one a device"""
    fields: dict[str, str | Signal] = {}
    """hal.drives.fields.Field → signal"""
    columns: dict[str, str | Signal] = {}
    """devices: name of each column of DeviceState.values or DeviceCommand.values → signal"""
    constants: dict[str, int | str] = {}
    """signals that always have the same raw value → that value, a number or a sum over {limb} and {axis}"""
    payloads: dict[str, str] = {}
    """control without signals: hal.drives.lifecycle.Command → the eight bytes of a frame, in hexadecimal"""


class _File(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    name: str
    title: str
    text: str
    serves: Literal["joints", "devices"]
    protocol_version: Annotated[int, msgspec.Meta(ge=0)] = 0
    limbs: Annotated[int, msgspec.Meta(ge=0, le=64)] = 0
    axes: Annotated[int, msgspec.Meta(ge=0, le=16)] = 0
    devices: Annotated[int, msgspec.Meta(ge=0, le=64)] = 0
    every: Annotated[int, msgspec.Meta(ge=1, le=255)] = 1
    crc: str = ""
    crc_bytes: tuple[int, int] | None = None
    parameters: Literal["none", "standard"] = "none"
    lifecycle: Literal["cia402", "enable"] = "cia402"
    modes: tuple[Literal["damping", "torque", "impedance", "position"], ...] = (
        "damping",
        "torque",
        "impedance",
        "position",
    )
    messages: dict[str, Message]


@dataclass(frozen=True)
class Family:
    """A drive family, read and checked."""

    name: str
    title: str
    text: str
    folder: Path
    serves: Literal["joints", "devices"]
    protocol_version: int
    """what the drives' protocol_version parameter must read; 0: they have none"""
    limbs: int
    axes: int
    """what the identifiers have room for"""
    devices: int
    """what the identifiers have room for"""
    every: int
    """devices: status comes, and commands go, every so many host cycles"""
    algorithm: int
    """of every CRC, a number of hal.drives.crc; −1: none"""
    crc_bytes: tuple[int, int] | None
    """which bytes a CRC is over, end exclusive; None: all before it"""
    parameters: bool
    """drives know the standard dictionary (hal.drives.parameters)"""
    short_ladder: bool
    """drives know enabled and disabled only: disabled reads as switched on"""
    modes: tuple[str, ...]
    """names of hal.joint.Mode that the drives realise"""
    messages: Mapping[Role, Message]
    codec: Codec

    @property
    def dbc(self) -> Path:
        """The family's DBC file."""
        return self.folder / f"{self.name}.dbc"

    def layout(self, role: Role, **numbers: int) -> MessageLayout:
        """The DBC message of a role for a limb, axis or device. Raises KeyError when it has none."""
        return self.codec.layout(self.messages[role].message.format_map(numbers))

    def columns(self, role: Role) -> tuple[str, ...]:
        """Names of a device's columns, in order; empty when it has no such message."""
        return tuple(self.messages[role].columns) if role in self.messages else ()

    def instances(self, role: Role) -> list[dict[str, int]]:
        """The numbers {limb, axis, device} of every message that a role has room for."""
        keys = placeholders(self.messages[role].message)
        limbs = range(self.limbs) if "limb" in keys else (0,)
        axes = range(self.axes) if "axis" in keys else (0,)
        devices = range(self.devices) if "device" in keys else (0,)
        return [{"limb": limb, "axis": axis, "device": device} for limb in limbs for axis in axes for device in devices]


def placeholders(text: str) -> set[str]:
    """The {names} in a text."""
    return {name for _, name, _, _ in string.Formatter().parse(text) if name}


def folders() -> dict[str, Path]:
    """Family → its folder, of all there are; a user's own comes before a built-in one of the same name."""
    found: dict[str, Path] = {}
    for place in workspace.search_path("drives", "hal", "drives"):
        for file in sorted(place.glob("*/family.yaml")):
            found.setdefault(file.parent.name, file.parent)
    return found


def dbc_files() -> dict[str, Path]:
    """Family → DBC file, of all there are; a user's own come first."""
    files = {name: folder / f"{name}.dbc" for name, folder in folders().items()}
    return {name: file for name, file in files.items() if file.is_file()}


def load(name: str) -> Family:
    """A family by name. Raises config.ConfigError with file, line, field and expectation; naming what there is."""
    known = folders()
    if name not in known:
        raise config.ConfigError(
            name, None, "family", f"no such drive family; expected one of {', '.join(sorted(known))}"
        )
    return read(known[name])


@functools.cache
def read(folder: Path) -> Family:
    """The family in a folder. Raises config.ConfigError with file, line, field and expectation."""
    document = config.read(folder / "family.yaml")
    file = document.convert(_File)
    if file.name != folder.name:
        raise document.error("name", f"got {file.name!r}; expected the folder's name, {folder.name!r}")
    if file.crc and file.crc not in crc.NAMES:
        raise document.error("crc", f"got {file.crc!r}; expected one of {', '.join(crc.NAMES)}")
    try:
        codec = Codec.from_file(folder / f"{file.name}.dbc")
    except ValueError as error:
        raise config.ConfigError(folder / f"{file.name}.dbc", None, "", str(error)) from error
    messages = {}
    for key, message in file.messages.items():
        if key.upper() not in Role.__members__:
            raise document.error(f"messages.{key}", f"expected one of {', '.join(role.name.lower() for role in Role)}")
        messages[Role[key.upper()]] = message
    family = Family(
        name=file.name, title=file.title, text=file.text.strip(), folder=folder, serves=file.serves,
        protocol_version=file.protocol_version, limbs=file.limbs, axes=file.axes, devices=file.devices, every=file.every,
        algorithm=crc.NAMES.index(file.crc) if file.crc else crc.NONE, crc_bytes=file.crc_bytes,
        parameters=file.parameters == "standard", short_ladder=file.lifecycle == "enable", modes=file.modes,
        messages=messages, codec=codec,
    )  # fmt: skip
    _check(document, family)
    return family


_NEEDED: dict[str, dict[Role, tuple[str, ...]]] = {
    "joints": {Role.COMMAND: ("position",), Role.CONTROL: (), Role.STATUS: ("position", "velocity", "torque")},
    "devices": {Role.DEVICE_STATUS: ()},
}


def _check(document: config.Document, family: Family) -> None:
    for role, needed in _NEEDED[family.serves].items():
        if role not in family.messages:
            raise document.error(
                f"messages.{role.name.lower()}", f"missing; a family that serves {family.serves} needs it"
            )
        for field in needed:
            if field not in family.messages[role].fields:
                raise document.error(f"messages.{role.name.lower()}.fields.{field}", "missing")
    if family.serves == "joints" and not (family.limbs and family.axes):
        raise document.error("limbs", "expected how many limbs and axes the identifiers have room for")
    if family.serves == "devices" and not family.devices:
        raise document.error("devices", "expected how many devices the identifiers have room for")
    for role, message in family.messages.items():
        where = f"messages.{role.name.lower()}"
        if unknown := placeholders(message.message) - {"limb", "axis", "device"}:
            raise document.error(
                f"{where}.message", f"got {{{unknown.pop()}}}; expected {{limb}}, {{axis}} or {{device}}"
            )
        for key in message.fields:
            if key.upper() not in Field.__members__:
                names = ", ".join(field.name.lower() for field in Field)
                raise document.error(f"{where}.fields.{key}", f"no such field; expected one of {names}")
        room = {Role.DEVICE_STATUS: MEASURED, Role.DEVICE_COMMAND: COMMANDED}.get(role, 0)
        if len(message.columns) > room:
            raise document.error(f"{where}.columns", f"got {len(message.columns)}; expected at most {room}")
        for command, payload in message.payloads.items():
            if command.upper() not in Command.__members__ or not _is_payload(payload):
                raise document.error(
                    f"{where}.payloads.{command}", f"got {payload!r}; expected eight bytes in hexadecimal"
                )
        if message.payloads and set(message.payloads) != {command.name.lower() for command in Command}:
            raise document.error(f"{where}.payloads", "expected one for each command of CiA 402")
        for numbers in family.instances(role):
            _check_message(document, family, role, where, numbers)


def _is_payload(text: str) -> bool:
    try:
        return len(bytes.fromhex(text)) == 8
    except ValueError:
        return False


def _check_message(document: config.Document, family: Family, role: Role, where: str, numbers: dict[str, int]) -> None:
    message = family.messages[role]
    try:
        layout = family.layout(role, **numbers)
        first = family.layout(role, limb=0, axis=0, device=0)
    except (KeyError, ValueError) as error:
        raise document.error(f"{where}.message", str(error.args[0])) from error
    entries: dict[str, str | Signal] = {**message.fields, **message.columns, **dict.fromkeys(message.constants, "")}
    for key, signal in entries.items():
        name = key if key in message.constants else signal_of(signal).signal
        if not name:
            continue
        axes = range(family.axes) if "axis" in placeholders(name) else (numbers["axis"],)
        for axis in axes:
            full = name.format_map({**numbers, "axis": axis})
            if full not in layout.signals:
                raise document.error(f"{where}.fields.{key}", f"message {layout.name}: no signal {full}")
            if full in first.signals:
                mine, its = layout.rows([full]), first.rows([full])
                if not all((a == b).all() for a, b in zip(mine, its, strict=True)):
                    raise document.error(f"{where}.message", f"{layout.name}: {full} lies unlike in {first.name}")
            length = int(layout.rows([full])[0][0, 1])
            if isinstance(signal, Signal) and (signal.log or signal.values) and length > 8:
                raise document.error(
                    f"{where}.fields.{key}", f"{full} has {length} bits; expected at most 8 for a table"
                )
    if "crc" in message.fields and family.algorithm < 0:
        raise document.error("crc", f"missing; {where} has a CRC: expected one of {', '.join(crc.NAMES)}")
    if "crc" in message.fields:
        name = signal_of(message.fields["crc"]).signal.format_map(numbers)
        start, length, _ = (int(value) for value in layout.rows([name])[0][0])
        if start % 8 or length != int(crc.SPECS[family.algorithm, crc.WIDTH]):
            raise document.error(
                f"{where}.fields.crc", f"{name}: expected the algorithm's width, beginning with a byte"
            )


def signal_of(given: str | Signal) -> Signal:
    """The long form of a field's entry."""
    return Signal(signal=given) if isinstance(given, str) else given


def number(given: int | str, numbers: Mapping[str, int]) -> int:
    """The value of a constant: a number, or sums, products and masks of numbers and {limb}, {axis}, {device}.

    Raises ValueError for anything else.
    """
    if isinstance(given, int):
        return given
    total: Any = 0
    for term in given.format_map(numbers).split("+"):
        product = 1
        for factor in term.split("*"):
            product *= int(factor.strip(), 0)
        total += product
    return total


def table(values: Mapping[str, int | str]) -> dict[int, int]:
    """raw → value, names of CiA 402 states as their numbers. Raises ValueError for a name that is none."""
    made = {}
    for raw, value in values.items():
        if isinstance(value, str) and value.upper() not in State.__members__:
            raise ValueError(f"{value}: expected one of {', '.join(state.name.lower() for state in State)}")
        made[int(raw, 0)] = int(State[value.upper()]) if isinstance(value, str) else value
    return made
