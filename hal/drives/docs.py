"""The reference of a drive family, made from its description: every message, signal and meaning as Markdown."""

from __future__ import annotations

from pathlib import Path

from cantools.database.can import Signal as DbcSignal

from hal.drives import crc
from hal.drives.family import Family, placeholders, signal_of
from hal.drives.fields import Role
from hal.drives.lifecycle import Command
from hal.drives.parameters import DICTIONARY

ROLES = {
    Role.CONTROL: "host → drives: where their lives shall go",
    Role.COMMAND: "host → drives: set-points",
    Role.STATUS: "drive → host: answer of one drive",
    Role.MASTER_STATUS: "limb's master → host: answer for all axes",
    Role.SYNC: "host → all: the cycle is complete",
    Role.HOLD_TIME: "host → all: time stands",
    Role.PARAMETER_REQUEST: "host → drive: read or write a parameter",
    Role.PARAMETER_REPLY: "drive → host: what became of the request",
    Role.DEVICE_COMMAND: "host → device",
    Role.DEVICE_STATUS: "device → host",
}


def reference_file(name: str) -> Path:
    """Where the reference of a family that Handrail brings lies in the repository."""
    return Path(__file__).resolve().parents[2] / "docs" / "reference" / f"{name}.md"


def reference(family: Family) -> str:
    """The whole reference as Markdown."""
    lines = [
        f"# {family.title}",
        "",
        f"*Family `{family.name}`, made from its description by `handrail drives docs {family.name} --write`; do not edit.*",
        "",
        family.text,
        "",
        *_facts(family),
    ]
    for role in sorted(family.messages):
        lines += ["", *_message(family, role)]
    if family.parameters:
        lines += ["", *_parameters()]
    return "\n".join(lines) + "\n"


def _facts(family: Family) -> list[str]:
    if family.serves == "joints":
        room = f"{family.limbs} limbs of {family.axes} axes"
    else:
        room = f"{family.devices} devices, a frame every {family.every} cycles of the host"
    facts = [("serves", family.serves), ("identifiers for", room)]
    if family.protocol_version:
        facts.append(("protocol version", str(family.protocol_version)))
    if family.serves == "joints":
        facts.append(("modes", ", ".join(family.modes)))
        facts.append(("life", "enabled or disabled" if family.short_ladder else "CiA 402"))
    if family.algorithm >= 0:
        over = "all bytes before it" if family.crc_bytes is None else "bytes {} to {}".format(*family.crc_bytes)
        facts.append(("CRC", f"{crc.NAMES[family.algorithm]} over {over}"))
    return ["| | |", "| --- | --- |", *(f"| {name} | {value} |" for name, value in facts)]


def _message(family: Family, role: Role) -> list[str]:
    message = family.messages[role]
    instances = family.instances(role)
    layouts = [family.layout(role, **numbers) for numbers in instances]
    definition = family.codec.database.get_message_by_name(layouts[0].name)
    ids = sorted(layout.frame_id for layout in layouts)
    where = f"0x{ids[0]:03X}" if len(ids) == 1 else f"0x{ids[0]:03X} to 0x{ids[-1]:03X}"
    kind = "CAN FD" if definition.is_fd else "classic CAN"
    lines = [
        f"## {message.message}: {role.name.lower()}",
        "",
        f"{ROLES[role]}. Identifiers {where}, {definition.length} bytes, {kind}. {of_any(definition.comment)}",
        "",
    ]
    if message.payloads:
        lines += ["| command | data |", "| --- | --- |"]
        return lines + [f"| {c.name.lower()} | `{message.payloads[c.name.lower()]}` |" for c in Command]
    meanings = {**{key: signal_of(v) for key, v in {**message.fields, **message.columns}.items()}}
    of_signal: dict[str, list[str]] = {}
    for key, signal in meanings.items():
        if signal.signal:
            scale = f", logarithmic {signal.log[0]:g} to {signal.log[1]:g}" if signal.log else ""
            of_signal.setdefault(signal.signal.replace("{axis}", "0"), []).append(f"{key}{scale}")
    for name, value in message.constants.items():
        of_signal.setdefault(name, []).append(f"always {value}")
    repeated = any("axis" in placeholders(signal.signal) for signal in meanings.values())
    lines += ["| signal | bits | range | unit | means | |", "| --- | --- | --- | --- | --- | --- |"]
    for item in definition.signals:
        if not repeated or not item.name.rpartition("_")[2].isdigit() or item.name.endswith("_0"):
            lines.append(_signal(item, of_signal.get(item.name, [])))
    if repeated:
        lines += ["", f"Signals that end in `_0` come again for every axis, up to `_{family.axes - 1}`."]
    return lines


def of_any(comment: str | None) -> str:
    """A first message's comment for all of them."""
    return (comment or "").replace("limb 0", "a limb").replace(", axis 0", ", an axis").replace("motor 1", "a motor")


def _signal(signal: DbcSignal, meanings: list[str]) -> str:
    sign = "float" if signal.is_float else ("signed" if signal.is_signed else "unsigned")
    order = ", big-endian" if signal.byte_order == "big_endian" else ""
    span = "" if signal.is_float else f"{signal.minimum:.6g} to {signal.maximum:.6g}, step {signal.scale:.6g}"
    words = (signal.comment or "") + (
        f" {', '.join(f'{raw}: {name}' for raw, name in signal.choices.items())}" if signal.choices else ""
    )
    where = f"{signal.start}, {signal.length} {sign}{order}"
    return f"| {signal.name} | {where} | {span} | {signal.unit or ''} | {'; '.join(meanings)} | {words.strip()} |"


def _parameters() -> list[str]:
    lines = ["## Parameters", "", "float32 each, by ParameterRequest and ParameterReply.", ""]
    lines += ["| index | name | unit | access | |", "| --- | --- | --- | --- | --- |"]
    for parameter, entry in DICTIONARY.items():
        access = ("r" if entry.readable else "") + ("w" if entry.writable else "")
        lines.append(f"| 0x{parameter:02X} | {parameter.name.lower()} | {entry.unit} | {access} | {entry.text} |")
    return lines
