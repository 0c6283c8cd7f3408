"""A program of the library: a statechart whose states do activities, with parameters and abstract resources.

`read` gives a program that has been checked whole (see `engines.programs.check`); what it refuses is a `config.ConfigError` that
names file, line, field and expectation.
"""

from __future__ import annotations

import functools
import hashlib
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from engines.programs import actions, scxml, scxml_machine
from engines.programs.actions import Action
from engines.programs.schema import (
    HistoryFile,
    Output,
    Parameter,
    ProgramFile,
    Resource,
    StateFile,
    TransitionFile,
)
from handrail import config, workspace

_T = TypeVar("_T")

CONSTANTS: Mapping[str, float] = {"pi": math.pi, "deg": math.pi / 180}
"""names that every expression of a program knows; ``deg`` is one degree in radians"""

AUTONOMY: Mapping[str, int] = {"off": 0, "low": 1, "high": 2, "full": 3}
"""levels that a run may have, and that a transition may name as the highest at which it is asked about"""
PROGRAM = "program"
"""what a state does that runs another program"""
RETRIES = "retries_of_"
"""and a state's id: how often its activity was begun anew already, since the state was entered"""
TEMPLATE = "template_of_"
"""and the name of a resource that is an instance: the template that it is of"""


@dataclass(frozen=True)
class Transition:
    """One way out of a state."""

    path: str
    """where it stands in the file"""
    file: TransitionFile
    actions: tuple[Action, ...] = ()


@dataclass
class State:
    """A state, in the tree."""

    id: str
    """its name; of a program that another one runs, after the name of the state that does: ``grasping/closing``"""
    path: str
    """where it stands in the file"""
    file: StateFile
    parent: State | None = None
    children: list[State] = field(default_factory=list)
    transitions: list[Transition] = field(default_factory=list)
    history: dict[str, list[Transition]] = field(default_factory=dict)
    history_type: dict[str, str] = field(default_factory=dict)
    enter: tuple[Action, ...] = ()
    exit: tuple[Action, ...] = ()
    start: Transition | None = None
    """that is taken where it is entered itself, instead of its initial child"""
    scope: str = ""
    """id of the state that runs the program that it belongs to; empty: the program itself"""
    called: Program | None = None
    """the program that it runs (`do: program`); the states of that are its children"""

    def all(self) -> Iterator[State]:
        """It and the states in it."""
        yield self
        for child in self.children:
            yield from child.all()

    @property
    def name(self) -> str:
        """As its own program calls it."""
        return self.id.rpartition("/")[2]

    def lineage(self) -> Iterator[State]:
        """The state and its ancestors, innermost first."""
        state: State | None = self
        while state is not None:
            yield state
            state = state.parent

    def initial_children(self) -> list[State]:
        """Those that are entered with it: all of a parallel state, else the initial one (the first where none is marked)."""
        if not self.children or self.file.parallel:
            return self.children
        if self.start is not None:
            there = set((self.start.file.target or "").split())
            led = [each for each in self.children if any(there & {one.id, *one.history} for one in each.all())]
            return led or self.children[:1]  # none: a history of its own
        return [next((child for child in self.children if child.file.initial), self.children[0])]


