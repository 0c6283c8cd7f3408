"""The source of a family's typed messages, made from its description: what `handrail drives types` writes, and what runs as it is
for families that a user brings."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable
from enum import IntEnum
from pathlib import Path

from hal.drives.docs import ROLES, of_any
from hal.drives.family import Family
from hal.drives.fields import Field
from hal.drives.lifecycle import DriveError, State
from hal.drives.parameters import DICTIONARY, ParameterResult
from hal.drives.typed_fields import COUNTED, Kind, TypedField, fields, kinds
from hal.joint import Mode

_WIDTH = 120
_TAKEN = {"Any", "DriveParameters", "IntEnum", "Parameter", "Parameters", "TypedMessage", "AnyMessage"}


def messages_file(family: Family) -> Path:
    """Where the classes of a family that Handrail brings lie, beside its DBC."""
    return family.folder / "messages.py"


def source(family: Family) -> str:
    """A Python module: an IntEnum a table of values, a dataclass a message, and the drive's parameters where it has them."""
    told = {kind.name: () if kind.message.payloads else fields(family, kind) for kind in kinds(family)}
    enums = _Enums(told)
    classes = [_message(family, kind, told[kind.name], enums) for kind in kinds(family)]
    parameters = _parameters(family.name) if family.parameters else []
    body = "\n\n\n".join(
        ["\n".join(block) for block in [*enums.blocks(), *classes, *([parameters] if parameters else [])]]
    )
    names = [kind.name for kind in kinds(family)]
    every = " | ".join(names)
    union = every if len(every) <= _WIDTH - 13 else "(\n    " + "\n    | ".join(names) + "\n)"
    listed = ", ".join(names) + ("," if len(names) == 1 else "")
    listed = f"({listed})" if len(listed) <= _WIDTH - 13 else "(\n    " + ",\n    ".join(names) + ",\n)"
    head = _words(
        f"{_sentence(family.title)} Typed messages of the family `{family.name}`, made from its description by "
        f"`handrail drives types {family.name}`; do not edit."
    )
    end = (
        f"AnyMessage = {union}\nMESSAGES = {listed}\n\n\n"
        "def decode(message: can.Message) -> AnyMessage | None:\n"
        '    """What a frame says; None: its identifier is none of this family\'s. Raises FrameError for a damaged one."""\n'
        "    return decode_any(MESSAGES, message)\n"
    )
    return f"{head}\n\n{_imports(body, bool(parameters))}\n\n\n{body}\n\n\n{end}"


def _imports(body: str, parameters: bool) -> str:
    lines = ["from __future__ import annotations", ""]
    lines.append("from dataclasses import dataclass" + (", field" if "field(default_factory" in body else ""))
    if "(IntEnum)" in body:
        lines.append("from enum import IntEnum")
    lines += ["", "import can", ""]
    code = re.sub(r'""".*?"""', "", body, flags=re.DOTALL)
    used = set(re.findall(r"\w+", code)) | {"decode_any"}
    if "lifecycle" in used:
        lines.append("from hal.drives import lifecycle")
    ours = used - set(re.findall(r"class (\w+)", code))
    for module, words in (
        ("drive_parameters", ("DriveParameters", "Readable", "ReadWrite", "WriteOnly") if parameters else ()),
        ("lifecycle", ("DriveError", "State")),
        ("parameters", ("Parameter", "ParameterResult")),
        ("typed", ("NEXT", "NOW", "TypedMessage", "decode_any")),
    ):
        if there := [word for word in words if word in ours]:
            lines.append(f"from hal.drives.{module} import {', '.join(there)}")
    if "Mode" in ours:
        lines.append("from hal.joint import Mode")
    return "\n".join(lines)


_OURS: dict[frozenset[tuple[int, str]], type[IntEnum]] = {
    frozenset((int(member), member.name) for member in kind): kind
    for kind in (DriveError, Mode, ParameterResult, State)
}


class _Enums:
    """The tables of values, each once; one of another message's that differs is named after its message. A table that Handrail has
    a type for anyway is that type."""

    def __init__(self, told: dict[str, tuple[TypedField, ...]]):
        self._tables: dict[str, dict[int, str]] = {}
        self._taken = _TAKEN | set(told)
        self._name_of: dict[tuple[str, str], str] = {}
        for message, items in told.items():
            for item in items:
                if item.choices:
                    self._name_of[message, item.name] = self._named(message, item)

    def _named(self, message: str, item: TypedField) -> str:
        plain = item.name.title().replace("_", "")
        members = _members(item.choices)
        ours = _OURS.get(frozenset(members.items()))
        if ours is not None and ours.__name__ not in self._taken:
            self._tables[ours.__name__] = members
            return ours.__name__
        taken = self._taken | {kind.__name__ for kind in _OURS.values()}
        for name in (plain, f"{message}{plain}", f"{message}{plain}Value"):
            if name not in taken and self._tables.get(name, members) == members:
                self._tables[name] = members
                return name
        raise ValueError(f"{message}.{item.signal}: no name left for its table of values")

    def of(self, message: str, item: TypedField) -> str:
        """Name of the enum of a field; "" where it has none."""
        return self._name_of.get((message, item.name), "")

    def first(self, name: str) -> str:
        """The member that a field is to begin with: that of raw 0, else the first."""
        members = self._tables[name]
        return f"{name}.{members.get(0) or next(iter(members.values()))}"

    def blocks(self) -> Iterable[list[str]]:
        """The source of those that Handrail does not have, in the order in which they were met."""
        for name, members in self._tables.items():
            if name in {kind.__name__ for kind in _OURS.values()}:
                continue
            yield [f"class {name}(IntEnum):", *(f"    {word} = {raw}" for raw, word in members.items())]


