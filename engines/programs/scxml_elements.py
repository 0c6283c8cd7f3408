"""An SCXML file as its elements, each with its line, and what of them and their attributes a program can say."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.parsers import expat

from handrail.config import ConfigError

OWN = "https://handrail/scxml"
"""namespace of attributes of ours: `resource`, `template`, `parameter`, `unit`, `min`, `max` of `<data>`"""
SCXML = "http://www.w3.org/2005/07/scxml"
ATTRIBUTES = {
    "scxml": {"name", "initial", "version", "datamodel", "binding"},
    "state": {"id", "initial"},
    "parallel": {"id"},
    "final": {"id"},
    "history": {"id", "type"},
    "transition": {"event", "cond", "target", "type"},
    "onentry": set(),
    "onexit": set(),
    "assign": {"location", "expr"},
    "raise": {"event"},
    "send": {"event", "delay", "delayexpr", "type", "target", "namelist"},
    "log": {"label", "expr"},
    "if": {"cond"},
    "elseif": {"cond"},
    "else": set(),
    "data": {"id", "expr", *(f"{OWN} {name}" for name in ("resource", "template", "parameter", "unit", "min", "max"))},
    "invoke": {"type", "id"},
    "param": {"name", "expr"},
}
"""element → its attributes that a program has"""


@dataclass
class Element:
    """One element of the file."""

    tag: str
    line: int
    attributes: dict[str, str]
    children: list[Element] = field(default_factory=list)


def parsed(file: Path) -> Element:
    """The file's top element. Raises ConfigError with file, line and element; OSError."""
    parser = expat.ParserCreate("utf-8", " ")  # as programs are kept and hashed, whatever the file declares
    whole = Element("", 0, {})
    inside = [whole]

    def start(tag: str, attributes: dict[str, str]) -> None:
        space, _, name = tag.rpartition(" ")
        line = parser.CurrentLineNumber
        if space not in ("", SCXML):
            raise ConfigError(file, line, f"<{name}>", f"of {space!r}, which no program has; expected SCXML's elements")
        inside[-1].children.append(Element(name, line, attributes))
        inside.append(inside[-1].children[-1])

    def doctype(*_: Any) -> None:
        raise ConfigError(file, parser.CurrentLineNumber, "<!DOCTYPE>", "a document type; expected none")

    parser.StartElementHandler = start

    def words(text: str) -> None:
        if text.strip() and inside[-1].tag in ATTRIBUTES:  # others are refused by name
            place = inside[-1]
            shown = text.strip()[:40]
            raise ConfigError(
                file, parser.CurrentLineNumber, f"<{place.tag}>", f"has {shown!r} in it; expected elements"
            )

    parser.CharacterDataHandler = words
    parser.EndElementHandler = lambda tag: inside.pop()
    parser.StartDoctypeDeclHandler = doctype
    try:
        parser.Parse(file.read_bytes(), True)
    except expat.ExpatError as problem:
        raise ConfigError(file, problem.lineno, "", f"not XML: {expat.ErrorString(problem.code)}") from problem
    return whole.children[0]