@dataclass(frozen=True)
class Program:
    """A checked program."""

    name: str
    title: str
    hash: str
    """of the file's content"""
    text: str
    """the file's content"""
    document: config.Document
    resources: Mapping[str, Resource]
    parameters: Mapping[str, Parameter]
    variables: Mapping[str, Any]
    outputs: Mapping[str, Output]
    start: tuple[str, ...]
    """ids of the states that a run begins in; none: the initial one"""
    roots: tuple[State, ...]
    """top-level states, in the file's order"""
    texts: Mapping[str, str]
    """program → its file's content, of all that it runs"""
    whole_because: str = ""
    """what of its SCXML file no program can say, so that a node carries it out whole; empty: its states are the file's"""

    @functools.cached_property
    def names(self) -> frozenset[str]:
        """Those that its expressions may use."""
        retries = {f"{RETRIES}{state.id}" for state in self.own_states() if state.file.retry}
        templates = {f"{TEMPLATE}{name}" for name in self.instances}
        named = {*self.variables, *self.parameters, *self.resources}
        return frozenset({*named, *CONSTANTS, *retries, *templates, "failure"})

    @property
    def instances(self) -> list[str]:
        """Its resources that are instances."""
        return [name for name, resource in self.resources.items() if resource.kind == "instance"]

    def same_as(self, other: Program) -> bool:
        """Whether it is the same version, and so is all that it runs."""
        return (self.text, self.texts) == (other.text, other.texts)

    def remembers(self) -> frozenset[str]:
        """Names of all that a run of it remembers: its variables, and variables and parameters of what its states run."""
        called = [(state.id, state.called) for state in self.states() if state.called is not None]
        within = (f"{id}/{name}" for id, each in called for name in (*each.variables, *each.parameters))
        return frozenset((*self.variables, *within))

    def own_states(self) -> Iterator[State]:
        """Every state of its own file, in the file's order."""
        return (state for state in self.states() if not state.scope)

    def states(self) -> Iterator[State]:
        """Every state, in the file's order, with those of the programs that it runs after the states that run them."""
        waiting = list(self.roots)
        while waiting:
            state = waiting.pop(0)
            yield state
            waiting[:0] = state.children

    def problem(self, name: str, value: Any) -> tuple[str, str]:
        """Why a parameter can't have this value, and what is expected; two empty words when it can."""
        parameter = self.parameters.get(name)
        if parameter is None:
            return "no such parameter", f"one of: {', '.join(self.parameters) or 'none'}"
        if parameter.type == "text":
            return ("", "") if isinstance(value, str) else ("not a text", "a text")
        if parameter.type == "bool":
            return ("", "") if isinstance(value, bool) else ("not true or false", "true or false")
        bounds = f"{parameter.min:g} to {parameter.max:g} {parameter.unit}".strip()
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            return "not a number", f"a number, {bounds}"
        if parameter.type == "integer" and value != round(value):
            return "not a whole number", f"a whole number, {bounds}"
        if not parameter.min <= value <= parameter.max:
            return "out of bounds", bounds
        return "", ""


def read(file: Path | str, library: Mapping[str, Path] | None = None) -> Program:
    """Read and check a program; its name is the file's. Raises config.ConfigError.

    :param library: name → file of the programs that it may run; None: the library's
    """
    return _Reader(library).read(Path(file))


def files() -> dict[str, Path]:
    """Every program of the library by its name: the workspace's before the built-in ones."""
    found: dict[str, Path] = {}
    for folder in reversed(workspace.search_path("rtc_programs", "rtc_programs")):
        found |= {**workspace.files([folder], scxml.SUFFIX), **workspace.files([folder])}
    return found


class _Reader:
    """Reads a program with all that it runs, each file once."""

    def __init__(self, library: Mapping[str, Path] | None):
        self._library = library
        self._read: dict[str, Program] = {}
        self._chain: list[tuple[str, Path]] = []
        """programs that are being read, each of which runs the next"""

    def read(self, file: Path) -> Program:
        if file.suffix != scxml.SUFFIX:
            return self._checked(file, config.read(file))
        try:
            return self._checked(file, scxml.read(file))
        except config.ConfigError as problem:
            machine = scxml_machine.read(file)
            if machine is None:
                raise
            return replace(self._checked(file, machine, scxml_machine.parts(file)), whole_because=str(problem))

    def _checked(self, file: Path, document: config.Document, parts: Iterable[Path] = ()) -> Program:
        from engines.programs import check as program_check

        whole = document.convert(ProgramFile)
        if not whole.states:
            raise document.error("states", "got none; expected at least one")
        content = file.read_bytes()
        roots = tuple(_state(document, f"states.{id}", id, None) for id in whole.states)
        callers = [state for root in roots for state in root.all() if state.file.do == PROGRAM]
        self._chain.append((file.stem, file.resolve()))
        try:
            for state in callers:
                state.called = self._called(document, state)
        finally:
            self._chain.pop()
        called = {state.called.name: state.called for state in callers if state.called is not None}
        digest = hashlib.sha256(content)
        for name in sorted(called):
            digest.update(f"{name} {called[name].hash}".encode())
        for part in parts:
            digest.update(f"{part.name} ".encode() + part.read_bytes())
        program = Program(
            name=file.stem,
            title=whole.title,
            hash=digest.hexdigest()[:16],
            text=content.decode(),
            document=document,
            resources=_each(document, "resources", whole.resources, Resource),
            parameters=_each(document, "parameters", whole.parameters, Parameter),
            variables=whole.variables,
            outputs=_each(document, "outputs", whole.outputs, Output),
            start=tuple(whole.start.split()),
            roots=roots,
            texts={
                name: text for each in called.values() for name, text in {each.name: each.text, **each.texts}.items()
            },
        )
        program_check.check(program)
        for state in callers:
            if state.called is not None:
                state.children = [_within(root, state, state.id) for root in state.called.roots]
                if state.called.start:
                    inner = " ".join(f"{state.id}/{id}" for id in state.called.start)
                    state.start = Transition(state.path, TransitionFile(target=inner))
        return program

    def _called(self, document: config.Document, state: State) -> Program | None:
        name, path = state.file.with_.get("program"), f"{state.path}.with.program"
        if not isinstance(name, str):
            return None  # as the check says
        library = files() if self._library is None else self._library
        if name not in library:
            there = ", ".join(sorted(library)) or "none"
            raise document.error(path, f"got {name!r}, no program of the library; expected one of {there}")
        file = library[name].resolve()
        if file in (under_way := [each for _, each in self._chain]):
            chain = [each for each, _ in self._chain[under_way.index(file) :]]
            raise document.error(
                path, f"runs itself: {' → '.join([*chain, chain[0]])}; expected one that does not lead back"
            )
        if name not in self._read:
            try:
                self._read[name] = self.read(library[name])
            except config.ConfigError as problem:
                raise document.error(path, f"got {name!r}: {problem}") from problem
        return self._read[name]