def _members(choices: dict[int, str]) -> dict[int, str]:
    made: dict[int, str] = {}
    for raw, text in choices.items():
        word = re.sub(r"\W+", "_", text).strip("_").upper() or "EMPTY"
        word = f"N{word}" if word[0].isdigit() else word
        made[raw] = f"{word}_{raw}".replace("-", "MINUS_") if word in made.values() else word
    return made


def _message(family: Family, kind: Kind, items: tuple[TypedField, ...], enums: _Enums) -> list[str]:
    numbers = {"limb": 0, "axis": 0, "device": 0}
    definition = family.codec.database.get_message_by_name(kind.template.format_map(numbers))
    role = f" {ROLES[kind.role][0].upper()}{ROLES[kind.role][1:]}." if kind.role is not None else ""
    words = f"{_sentence(of_any(definition.comment) or kind.template)}{role}"
    lines = [
        "@dataclass(kw_only=True)",
        f"class {kind.name}(TypedMessage, family={_quoted(family.name)}, message={_quoted(kind.name)}):",
    ]
    lines += _words(words, 4).splitlines()
    lines.append("")
    for name in kind.numbers:
        room = {"limb": family.limbs, "axis": family.axes, "device": family.devices}[name]
        lines += [f"    {name}: int = 0", f'    """0 to {room - 1}"""']
    if kind.message.payloads:
        lines.append("    command: lifecycle.Command = lifecycle.Command.DISABLE_VOLTAGE")
        lines.append('    """which of the fixed frames"""')
    for item in items:
        lines += _field(kind, item, enums)
    return lines if lines[-1] else lines[:-1]


def _field(kind: Kind, item: TypedField, enums: _Enums) -> list[str]:
    enum = enums.of(kind.name, item)
    hint: str = item.kind
    default = {"float": "0.0", "int": "0", "bool": "False"}[hint]
    unit = {"N*m": "N·m", "N*m/rad": "N·m/rad", "N*m*s/rad": "N·m·s/rad", "degC": "°C", "us": "µs"}.get(
        item.unit, item.unit
    )
    said = [
        unit,
        item.range if item.kind != "bool" else "",
        f"in steps of {item.scale:g}" if item.kind == "float" and item.bounded else "",
    ]
    if item.meaning is Field.INDEX:
        hint, default, said = "Parameter | int", "Parameter.PROTOCOL_VERSION", []
    elif enum:
        hint, default, said = enum if item.complete else f"{enum} | int", enums.first(enum), []
    elif item.meaning is Field.SEQUENCE and kind.role in COUNTED:
        default = "NEXT"
    elif item.meaning is Field.TIME:
        default = "NOW"
    elif not item.low <= 0 <= item.high:
        default = repr(item.low if item.kind == "float" else round(item.low))
    if item.axes:
        hint, default = f"list[{hint}]", f"field(default_factory=lambda: [{default}] * {item.axes})"
    text = "; ".join(part for part in [", ".join(part for part in said if part), _comment(item.comment)] if part)
    lines = [f"    {item.name}: {hint} = {default}"]
    return lines + (_words(text, 4).splitlines() if text else [])


def _parameters(family: str) -> list[str]:
    lines = [f"class Parameters(DriveParameters, family={_quoted(family)}):"]
    lines += _words(
        "One drive's parameters: reading an attribute asks the drive, assigning to it writes.", 4
    ).splitlines()
    lines.append("")
    for parameter, entry in DICTIONARY.items():
        access = {(True, True): "ReadWrite", (True, False): "Readable", (False, True): "WriteOnly"}[
            entry.readable, entry.writable
        ]
        lines.append(f"    {parameter.name.lower()} = {access}(Parameter.{parameter.name})")
        lines += _words("; ".join(part for part in (entry.unit, entry.text) if part), 4).splitlines()
    return lines


def _sentence(text: str) -> str:
    return text if text.endswith((".", "!", "?")) else f"{text}."


def _comment(text: str) -> str:
    """A sentence as the end of another."""
    word = text.split(" ", 1)[0].rstrip(".")
    plain = word[1:].islower() or len(word) == 1
    return (text[:1].lower() if plain else text[:1]) + text[1:].rstrip(".")


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _words(text: str, indent: int = 0) -> str:
    """A docstring, wrapped."""
    text = " ".join(text.replace("\\", "\\\\").replace('"""', "'''").split())
    text = f'{text[:-1]}\\"' if text.endswith('"') else text
    lead = " " * indent
    if indent + len(text) + 6 <= _WIDTH:
        return f'{lead}"""{text}"""'
    lines = textwrap.wrap(text, _WIDTH - indent - 3, break_long_words=False, break_on_hyphens=False)
    return lead + f'"""{lines[0]}\n' + "\n".join(lead + line for line in lines[1:]) + '"""'
