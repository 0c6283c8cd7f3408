"""YAML 1.2 into dicts and lists that know their lines.

libyaml reads the text; what words and numbers mean is the core schema's (YAML 1.2.2, §10.3.2): ``on``, ``no`` and dates are words,
``0o17`` is a number.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Any

import yaml
from yaml.events import (
    AliasEvent,
    DocumentStartEvent,
    Event,
    MappingEndEvent,
    MappingStartEvent,
    ScalarEvent,
    SequenceEndEvent,
    SequenceStartEvent,
    StreamEndEvent,
)

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_DEPTH = 200
"""of mappings and lists in each other"""
_DIGITS = 300
"""of an integer; a longer one is a word: Python reads no more than some thousand, and a float holds no more"""
_WORDS: dict[str, Any] = {
    **dict.fromkeys(("", "~", "null", "Null", "NULL"), None),
    **dict.fromkeys(("true", "True", "TRUE"), True),
    **dict.fromkeys(("false", "False", "FALSE"), False),
    **dict.fromkeys((".inf", ".Inf", ".INF", "+.inf", "+.Inf", "+.INF"), float("inf")),
    **dict.fromkeys(("-.inf", "-.Inf", "-.INF"), float("-inf")),
    **dict.fromkeys((".nan", ".NaN", ".NAN"), float("nan")),
}
_INTEGER = re.compile(r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?")
_TAG = "tag:yaml.org,2002:"
_KINDS: dict[str, Callable[[Any], bool]] = {
    "null": lambda value: value is None,
    "bool": lambda value: isinstance(value, bool),
    "int": lambda value: isinstance(value, int) and not isinstance(value, bool),
    "float": lambda value: isinstance(value, int | float) and not isinstance(value, bool),
}


class NotYAML(ValueError):
    """Text that is no YAML, or none of ours; `line` counts from 1, None where there is none to name."""

    def __init__(self, line: int | None, problem: str):
        self.line, self.problem = line, problem
        super().__init__(problem)


class Map(dict[str, Any]):
    """A mapping; keys are texts, as they are written."""

    __slots__ = ("lines",)

    def __init__(self) -> None:
        super().__init__()
        self.lines: dict[str, int] = {}
        """key → line, from 1"""


class Seq(list[Any]):
    """A list."""

    __slots__ = ("lines",)

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[int] = []
        """of each element, from 1"""


def parse(text: str) -> Any:
    """The one document of a text: `Map`, `Seq` or a scalar; None where there is none. Raises NotYAML."""
    try:
        return _Composer(yaml.parse(text, Loader=_LOADER)).document()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        why = " ".join(part for part in (error.problem, error.context) if part)
        raise NotYAML(mark.line + 1 if mark else None, f"not YAML: {why}") from error
    except yaml.YAMLError as error:  # a character that no YAML has
        raise NotYAML(None, f"not YAML: {' '.join(str(error).split())}") from error


class _Composer:
    def __init__(self, events: Iterator[Event]):
        self._events = events
        self._named: dict[str, Any] = {}

    def document(self) -> Any:
        next(self._events)  # the stream's start
        if isinstance(next(self._events), StreamEndEvent):
            return None
        found = self._node(next(self._events), 0)
        next(self._events)  # the document's end
        if isinstance(more := next(self._events), DocumentStartEvent):
            raise NotYAML(_line(more), "not a file of ours: a second document; expected one")
        return found

    def _node(self, event: Event, depth: int) -> Any:
        node: Any
        if isinstance(event, ScalarEvent):
            node = _scalar(event)
        elif isinstance(event, AliasEvent):
            if event.anchor not in self._named:
                raise NotYAML(_line(event), f"not YAML: found undefined alias {event.anchor!r}")
            return self._named[event.anchor]
        elif depth >= _DEPTH:
            raise NotYAML(_line(event), "not a file of ours: nested too deeply")
        elif isinstance(event, MappingStartEvent):
            node = self._map(event, depth + 1)
        else:
            node = self._seq(event, depth + 1)
        if event.anchor is not None:
            self._named[event.anchor] = node
        return node

    def _map(self, start: MappingStartEvent, depth: int) -> Map:
        _check_tag(start, "map")
        node, below = Map(), []
        while not isinstance(event := next(self._events), MappingEndEvent):
            if not isinstance(event, ScalarEvent):
                raise NotYAML(_line(event), "not a file of ours: a key that is no text; expected a name")
            key, line = event.value, _line(event)
            value = self._node(next(self._events), depth)
            if key == "<<" and event.implicit[0]:
                below += value if isinstance(value, list) else [value]
                if not all(isinstance(each, Map) for each in below):
                    raise NotYAML(line, "not YAML: << takes mappings")
                continue
            if key in node:
                raise NotYAML(line, f"not YAML: found duplicate key {key!r} (first in line {node.lines[key]})")
            node[key], node.lines[key] = value, line
        for each in below:
            for key in each.keys() - node.keys():
                node[key], node.lines[key] = each[key], each.lines[key]
        return node

    def _seq(self, start: SequenceStartEvent, depth: int) -> Seq:
        _check_tag(start, "seq")
        node = Seq()
        while not isinstance(event := next(self._events), SequenceEndEvent):
            node.lines.append(_line(event))
            node.append(self._node(event, depth))
        return node


def _scalar(event: ScalarEvent) -> Any:
    text: str = event.value
    if event.tag is not None and event.tag != "!":
        kind = event.tag.removeprefix(_TAG)
        if kind == "str":
            return text
        value = _meant(text)
        if kind not in _KINDS or not _KINDS[kind](value):
            raise NotYAML(_line(event), f"not a file of ours: the tag {event.tag!r} of {text!r}; expected none")
        return float(value) if kind == "float" else value
    return _meant(text) if event.implicit[0] else text


def _meant(text: str) -> Any:
    """What a word without quotes stands for."""
    if text in _WORDS:
        return _WORDS[text]
    if text[0] in "-+.0123456789":
        if _INTEGER.fullmatch(text):
            if len(text) > _DIGITS:
                return text
            return int(text, 0) if text[:2] in ("0o", "0x") else int(text)
        if _FLOAT.fullmatch(text):
            return float(text)
    return text


def _check_tag(start: Event, kind: str) -> None:
    if start.tag not in (None, "!", _TAG + kind):
        raise NotYAML(_line(start), f"not a file of ours: the tag {start.tag!r}; expected none")


def _line(event: Event) -> int:
    return int(event.start_mark.line) + 1