def _within(state: State, parent: State, caller: str) -> State:
    """A program's state as one of the program whose state `caller` runs it."""

    def named(id: str) -> str:
        return f"{caller}/{id}"

    def event(name: str) -> str:
        kind = next((kind for kind in ("done.invoke.", "done.state.") if name.startswith(kind)), "")
        return kind + named(name.removeprefix(kind)) if kind else name

    def way(old: Transition) -> Transition:
        target = None if old.file.target is None else " ".join(map(named, old.file.target.split()))
        events = None if old.file.event is None else " ".join(map(event, old.file.event.split()))
        return replace(old, file=msgspec.structs.replace(old.file, target=target, event=events))

    copy = State(
        named(state.id),
        state.path,
        state.file,
        parent,
        transitions=[way(each) for each in state.transitions],
        history={named(name): [way(each) for each in ways] for name, ways in state.history.items()},
        history_type={named(name): type for name, type in state.history_type.items()},
        enter=state.enter,
        exit=state.exit,
        start=None if state.start is None else way(state.start),
        scope=named(state.scope) if state.scope else caller,
        called=state.called,
    )
    copy.children = [_within(child, copy, caller) for child in state.children]
    return copy


def _state(document: config.Document, path: str, id: str, parent: State | None) -> State:
    file = document.convert(StateFile, path) if document.at(path) is not None else StateFile()
    state = State(id, path, file, parent)
    state.transitions = _transitions(document, f"{path}.transitions", len(file.transitions))
    state.enter = actions.read(document, f"{path}.enter", file.enter)
    state.exit = actions.read(document, f"{path}.exit", file.exit)
    if file.start:
        where = f"{path}.start"
        way = document.convert(TransitionFile, where)
        state.start = Transition(where, way, actions.read(document, f"{where}.actions", way.actions))
    for name in file.history:
        where = f"{path}.history.{name}"
        history = document.convert(HistoryFile, where)
        state.history[name] = _transitions(document, f"{where}.transitions", len(history.transitions))
        state.history_type[name] = history.type
    state.children = [_state(document, f"{path}.states.{child}", child, state) for child in file.states]
    return state


def _transitions(document: config.Document, path: str, count: int) -> list[Transition]:
    files = {f"{path}[{k}]": document.convert(TransitionFile, f"{path}[{k}]") for k in range(count)}
    return [
        Transition(where, file, actions.read(document, f"{where}.actions", file.actions))
        for where, file in files.items()
    ]


def _each(document: config.Document, path: str, parts: Mapping[str, Any], kind: type[_T]) -> dict[str, _T]:
    return {
        name: document.convert(kind, f"{path}.{name}")
        if part is not None
        else document.converted({}, kind, f"{path}.{name}")
        for name, part in parts.items()
    }
