"""A program of the library: a statechart whose states do activities, with parameters and abstract resources.

`read` gives a program that has been checked whole (see `engines.programs.check`); what it refuses is a `config.ConfigError` that
names file, line, field and expectation.
"""

from __future__ import annotations

import functools
import hashlib
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from engines.programs.schema import (
    HistoryFile,
    Parameter,
    ProgramFile,
    Resource,
    StateFile,
    TransitionFile,
)
from handrail import config

_T = TypeVar("_T")

CONSTANTS: Mapping[str, float] = {"pi": math.pi, "deg": math.pi / 180}
"""names that every expression of a program knows; ``deg`` is one degree in radians"""

AUTONOMY: Mapping[str, int] = {"low": 1, "high": 2, "full": 3}
"""levels that a run may have, and that a transition may name as the highest at which it is asked about"""
RETRIES = "retries_of_"
"""and a state's id: how often its activity was begun anew already, since the state was entered"""


@dataclass(frozen=True)
class Transition:
    """One way out of a state."""

    path: str
    """where it stands in the file"""
    file: TransitionFile


@dataclass
class State:
    """A state, in the tree."""

    id: str
    path: str
    """where it stands in the file"""
    file: StateFile
    parent: State | None = None
    children: list[State] = field(default_factory=list)
    transitions: list[Transition] = field(default_factory=list)
    history: dict[str, list[Transition]] = field(default_factory=dict)
    history_type: dict[str, str] = field(default_factory=dict)

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
    roots: tuple[State, ...]
    """top-level states, in the file's order"""

    @functools.cached_property
    def names(self) -> frozenset[str]:
        """Those that its expressions may use."""
        retries = {f"{RETRIES}{state.id}" for state in self.states() if state.file.retry}
        return frozenset({*self.variables, *self.parameters, *self.resources, *CONSTANTS, *retries, "failure"})

    def states(self) -> Iterator[State]:
        """Every state, in the file's order."""
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


def read(file: Path | str) -> Program:
    """Read and check a program; its name is the file's. Raises config.ConfigError."""
    from engines.programs import check as program_check

    document = config.read(file)
    whole = document.convert(ProgramFile)
    if not whole.states:
        raise document.error("states", "got none; expected at least one")
    program = Program(
        name=Path(file).stem,
        title=whole.title,
        hash=hashlib.sha256(content := Path(file).read_bytes()).hexdigest()[:16],
        text=content.decode(),
        document=document,
        resources=_each(document, "resources", whole.resources, Resource),
        parameters=_each(document, "parameters", whole.parameters, Parameter),
        variables=whole.variables,
        roots=tuple(_state(document, f"states.{id}", id, None) for id in whole.states),
    )
    program_check.check(program)
    return program


def _state(document: config.Document, path: str, id: str, parent: State | None) -> State:
    file = document.convert(StateFile, path) if _at(document, path) is not None else StateFile()
    state = State(id, path, file, parent)
    state.transitions = _transitions(document, f"{path}.transitions", len(file.transitions))
    for name in file.history:
        where = f"{path}.history.{name}"
        history = document.convert(HistoryFile, where)
        state.history[name] = _transitions(document, f"{where}.transitions", len(history.transitions))
        state.history_type[name] = history.type
    state.children = [_state(document, f"{path}.states.{child}", child, state) for child in file.states]
    return state


def _transitions(document: config.Document, path: str, count: int) -> list[Transition]:
    return [Transition(f"{path}[{k}]", document.convert(TransitionFile, f"{path}[{k}]")) for k in range(count)]


def _each(document: config.Document, path: str, parts: Mapping[str, Any], kind: type[_T]) -> dict[str, _T]:
    return {name: document.convert(kind, f"{path}.{name}") for name in parts}


def _at(document: config.Document, path: str) -> Any:
    node: Any = document.data
    for part in path.split("."):
        node = node[part]
    return node
