"""SCXML files as programs: what of W3C's SCXML 1.0 a program can say becomes the same document as of a YAML file, line by line.

States, parallel states, history, finals, transitions with events, conditions and assignments are SCXML's own. `<invoke
type="prompt">` is what a state does, each `<param>` an argument of it. What has no counterpart in a program (executable content but
`<assign>` in a transition, `<script>`, `<send>`, `<raise>`) is refused by file, line and element.
"""

from __future__ import annotations

import ast
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.parsers import expat

from handrail.config import ConfigError, Document
from handrail.yaml_file import Map, Seq

SUFFIX = ".scxml"
OWN = "https://handrail/scxml"
"""namespace of attributes of ours: `resource`, `template`, `parameter`, `unit`, `min`, `max` of `<data>`"""
_SCXML = "http://www.w3.org/2005/07/scxml"
_DATAMODELS = ("null", "python", "handrail")
_ATTRIBUTES = {
    "scxml": {"name", "initial", "version", "datamodel", "binding"},
    "state": {"id", "initial"},
    "parallel": {"id"},
    "final": {"id"},
    "history": {"id", "type"},
    "transition": {"event", "cond", "target", "type"},
    "assign": {"location", "expr"},
    "data": {"id", "expr", *(f"{OWN} {name}" for name in ("resource", "template", "parameter", "unit", "min", "max"))},
    "invoke": {"type", "id"},
    "param": {"name", "expr"},
}
_STATES = ("state", "parallel", "final")


@dataclass
class _Element:
    tag: str
    line: int
    attributes: dict[str, str]
    children: list[_Element] = field(default_factory=list)


def read(file: Path) -> Document:
    """The document of a program. Raises ConfigError with file, line and element."""
    try:
        return _Reader(file).document(_parsed(file))
    except OSError as problem:
        raise ConfigError(file, None, "", f"can't be read: {problem}") from problem


def _parsed(file: Path) -> _Element:
    parser = expat.ParserCreate("utf-8", " ")  # as programs are kept and hashed, whatever the file declares
    whole = _Element("", 0, {})
    inside = [whole]

    def start(tag: str, attributes: dict[str, str]) -> None:
        space, _, name = tag.rpartition(" ")
        line = parser.CurrentLineNumber
        if space not in ("", _SCXML):
            raise ConfigError(file, line, f"<{name}>", f"of {space!r}, which no program has; expected SCXML's elements")
        inside[-1].children.append(_Element(name, line, attributes))
        inside.append(inside[-1].children[-1])

    def doctype(*_: Any) -> None:
        raise ConfigError(file, parser.CurrentLineNumber, "<!DOCTYPE>", "a document type; expected none")

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda tag: inside.pop()
    parser.StartDoctypeDeclHandler = doctype
    try:
        parser.Parse(file.read_bytes(), True)
    except expat.ExpatError as problem:
        raise ConfigError(file, problem.lineno, "", f"not XML: {expat.ErrorString(problem.code)}") from problem
    return whole.children[0]


