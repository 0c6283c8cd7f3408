"""Composite nodes: nodes of the library wired to each other in a YAML file, run as one node in one process (docs/nodes.md)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any, ClassVar

import msgspec

from engines.nodes import library
from engines.nodes.node import Case, Node, load
from engines.nodes.ports import Input, MissingError, Output, Param, PortError, _Port
from handrail import config
from handrail.config import ConfigError, Document
from handrail.port_kinds import misfit


class _Part(msgspec.Struct, forbid_unknown_fields=True):
    node: str
    params: dict[str, Any] = {}


class _File(msgspec.Struct, forbid_unknown_fields=True):
    nodes: dict[str, _Part]
    outputs: dict[str, str]
    title: str = ""
    inputs: dict[str, str | list[str]] = {}
    wires: dict[str, str] = {}
    """PART.input: PART.output"""
    params: dict[str, str | list[str]] = {}
    every: float | None = None
    step_limit_s: float | None = None
    memory_mb: int | None = None
    cpu_share: float = 1.0
    restarts: int = Node.restarts
    cases: list[Case] = []


@dataclass(frozen=True)
class _Place:
    """A port of a part."""

    part: str
    port: str

    def __str__(self) -> str:
        return f"{self.part}.{self.port}"


class Composite(Node):
    """Steps its parts one after the other, each after those that it gets its inputs from. Arrays are handed on as they are."""

    parts: ClassVar[Mapping[str, tuple[type[Node], Mapping[str, Any]]]] = {}
    """name → kind and parameters, in the order of their steps"""
    given: ClassVar[Mapping[str, tuple[_Place, ...]]] = {}
    """own input or parameter → where it goes"""
    wires: ClassVar[Mapping[_Place, _Place]] = {}
    """a part's input → the output that it gets"""
    found: ClassVar[Mapping[str, _Place]] = {}
    """own output → the part's"""

    def start(self) -> None:
        self._running: dict[str, Node] = {}
        for name, (kind, params) in self.parts.items():
            self._running[name] = part = kind()
            part.put("params", params)
        self._give(self.params)
        for name, part in self._running.items():
            self._call(name, part.start)

    def step(self) -> None:
        self._give(self.params)
        self._give(self.inputs)
        for name, part in self._running.items():
            for to, source in self.wires.items():
                values = self._running[source.part].values
                if to.part == name and source.port in values:
                    part.values[to.port] = part.inputs[to.port].taken(values[source.port])
            try:
                self._call(name, part.step)
            except MissingError as problem:
                if self.every is None:
                    raise MissingError(f"part {name}: {problem}") from problem
        for name, place in self.found.items():
            part = self._running[place.part]
            if place.port in part.written:
                setattr(self, name, part.values[place.port])
        for part in self._running.values():
            part.written.clear()

    def _give(self, ports: Mapping[str, _Port]) -> None:
        for name in ports:
            if name in self.values:
                for place in self.given[name]:
                    kind = "params" if isinstance(ports[name], Param) else "inputs"
                    self._running[place.part].put(kind, {place.port: self.values[name]})

    def _call(self, name: str, work: Any) -> None:
        try:
            work()
        except MissingError:
            raise
        except Exception as problem:
            problem.add_note(f"in part {name}")
            raise


def read(file: Path, within: tuple[Path, ...] = ()) -> type[Composite]:
    """The node that a file wires together; its parts' code is run.

    Raises ConfigError with the file's line: what does not exist, does not fit, goes round in circles, or gets nothing; and what the
    parts' code raises. `within`: composites that this one is a part of.
    """
    file = file.resolve()
    document = config.read(file)
    about = document.convert(_File)
    return _Reading(document, about, (*within, file)).node()


