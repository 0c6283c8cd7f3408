"""SCXML files as programs: what of W3C's SCXML 1.0 a program can say becomes the same document as of a YAML file, line by line.

States, parallel states, history, finals, transitions with events and conditions, `<onentry>`, `<onexit>` and what is done there and
in transitions (`<assign>`, `<raise>`, `<send>`, `<log>`, `<if>`) are SCXML's own. `<invoke type="prompt">` is what a state does,
each `<param>` an argument of it. What has no counterpart in a program (`<script>`, `<foreach>`, `<cancel>`, `<send>` to somebody)
is refused by file, line and element.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any

from engines.programs.scxml_elements import ATTRIBUTES, OWN, Element, parsed
from handrail.config import ConfigError, Document
from handrail.yaml_file import Map, Seq

SUFFIX = ".scxml"
_DATAMODELS = ("null", "python", "handrail", "ecmascript")
"""of ecmascript what means the same in Python; its words for True, False and None are known everywhere"""
_WORDS = {"true": True, "false": False, "null": None, "undefined": None}
_PROCESSORS = ("scxml", "http://www.w3.org/TR/scxml/#SCXMLEventProcessor")
_TIME = re.compile(r"(\d*\.?\d+)(s|ms)")
_STATES = ("state", "parallel", "final")


def read(file: Path) -> Document:
    """The document of a program. Raises ConfigError with file, line and element."""
    try:
        return _Reader(file).document(parsed(file))
    except OSError as problem:
        raise ConfigError(file, None, "", f"can't be read: {problem}") from problem


class _Reader:
    def __init__(self, file: Path):
        self._file = file
        self._top: dict[str, Map] = {name: Map() for name in ("resources", "parameters", "variables")}

    def document(self, root: Element) -> Document:
        if root.tag != "scxml":
            raise self._error(root, "no SCXML; expected <scxml> at the top")
        self._known(root)
        if (model := root.attributes.get("datamodel", "null")) not in _DATAMODELS:
            raise self._error(root, f"datamodel={model!r}; expected one of {', '.join(_DATAMODELS)}")
        if root.attributes.get("binding", "early") != "early":
            raise self._error(root, "variables have their values from the start; expected binding='early'")
        states, start = self._states(root, top=True)
        data = Map()
        _put(data, "title", root.attributes.get("name", self._file.stem), root.line)
        for name, part in self._top.items():
            if part:
                _put(data, name, part, root.line)
        _put(data, "states", states, root.line)
        if start is not None:
            _put(data, "start", start["target"], root.line)
        return Document(self._file, data)

    def _states(self, parent: Element, *, top: bool = False) -> tuple[Map, Map | None]:
        """The states in it, and how it is entered itself, where that is more than an initial one of them."""
        states, start = Map(), None
        if first := parent.attributes.get("initial", ""):
            start = Map()
            _put(start, "target", first, parent.line)
        for each in parent.children:
            if each.tag in _STATES:
                self._once(states, self._id(each), self._state(each, top=top), each)
            elif each.tag == "datamodel":
                for data in each.children:
                    self._data(data)
            elif each.tag == "initial" and not top:
                start = self._transition(self._only(each, "transition"))
            elif top or each.tag not in ("transition", "history", "invoke", "donedata", "onentry", "onexit"):
                raise self._refused(each)
        if start is not None and start.keys() == {"target"} and (only := start["target"]) in states:
            if states[only] is None:
                states[only] = Map()
            _put(states[only], "initial", True, parent.line)
            start = None
        return states, start

    def _state(self, element: Element, *, top: bool) -> Map:
        self._known(element)
        state, ways, histories = Map(), Seq(), Map()
        entered = {"onentry": Seq(), "onexit": Seq()}
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
            elif each.tag in entered:
                self._known(each)
                steps = self._actions(each.children, each.line)
                entered[each.tag] += steps
                entered[each.tag].lines += steps.lines
            elif each.tag == "donedata":
                if element.tag != "final":
                    raise self._refused(each)
                if not top:
                    _put(state, "data", self._event_data(each.children), each.line)
                    continue
                for name, value in self._parameters(each).items():
                    _put(state, name, value, each.line)
        children, start = self._states(element)
        if start is not None:
            _put(state, "start", start, element.line)
        if element.tag == "parallel":
            _put(state, "parallel", True, element.line)
        parts = {"enter": entered["onentry"], "exit": entered["onexit"]}
        for name, part in {**parts, "states": children, "transitions": ways, "history": histories}.items():
            if part:
                _put(state, name, part, element.line)
        return state

    def _transition(self, element: Element) -> Map:
        self._known(element)
        way = Map()
        if (kind := element.attributes.get("type", "external")) not in ("external", "internal"):
            raise self._error(element, f"type={kind!r}; expected 'internal', 'external' or none")
        if kind == "internal":
            _put(way, "internal", True, element.line)
        for name in ("event", "target"):
            if name in element.attributes:
                _put(way, name, element.attributes[name], element.line)
        if "cond" in element.attributes:
            _put(way, "cond", self._expression(element.attributes["cond"]), element.line)
        steps, sets = self._actions(element.children, element.line), Map()
        for step in steps if all(step.keys() == {"set"} for step in steps) else ():
            for name, value in step["set"].items():
                if name not in sets:
                    _put(sets, name, value, step.lines["set"])
        if len(sets) == len(steps) > 0:
            _put(way, "set", sets, element.line)
        elif steps:
            _put(way, "actions", steps, element.line)
        return way

    def _actions(self, elements: list[Element], line: int) -> Seq:
        """What is done, in order."""
        steps = Seq()
        for each in elements:
            step = Map()
            match each.tag:
                case "assign":
                    self._given(each, "location", "expr")
                    sets = Map()
                    _put(sets, each.attributes["location"], self._expression(each.attributes["expr"]), each.line)
                    _put(step, "set", sets, each.line)
                case "raise":
                    self._given(each, "event")
                    _put(step, "raise", each.attributes["event"], each.line)
                case "send":
                    self._send(each, step)
                case "log":
                    self._given(each)
                    expression = self._expression(each.attributes.get("expr", ""))
                    if any(sign in expression for sign in "{}:!"):
                        raise self._error(each, f"expr={expression!r}; expected none of {{ }} : ! in it")
                    words = [each.attributes.get("label", ""), f"{{{expression}}}" if expression else ""]
                    _put(step, "log", ": ".join(filter(None, words)), each.line)
                case "if":
                    self._given(each, "cond")
                    self._if(each, each, each.children, step)
                case _:
                    raise self._refused(each)
            steps.append(step)
            steps.lines.append(each.line)
        return steps

    def _if(self, whole: Element, branch: Element, children: list[Element], step: Map) -> None:
        """`children`: what follows `branch`, an if, elseif or else."""
        at = next((k for k, each in enumerate(children) if each.tag in ("elseif", "else")), len(children))
        _put(step, "if", self._expression(branch.attributes["cond"]), branch.line)
        _put(step, "then", self._actions(children[:at], branch.line), branch.line)
        if at == len(children):
            return
        other, rest = children[at], children[at + 1 :]
        if other.tag == "else":
            self._given(other)
            _put(step, "else", self._actions(rest, other.line), other.line)
            return
        self._given(other, "cond")
        inner, branches = Map(), Seq()
        self._if(whole, other, rest, inner)
        branches.append(inner)
        branches.lines.append(other.line)
        _put(step, "else", branches, other.line)

    def _send(self, element: Element, step: Map) -> None:
        self._given(element, "event")
        given = element.attributes
        data = self._event_data(element.children)
        for name in given.get("namelist", "").split():
            self._once(data, name, name, element)
        if (kind := given.get("type", "scxml")) not in _PROCESSORS:
            raise self._error(element, f"type={kind!r}; expected none, or {_PROCESSORS[1]}")
        if "target" in given:
            if given["target"] != "#_internal" or "delay" in given or "delayexpr" in given or data:
                told = f"target={given['target']!r}; expected none, or '#_internal' without delay and data"
                raise self._error(element, told)
            _put(step, "raise", given["event"], element.line)
            return
        _put(step, "send", given["event"], element.line)
        if data:
            _put(step, "data", data, element.line)
        delay = given.get("delay", "")
        if "delayexpr" in given:
            delay = str(self._literal(element, given["delayexpr"]))
        if delay:
            found = _TIME.fullmatch(delay)
            if found is None:
                raise self._error(element, f"delay {delay!r}; expected a time such as 1.5s or 200ms")
            if seconds := float(found[1]) / (1000 if found[2] == "ms" else 1):
                _put(step, "after", seconds, element.line)

    def _event_data(self, elements: list[Element]) -> Map:
        data = Map()
        for each in elements:
            if each.tag != "param" or each.attributes.keys() != {"name", "expr"}:
                raise self._error(each, "no event of a program carries that; expected <param> with `name` and `expr`")
            self._once(data, each.attributes["name"], self._expression(each.attributes["expr"]), each)
        return data

    def _given(self, element: Element, *must: str) -> None:
        self._known(element)
        if missing := [name for name in must if name not in element.attributes]:
            raise self._error(element, f"expected {' and '.join(f'`{name}`' for name in missing)}")

    def _expression(self, text: str) -> str:
        """In Python's words."""
        try:
            tree = ast.parse(text.strip(), mode="eval")
        except SyntaxError:
            return text  # as the check says
        before = ast.unparse(tree)
        after = ast.unparse(_InPython().visit(tree))
        return text if after == before else after

    def _data(self, element: Element) -> None:
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

    def _parameters(self, element: Element) -> Map:
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

    def _literal(self, element: Element, text: str) -> Any:
        try:
            return ast.literal_eval(self._expression(text))
        except (ValueError, SyntaxError) as problem:
            raise self._error(
                element, f"got {text!r}; expected a number, a text in quotes, True, False or None"
            ) from problem

    def _once(self, target: Map, name: str, value: Any, element: Element) -> None:
        if name in target:
            raise self._error(element, f"{name!r} is there already, in line {target.lines[name]}; expected one")
        _put(target, name, value, element.line)

    def _only(self, element: Element, tag: str) -> Element:
        if [each.tag for each in element.children] != [tag]:
            raise self._error(element, f"expected one <{tag}> in it")
        return element.children[0]

    def _id(self, element: Element) -> str:
        if "id" not in element.attributes:
            raise self._error(element, "has no id; expected one")
        return element.attributes["id"]

    def _known(self, element: Element) -> None:
        if odd := sorted(element.attributes.keys() - ATTRIBUTES[element.tag]):
            known = ", ".join(sorted(name for name in ATTRIBUTES[element.tag] if " " not in name))
            raise self._error(
                element, f"no program has its attribute {odd[0].rpartition(' ')[2]!r}; expected one of {known}"
            )

    def _refused(self, element: Element) -> ConfigError:
        return self._error(
            element,
            "no program has that here; expected states, transitions, <onentry>, <onexit>, <invoke>, history, and in them "
            "<assign>, <raise>, <send>, <log> or <if>",
        )

    def _error(self, element: Element, problem: str) -> ConfigError:
        return ConfigError(self._file, element.line, f"<{element.tag}>", problem)


class _InPython(ast.NodeTransformer):
    """ECMAScript's words as Python's, and an event's data by its names alone."""

    def visit_Call(self, node: ast.Call) -> ast.expr:
        match node:
            case ast.Call(ast.Attribute(value, "get"), [ast.Constant(str(name))], []) if (
                ast.unparse(value) == "_event.data" and name.isidentifier()
            ):
                return ast.Attribute(value, name, ast.Load())
        self.generic_visit(node)
        return node

    def visit_Name(self, node: ast.Name) -> ast.expr:
        return ast.Constant(_WORDS[node.id]) if node.id in _WORDS else node


def _put(target: Map, key: str, value: Any, line: int) -> None:
    target[key], target.lines[key] = value, line
