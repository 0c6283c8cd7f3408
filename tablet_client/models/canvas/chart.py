"""What is drawn of a program's text: its states, what is in them, and the ways between them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from handrail import yaml_file

_HAPPENED = {"done.invoke": "done", "done.state": "done", "error.execution": "failed"}


@dataclass(frozen=True)
class Way:
    """One transition."""

    source: str
    place: int
    """among the source's, from 0"""
    targets: tuple[str, ...]
    """empty: it leads nowhere else"""
    fields: Mapping[str, Any]
    """as the file has them"""

    @property
    def label(self) -> str:
        """When it is taken, in short."""
        event = str(self.fields.get("event") or "")
        if (after := self.fields.get("after")) not in (None, ""):
            when = f"after {after} s" if isinstance(after, int | float) else f"after {after}"
        else:
            when = next((word for start, word in _HAPPENED.items() if event.startswith(start)), event)
        cond = self.fields.get("cond")
        return f"{when} [{cond}]".strip() if cond else when


@dataclass
class State:
    """One state, in the file's order."""

    name: str
    parent: str
    fields: Mapping[str, Any]
    """as the file has them, without what is in it"""
    children: list[str] = field(default_factory=list)
    ways: list[Way] = field(default_factory=list)
    remembers: bool = False
    """a history pseudo-state, which stands in its parent's `history`"""
    initial: bool = False
    """entered first of those beside it"""

    @property
    def title(self) -> str:
        return str(self.fields.get("title") or self.name)

    @property
    def does(self) -> str:
        """Its activity, and what it is mainly about."""
        do = str(self.fields.get("do") or "")
        given = self.fields.get("with")
        about = next(iter(given.values()), "") if isinstance(given, Mapping) else ""
        return f"{do}: {about}" if do and isinstance(about, str) and about else do

    @property
    def kind(self) -> str:
        """state, parallel, history, succeeded, failed, final"""
        if self.remembers:
            return "history"
        if self.fields.get("final"):
            return str(self.fields.get("outcome") or "final")
        return "parallel" if self.fields.get("parallel") else "state"


@dataclass(frozen=True)
class Chart:
    """All of a program's states by name; those of the program itself have no parent."""

    title: str
    states: Mapping[str, State]

    def within(self, name: str) -> list[str]:
        """Names of the states in a state (empty: of the program), in the file's order."""
        if name:
            return self.states[name].children
        return [state.name for state in self.states.values() if not state.parent]

    def above(self, name: str) -> list[str]:
        """The state and those around it, innermost first."""
        found = []
        while name:
            found.append(name)
            name = self.states[name].parent
        return found


def read(text: str) -> Chart:
    """A program's text. What is no state or no transition is left out, as while somebody types; ValueError: it has no states."""
    try:
        data = yaml_file.parse(text)
    except yaml_file.NotYAML as problem:
        raise ValueError(f"line {problem.line}: {problem.problem}" if problem.line else problem.problem) from problem
    if not isinstance(data, Mapping) or not isinstance(data.get("states"), Mapping):
        raise ValueError("states: missing; expected a program's file")
    states = {state.name: state for state in _states(data["states"], "")}
    for state in states.values():
        if state.parent:
            states[state.parent].children.append(state.name)
    chart = Chart(str(data.get("title") or ""), states)
    for parent in ("", *states):
        if parent and states[parent].fields.get("parallel"):
            continue
        beside = [name for name in chart.within(parent) if not states[name].remembers]
        marked = [name for name in beside if states[name].fields.get("initial")]
        for name in (marked or beside)[:1]:
            states[name].initial = True
    return chart


def _states(given: Mapping[Any, Any], parent: str) -> Iterator[State]:
    for key, each in given.items():
        name, fields = str(key), each if isinstance(each, Mapping) else {}
        ways = _ways(name, fields.get("transitions"))
        plain = {
            str(field): value for field, value in fields.items() if field not in ("states", "history", "transitions")
        }
        yield State(name, parent, plain, ways=ways)
        if isinstance(fields.get("states"), Mapping):
            yield from _states(fields["states"], name)
        if isinstance(fields.get("history"), Mapping):
            for memory, what in fields["history"].items():
                ways = _ways(str(memory), what.get("transitions") if isinstance(what, Mapping) else None)
                yield State(str(memory), name, {"title": str(memory)}, ways=ways, remembers=True)


def _ways(source: str, given: Any) -> list[Way]:
    if not isinstance(given, list):
        return []
    return [
        Way(
            source,
            place,
            tuple(str(each.get("target") or "").split()),
            {str(key): value for key, value in each.items()},
        )
        for place, each in enumerate(given)
        if isinstance(each, Mapping)
    ]