class _Reading:
    def __init__(self, document: Document, about: _File, within: tuple[Path, ...]):
        self._document, self._about = document, about
        self._kinds = {name: self._part(name, part, within) for name, part in about.nodes.items()}
        self._fed: dict[_Place, str] = {}
        """part's input or parameter → the field that it gets its value from"""

    def _part(self, name: str, part: _Part, within: tuple[Path, ...]) -> type[Node]:
        field = f"nodes.{name}"
        if not name.isidentifier():
            raise self._error(field, f"got {name!r}; expected letters, digits and _, beginning with a letter")
        try:
            file = library.find(part.node).resolve()
        except ValueError as problem:
            raise self._error(f"{field}.node", str(problem).removeprefix("node: ")) from problem
        if file in within:
            names = " → ".join(each.stem for each in (*within[within.index(file) :], file))
            raise self._error(f"{field}.node", f"is a part of itself: {names}")
        kind = read(file, within) if file.suffix == ".yaml" else load(file)
        try:
            kind().put("params", part.params)
        except PortError as problem:
            raise self._error(f"{field}.params", str(problem)) from problem
        return kind

    def node(self) -> type[Composite]:
        about = self._about
        attributes: dict[str, Any] = {}
        given: dict[str, tuple[_Place, ...]] = {}
        for word, what, theirs in (("inputs", about.inputs, "inputs"), ("params", about.params, "params")):
            for name, to in what.items():
                field = f"{word}.{name}"
                places = [self._place(field, each, theirs) for each in ([to] if isinstance(to, str) else to)]
                if not places:
                    raise self._error(field, "goes nowhere; expected PART.port, or a list of them")
                attributes[name] = self._own(field, name, places, attributes)
                given[name] = tuple(places)
        wires = {}
        for to, source in about.wires.items():
            field = f"wires.{to}"
            target, origin = self._place(field, to, "inputs"), self._place(field, source, "outputs")
            self._feed(field, target)
            self._fit(field, origin, self._port(origin), target)
            wires[target] = origin
        found = {}
        for name, source in about.outputs.items():
            field = f"outputs.{name}"
            origin = self._place(field, source, "outputs")
            port = self._port(origin)
            assert isinstance(port, Output)
            self._unused(field, name, attributes)
            attributes[name] = Output(port.kind.name, port.doc, unit=port.unit, rate=port.rate)
            found[name] = origin
        self._all_fed()
        order = self._order(wires)
        parts = {name: (self._kinds[name], about.nodes[name].params) for name in order}
        attributes |= self._limits()
        attributes |= {"__doc__": about.title, "parts": parts, "given": given, "wires": wires, "found": found}
        try:
            return type(self._document.file.stem, (Composite,), attributes)
        except PortError as problem:
            raise self._error("", str(problem)) from problem

    def _error(self, field: str, problem: str) -> ConfigError:
        word, _, name = field.partition(".")
        if word == "wires" and name in self._about.wires:  # a key with a dot in it
            return ConfigError(self._document.file, self._document.data[word].lines[name], field, problem)
        return self._document.error(field, problem)

    def _limits(self) -> dict[str, Any]:
        about, kinds = self._about, self._kinds.values()
        for name, kind in self._kinds.items():
            if about.every is None and kind.every is not None:
                raise self._error(
                    "every", f"missing; the part {name} steps by itself, every {kind.every:g} s where it is alone"
                )
        return {
            "every": about.every,
            "step_limit_s": about.step_limit_s or sum(kind.step_limit_s for kind in kinds),
            "memory_mb": about.memory_mb or sum(kind.memory_mb for kind in kinds),
            "cpu_share": about.cpu_share,
            "restarts": about.restarts,
            "cases": about.cases,
        }

    def _place(self, field: str, text: str, ports: str) -> _Place:
        part, _, port = text.partition(".")
        if part not in self._kinds:
            raise self._error(field, f"got {text!r}: no such part; expected one of {', '.join(self._kinds)}")
        known = getattr(self._kinds[part], ports)
        if port not in known:
            word = {"inputs": "input", "outputs": "output", "params": "parameter"}[ports]
            there = ", ".join(f"{part}.{name}" for name in known) or "none"
            raise self._error(field, f"got {text!r}: no such {word}; expected one of {there}")
        return _Place(part, port)

    def _port(self, place: _Place) -> _Port:
        kind = self._kinds[place.part]
        return {**kind.inputs, **kind.outputs, **kind.params}[place.port]

    def _own(self, field: str, name: str, places: list[_Place], attributes: Mapping[str, Any]) -> _Port:
        self._unused(field, name, attributes)
        first = self._port(places[0])
        for place in places:
            self._feed(field, place)
            self._fit(field, places[0], first, place)
        if not isinstance(first, Param):
            return Input(first.kind.name, first.doc, unit=first.unit)
        default = self._about.nodes[places[0].part].params.get(places[0].port, first.default)
        return Param(
            first.taken(default), first.doc, unit=first.unit, low=first.low, high=first.high, choices=first.choices
        )

    def _unused(self, field: str, name: str, attributes: Mapping[str, Any]) -> None:
        if name in attributes:
            raise self._error(field, f"got {name!r}; expected a name that no other port of it has")

    def _feed(self, field: str, place: _Place) -> None:
        if place in self._fed:
            raise self._error(field, f"{place} gets its value from {self._fed[place]} already; expected one source")
        self._fed[place] = field

    def _fit(self, field: str, source: _Place, port: _Port, target: _Place) -> None:
        """Raises where not every value of a port is one for the target."""
        to = self._port(target)
        what, got, taken = misfit(port.kind.name, port.unit, to.kind.name, to.unit)
        if what == "kind":
            raise self._error(field, f"{target} takes {taken}, {source} is {got}; expected the same kind")
        if what == "unit":
            raise self._error(field, f"{target} is in {taken}, {source} in {got}; expected the same unit")

    def _all_fed(self) -> None:
        for name, kind in self._kinds.items():
            for port in kind.inputs:
                if _Place(name, port) not in self._fed:
                    raise self._error(f"nodes.{name}", f"its input {port} gets nothing; expected it in wires or inputs")

    def _order(self, wires: Mapping[_Place, _Place]) -> list[str]:
        needs: dict[str, list[str]] = {name: [] for name in self._kinds}
        for to, source in wires.items():
            needs[to.part].append(source.part)
        try:
            return list(TopologicalSorter(needs).static_order())
        except CycleError as cycle:
            names = list(cycle.args[1])
            first = next(to for to, source in wires.items() if to.part == names[1] and source.part == names[0])
            raise self._error(f"wires.{first}", f"goes round in circles: {' → '.join(names)}") from cycle