class _Reader:
    def __init__(self, file: Path):
        self._file = file
        self._top: dict[str, Map] = {name: Map() for name in ("resources", "parameters", "variables")}

    def document(self, root: _Element) -> Document:
        if root.tag != "scxml":
            raise self._error(root, "no SCXML; expected <scxml> at the top")
        self._known(root)
        if (model := root.attributes.get("datamodel", "null")) not in _DATAMODELS:
            raise self._error(root, f"datamodel={model!r}; expected one of {', '.join(_DATAMODELS)}")
        if root.attributes.get("binding", "early") != "early":
            raise self._error(root, "variables have their values from the start; expected binding='early'")
        states = self._states(root, top=True)
        data = Map()
        _put(data, "title", root.attributes.get("name", self._file.stem), root.line)
        for name, part in self._top.items():
            if part:
                _put(data, name, part, root.line)
        _put(data, "states", states, root.line)
        return Document(self._file, data)

    def _states(self, parent: _Element, *, top: bool = False) -> Map:
        states, first = Map(), parent.attributes.get("initial", "")
        for each in parent.children:
            if each.tag in _STATES:
                self._once(states, self._id(each), self._state(each, top=top), each)
            elif each.tag == "datamodel":
                for data in each.children:
                    self._data(data)
            elif each.tag == "initial" and not top:
                way = self._transition(self._only(each, "transition"))
                if way.keys() != {"target"}:
                    raise self._error(each, "does something on the way; expected a target alone")
                first = way["target"]
            elif top or each.tag not in ("transition", "history", "invoke", "donedata"):
                raise self._refused(each)
        if first:
            if first not in states:
                raise self._error(parent, f"initial={first!r}; expected one of its own states: {', '.join(states)}")
            if states[first] is None:
                states[first] = Map()
            _put(states[first], "initial", True, parent.line)
        return states

    def _state(self, element: _Element, *, top: bool) -> Map:
        self._known(element)
        state, ways, histories = Map(), Seq(), Map()
        if element.tag == "final":
            _put(state, "final", True, element.line)
            if top:
                _put(state, "outcome", "succeeded", element.line)
        for each in element.children:
            if each.tag == "transition":
                ways.append(self._transition(each))
                ways.lines.append(each.line)
            elif each.tag == "history":
                self._known(each)
                way = Seq()
                way.append(self._transition(self._only(each, "transition")))
                way.lines.append(each.line)
                history = Map()
                _put(history, "type", each.attributes.get("type", "shallow"), each.line)
                _put(history, "transitions", way, each.line)
                self._once(histories, self._id(each), history, each)
            elif each.tag == "invoke":
                self._known(each)
                if "do" in state:
                    raise self._error(each, "a second one in this state; expected one")
                if each.attributes.get("id", self._id(element)) != self._id(element):
                    raise self._error(each, f"id={each.attributes['id']!r}; expected none, or the state's")
                _put(state, "do", each.attributes.get("type", ""), each.line)
                _put(state, "with", self._parameters(each), each.line)
            elif each.tag == "donedata" and element.tag == "final" and top:
                for name, value in self._parameters(each).items():
                    _put(state, name, value, each.line)
        children = self._states(element)
        if element.tag == "parallel":
            _put(state, "parallel", True, element.line)
        for name, part in (("states", children), ("transitions", ways), ("history", histories)):
            if part:
                _put(state, name, part, element.line)
        return state

    def _transition(self, element: _Element) -> Map:
        self._known(element)
        if element.attributes.get("type", "external") != "external":
            raise self._error(element, f"type={element.attributes['type']!r}; expected none, or 'external'")
        way, sets = Map(), Map()
        for name in ("event", "cond", "target"):
            if name in element.attributes:
                _put(way, name, element.attributes[name], element.line)
        for each in element.children:
            if each.tag != "assign":
                raise self._refused(each)
            self._known(each)
            if not each.attributes.keys() >= {"location", "expr"}:
                raise self._error(each, "expected `location` and `expr`")
            self._once(sets, each.attributes["location"], each.attributes["expr"], each)
        if sets:
            _put(way, "set", sets, element.line)
        return way

    def _data(self, element: _Element) -> None:
        if element.tag != "data":
            raise self._refused(element)
        self._known(element)
        own = {
            name.removeprefix(f"{OWN} "): value for name, value in element.attributes.items() if name.startswith(OWN)
        }
        id, value = self._id(element), self._literal(element, element.attributes.get("expr", "None"))
        if kind := own.pop("resource", ""):
            part = Map()
            for name, each in {"kind": kind, **own}.items():
                _put(part, name, each, element.line)
            self._once(self._top["resources"], id, part, element)
        elif kind := own.pop("parameter", ""):
            part = Map()
            for name, each in {"default": value, "type": kind, **own}.items():
                _put(part, name, self._literal(element, each) if name in ("min", "max") else each, element.line)
            self._once(self._top["parameters"], id, part, element)
        else:
            self._once(self._top["variables"], id, value, element)

    def _parameters(self, element: _Element) -> Map:
        """Arguments: what is written as a value is that value, anything else an expression."""
        found = Map()
        for each in element.children:
            if each.tag != "param":
                raise self._refused(each)
            self._known(each)
            if not each.attributes.keys() >= {"name", "expr"}:
                raise self._error(each, "expected `name` and `expr`")
            try:
                value = ast.literal_eval(each.attributes["expr"])
            except (ValueError, SyntaxError):
                value = each.attributes["expr"]
            self._once(found, each.attributes["name"], value, each)
        return found

    def _literal(self, element: _Element, text: str) -> Any:
        try:
            return ast.literal_eval(text)
        except (ValueError, SyntaxError) as problem:
            raise self._error(
                element, f"got {text!r}; expected a number, a text in quotes, True, False or None"
            ) from problem

    def _once(self, target: Map, name: str, value: Any, element: _Element) -> None:
        if name in target:
            raise self._error(element, f"{name!r} is there already, in line {target.lines[name]}; expected one")
        _put(target, name, value, element.line)

    def _only(self, element: _Element, tag: str) -> _Element:
        if [each.tag for each in element.children] != [tag]:
            raise self._error(element, f"expected one <{tag}> in it")
        return element.children[0]

    def _id(self, element: _Element) -> str:
        if "id" not in element.attributes:
            raise self._error(element, "has no id; expected one")
        return element.attributes["id"]

    def _known(self, element: _Element) -> None:
        if odd := sorted(element.attributes.keys() - _ATTRIBUTES[element.tag]):
            known = ", ".join(sorted(name for name in _ATTRIBUTES[element.tag] if " " not in name))
            raise self._error(
                element, f"no program has its attribute {odd[0].rpartition(' ')[2]!r}; expected one of {known}"
            )

    def _refused(self, element: _Element) -> ConfigError:
        return self._error(
            element, "no program has that here; expected states, transitions with <assign>, <invoke>, history"
        )

    def _error(self, element: _Element, problem: str) -> ConfigError:
        return ConfigError(self._file, element.line, f"<{element.tag}>", problem)


def _put(target: Map, key: str, value: Any, line: int) -> None:
    target[key], target.lines[key] = value, line
