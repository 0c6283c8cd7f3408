"""YAML that is edited by a tool: what it is made of by ruamel.yaml, which keeps comments, and the lines that a field takes."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.constructor import RoundTripConstructor
from ruamel.yaml.error import YAMLError
from ruamel.yaml.nodes import ScalarNode
from ruamel.yaml.representer import RoundTripRepresenter

STEP = 2
"""columns by which what is in a field stands further in"""


@dataclass(frozen=True)
class Null:
    """Nothing, as it is written: empty, null or ~."""

    text: str


class _Constructor(RoundTripConstructor):
    def construct_yaml_null(self, node: ScalarNode) -> Null:
        return Null(node.value)


class _Representer(RoundTripRepresenter):
    def represent_null(self, data: Null) -> Any:
        return self.represent_scalar("tag:yaml.org,2002:null", data.text)


_Constructor.add_constructor("tag:yaml.org,2002:null", _Constructor.construct_yaml_null)
_Representer.add_representer(Null, _Representer.represent_null)


def block_lines(lines: list[str], key: int, indent: int) -> tuple[int, int, int]:
    """First line, that of its name, and end of what stands at a key of a block mapping, with the comments right above it."""
    end = last = key + 1
    while end < len(lines) and (_quiet(lines[end]) or _indent(lines[end]) > indent):
        if not _quiet(lines[end]) or (lines[end].strip() and _indent(lines[end]) > indent):
            last = end + 1
        end += 1
    first = key
    while first and lines[first - 1].strip().startswith("#") and _indent(lines[first - 1]) == indent:
        first -= 1
    return first, key, last


def _quiet(line: str) -> bool:
    """Blank, or a comment alone."""
    return not line.strip() or line.strip().startswith("#")


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip(" "))


def shifted(line: str, indent: int) -> str:
    """A line so much further in."""
    return " " * indent + line if line.strip() else ""


def kept(value: Any) -> Any:
    """The same of ruamel's types; what holds no mapping is written on one line."""
    if value is None:
        return Null("null")
    if isinstance(value, Mapping):
        mapping = CommentedMap((key, kept(each)) for key, each in value.items())
        if value and not any(isinstance(each, Mapping | list | tuple) for each in value.values()):
            mapping.fa.set_flow_style()
        return mapping
    if isinstance(value, list | tuple):
        sequence = CommentedSeq(kept(each) for each in value)
        if not any(isinstance(each, Mapping | list | tuple) for each in value):
            sequence.fa.set_flow_style()
        return sequence
    return value


def _yaml() -> YAML:
    yaml = YAML(typ="rt")
    yaml.Constructor, yaml.Representer = _Constructor, _Representer
    yaml.width = 10_000  # lines are as long as they were
    yaml.preserve_quotes = True
    yaml.indent(mapping=STEP, sequence=2 * STEP, offset=STEP)
    return yaml


def loaded(text: str) -> Any:
    """ruamel's types; raises ValueError where it is no YAML."""
    try:
        return _yaml().load(text)
    except YAMLError as problem:
        raise ValueError(f"not YAML: {problem}") from problem


def dumped(data: Any) -> str:
    """The text of ruamel's types."""
    stream = io.StringIO()
    _yaml().dump(data, stream)
    return stream.getvalue()
