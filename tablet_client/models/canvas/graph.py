"""What is drawn of a composite node's text: its parts, what flows between them, and what goes in and out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from handrail import yaml_file

IN, OUT = ":in", ":out"
"""the boxes that what comes from outside, and goes there, stands in; no part can be called so"""


@dataclass(frozen=True)
class Part:
    name: str
    node: str
    """of the library"""
    params: Mapping[str, Any]


@dataclass(frozen=True)
class Wire:
    """From a part's output or an own input to a part's input or an own output; PORT of IN and OUT are own ports."""

    source: tuple[str, str]
    """box, port"""
    target: tuple[str, str]


@dataclass(frozen=True)
class Graph:
    title: str
    parts: Mapping[str, Part]
    wires: Mapping[str, str]
    """PART.input → PART.output"""
    inputs: Mapping[str, tuple[str, ...]]
    """own input → where it goes"""
    params: Mapping[str, tuple[str, ...]]
    outputs: Mapping[str, str]
    every: float | None
    """s"""

    def all_wires(self) -> list[Wire]:
        """In the file's order; what leads from or to no part is left out."""
        found = [Wire(_place(source), _place(to)) for to, source in self.wires.items()]
        found += [Wire((IN, own), _place(to)) for own, places in self.inputs.items() for to in places]
        found += [Wire(_place(source), (OUT, own)) for own, source in self.outputs.items()]
        known = {*self.parts, IN, OUT}
        return [wire for wire in found if wire.source[0] in known and wire.target[0] in known]

    def source_of(self, to: str) -> str:
        """What a part's input gets: PART.output, `:in.NAME`, or nothing (empty)."""
        if to in self.wires:
            return self.wires[to]
        return next((f"{IN}.{own}" for own, places in self.inputs.items() if to in places), "")


def read(text: str) -> Graph:
    """A composite's text. What is no part or no place is left out, as while somebody types; ValueError: it has no parts."""
    try:
        data = yaml_file.parse(text)
    except yaml_file.NotYAML as problem:
        raise ValueError(f"line {problem.line}: {problem.problem}" if problem.line else problem.problem) from problem
    if not isinstance(data, Mapping) or not isinstance(data.get("nodes"), Mapping):
        raise ValueError("nodes: missing; expected the file of a node that is made of nodes")
    parts = {}
    for name, each in data["nodes"].items():
        about = each if isinstance(each, Mapping) else {}
        params = about.get("params")
        parts[name] = Part(name, str(about.get("node") or ""), params if isinstance(params, Mapping) else {})
    every = data.get("every")
    return Graph(
        str(data.get("title") or ""),
        parts,
        {to: source for to, source in _texts(data.get("wires")).items() if isinstance(source, str)},
        {own: _places(to) for own, to in _texts(data.get("inputs")).items()},
        {own: _places(to) for own, to in _texts(data.get("params")).items()},
        {own: source for own, source in _texts(data.get("outputs")).items() if isinstance(source, str)},
        float(every) if isinstance(every, int | float) and not isinstance(every, bool) else None,
    )


def _texts(given: Any) -> Mapping[str, Any]:
    return given if isinstance(given, Mapping) else {}


def _places(given: Any) -> tuple[str, ...]:
    return tuple(str(each) for each in (given if isinstance(given, list) else [given]) if each)


def _place(text: str) -> tuple[str, str]:
    part, _, port = text.partition(".")
    return part, port
