"""What a program does by itself on its way: SCXML's executable content, in states (`enter`, `exit`) and transitions (`actions`).

Events that are raised come before, those that are sent after all others that wait, or after their time, by the robot's clock. The
whole run hears both, programs that states run among it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import msgspec
from statemachine.event import _event_data_kwargs

from engines.programs.expressions import location, within
from engines.programs.schema import ActionFile

if TYPE_CHECKING:
    from handrail.config import Document

LOGGED, SENT = "logged", "sent"
"""names in the data model that a text to log, and an event to send, are assigned to"""
_KINDS = {"set": "set", "raise": "raise_", "send": "send", "log": "log", "if": "if_"}
_RESERVED = ("done.", "error.", "handrail.")


@dataclass(frozen=True)
class Action:
    """One step."""

    path: str
    """where it stands in the file"""
    file: ActionFile
    then: tuple[Action, ...] = ()
    otherwise: tuple[Action, ...] = ()

    def all(self) -> Iterator[Action]:
        """It and those in it."""
        yield self
        for each in (*self.then, *self.otherwise):
            yield from each.all()


def read(document: Document, path: str, given: Sequence[Any]) -> tuple[Action, ...]:
    """The actions of a list in a file. Raises config.ConfigError."""
    found = []
    for k in range(len(given)):
        where = f"{path}[{k}]"
        file = document.convert(ActionFile, where)
        then, otherwise = read(document, f"{where}.then", file.then), read(document, f"{where}.else", file.else_)
        found.append(Action(where, file, then, otherwise))
    return tuple(found)


def check(
    document: Document,
    actions: Sequence[Action],
    variables: Sequence[str],
    expression: Callable[[str, Any], None],
    text: Callable[[str, str], None],
) -> None:
    """Raise config.ConfigError at the first that can't be.

    :param expression: checks one, by path and value; `text`: one with expressions in it
    """
    for action in (inner for each in actions for inner in each.all()):
        file, error, path = action.file, document.error, action.path
        kinds = [kind for kind, field in _KINDS.items() if getattr(file, field)]
        if len(kinds) != 1:
            raise error(path, f"got {' and '.join(kinds) or 'nothing'}; expected one of {', '.join(_KINDS)}")
        if (action.then or action.otherwise) and not file.if_:
            raise error(path, "`then` and `else` without `if`; expected them together")
        if file.if_ and not action.then:
            raise error(f"{path}.then", "missing; expected what is done if so")
        if file.after and not (file.send and (isinstance(file.after, str) or 0 < file.after < math.inf)):
            raise error(f"{path}.after", f"got {file.after!r}; expected a time in s above 0, of what is sent")
        expression(f"{path}.after", file.after)
        if file.data and not file.send:
            raise error(f"{path}.data", "data of nothing; expected it with `send`")
        check_data(document, f"{path}.data", file.data, expression)
        event = file.raise_ or file.send
        if event and (event.startswith(_RESERVED) or any(each in event for each in " *|")):
            raise error(
                path, f"got {event!r}; expected the name of one event, not beginning with {', '.join(_RESERVED)}"
            )
        for name, value in file.set.items():
            if name not in variables:
                known = ", ".join(variables) or "none"
                raise error(f"{path}.set.{name}", f"no such variable; expected one of {known}")
            expression(f"{path}.set.{name}", value)
        if file.if_:
            expression(f"{path}.if", file.if_)
        if "_event" in file.log:
            raise error(
                f"{path}.log", f"got {file.log!r}; expected no _event in words: `set` a variable from it before"
            )
        text(f"{path}.log", file.log)


def sent(message: str) -> tuple[str, str | float, dict[str, Any]]:
    """What is assigned to `SENT`: the event, after how many s, and its data; the latter two may be expressions."""
    return msgspec.json.decode(message, type=tuple[str, str | float, dict[str, Any]])


def data_of(actions: Iterable[Action], event: str) -> frozenset[str]:
    """What data every event has that these raise or send and that a transition for `event` takes."""
    taken = [
        frozenset(each.file.data)
        for action in actions
        for each in action.all()
        if (name := each.file.raise_ or each.file.send) and f"{name}.".startswith(f"{event.removesuffix('.*')}.")
    ]
    return frozenset.intersection(*taken) if taken else frozenset()


def check_data(document: Document, path: str, data: Mapping[str, Any], expression: Callable[[str, Any], None]) -> None:
    """Raise config.ConfigError at the first of an event's data that can't be: name → expression, which `expression` checks."""
    for name, value in data.items():
        if not name.isidentifier() or name.startswith("_") or name in _event_data_kwargs:
            raise document.error(f"{path}.{name}", f"{name!r} can't be used in expressions; expected another name")
        if "_event" in str(value):
            problem = f"got {value!r}; expected no _event: `set` a variable from it before"
            raise document.error(f"{path}.{name}", problem)
        expression(f"{path}.{name}", value)


def native(actions: Sequence[Action], scope: str) -> list[dict[str, Any]]:
    """The same in python-statemachine's words."""
    return [step for each in actions for step in _native(each, scope)]


def _native(action: Action, scope: str) -> list[dict[str, Any]]:
    file = action.file
    if file.raise_:
        return [{"raise": file.raise_}]
    if file.if_:
        step = {"cond": within(scope, file.if_), "then": native(action.then, scope)}
        if action.otherwise:
            step["else"] = native(action.otherwise, scope)
        return [{"if": step}]
    if file.send:
        return [_assign(scope, SENT, repr(msgspec.json.encode([file.send, file.after, file.data]).decode()))]
    if file.log:
        return [_assign(scope, LOGGED, repr(file.log))]
    return [_assign(scope, name, value if isinstance(value, str) else repr(value)) for name, value in file.set.items()]


def _assign(scope: str, name: str, expression: str) -> dict[str, Any]:
    return {"assign": {"location": location(scope, name), "expr": within(scope, expression)}}
