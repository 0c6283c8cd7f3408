"""What a program's file may say: one struct a part, unknown fields refused; and the same as JSON Schema, for editors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import msgspec

Literals = str | int | float | bool | None


class _Struct(msgspec.Struct, forbid_unknown_fields=True):
    pass


class Resource(_Struct):
    """Something of the robot or the world that the program names abstractly; bound when it is deployed."""

    kind: Literal["arm", "instance"]
    template: str | list[str] = ""
    """instance: which template it must be of, or one of which"""
    title: str = ""

    @property
    def templates(self) -> tuple[str, ...]:
        """Those that an instance may be of; none: of any."""
        given = [self.template] if isinstance(self.template, str) else self.template
        return tuple(name for name in given if name)


class Parameter(_Struct):
    """A number, word or switch that may be given at deployment."""

    default: Literals
    type: Literal["number", "integer", "text", "bool"] = "number"
    unit: str = ""
    min: float = -math.inf
    max: float = math.inf
    title: str = ""


class Output(_Struct):
    """A value that whoever runs the program as a state gets of it, in `_event.data`."""

    value: str = ""
    """an expression, evaluated at the end; empty: what has the output's own name"""
    type: Literal["number", "integer", "text", "bool"] = "number"
    unit: str = ""
    title: str = ""


class ActionFile(_Struct, rename={"raise_": "raise", "if_": "if", "else_": "else"}):
    """Something that the program does by itself: one of `set`, `raise`, `send`, `log`, `if`."""

    set: dict[str, Any] = {}
    """variable → expression"""
    raise_: str = ""
    """an event, before all that wait"""
    send: str = ""
    """an event, after all that wait"""
    data: dict[str, Any] = {}
    """of what is sent: name → expression, evaluated as it is sent; `_event.data` has them"""
    after: float | str = 0.0
    """s of the run's time, until it is sent (a number, or an expression)"""
    log: str = ""
    """words for people, with {expression} in them"""
    if_: str = ""
    """an expression: `then` is done where it holds, else `else`"""
    then: list[Any] = []
    else_: list[Any] = []


class TransitionFile(_Struct):
    """SCXML's transition. `set`: variable → expression, carried out on the way."""

    target: str | None = None
    event: str | None = None
    after: float | str | None = None
    """s of the run's time in the state (a number, or an expression), instead of an event: a time-out"""
    cond: str | None = None
    internal: bool = False
    """to a state within: this one is not left for it"""
    set: dict[str, Any] = {}
    actions: list[Any] = []
    """done on the way, after `set`"""
    autonomy: Literal["off", "low", "high", "full", ""] = ""
    """the operator is asked before it is taken, where the run's level is not above this one"""
    title: str = ""


class HistoryFile(_Struct):
    """SCXML's history pseudo-state."""

    type: Literal["shallow", "deep"] = "shallow"
    transitions: list[Any] = []


class StateFile(_Struct, rename={"with_": "with"}):
    """A state: what it does, where it leads, what is in it."""

    title: str = ""
    initial: bool = False
    final: bool = False
    parallel: bool = False
    do: str = ""
    with_: dict[str, Any] = {}
    retry: Annotated[int, msgspec.Meta(ge=0)] = 0
    """how often its activity is begun anew when it fails, before any transition for the failure counts"""
    enter: list[Any] = []
    """actions, where it is entered; `exit`: where it is left"""
    exit: list[Any] = []
    transitions: list[Any] = []
    states: dict[str, Any] = {}
    start: dict[str, Any] = {}
    """a transition that is taken where the state is entered itself: to states in it, however deep, instead of the `initial` one"""
    history: dict[str, Any] = {}
    outcome: Literal["succeeded", "failed", ""] = ""
    """top-level final states: how the run ends, or the state that runs this program: done, or failed"""
    detail: str = ""
    """top-level final states: words for people, with {expression} in them"""
    data: dict[str, Any] = {}
    """final states in another one: name → expression; `_event.data` after `done.state.` has them"""


class ProgramFile(_Struct):
    """A whole file; its parts are converted one by one, so that errors know their lines."""

    title: str
    states: dict[str, Any]
    resources: dict[str, Any] = {}
    parameters: dict[str, Any] = {}
    variables: dict[str, Literals] = {}
    outputs: dict[str, Any] = {}
    start: str = ""
    """states that a run begins in, however deep, instead of the `initial` one; one, or one of each parallel region"""


def json_schema(activities: Mapping[str, Mapping[str, bool]]) -> dict[str, Any]:
    """JSON Schema (2020-12) of a program's file.

    :param activities: what `do` may say → its arguments → whether they must be given
    """
    kinds = (ProgramFile, StateFile, TransitionFile, ActionFile, HistoryFile, Resource, Parameter, Output)
    (top, *_), parts = msgspec.json.schema_components(kinds, ref_template="#/$defs/{name}")

    def of(kind: type) -> dict[str, Any]:
        return {"$ref": f"#/$defs/{kind.__name__}"}

    holds: list[tuple[type, str, dict[str, Any]]] = [
        *(
            (kind, "states", {"type": "object", "additionalProperties": of(StateFile)})
            for kind in (ProgramFile, StateFile)
        ),
        *((kind, "transitions", {"type": "array", "items": of(TransitionFile)}) for kind in (StateFile, HistoryFile)),
        *(
            (kind, field, {"type": "array", "items": of(ActionFile)})
            for kind, fields in (
                (StateFile, ("enter", "exit")),
                (TransitionFile, ("actions",)),
                (ActionFile, ("then", "else")),
            )
            for field in fields
        ),
        (StateFile, "start", of(TransitionFile)),
        (StateFile, "history", {"type": "object", "additionalProperties": of(HistoryFile)}),
        (ProgramFile, "resources", {"type": "object", "additionalProperties": of(Resource)}),
        (ProgramFile, "parameters", {"type": "object", "additionalProperties": of(Parameter)}),
        (ProgramFile, "outputs", {"type": "object", "additionalProperties": {"anyOf": [of(Output), {"type": "null"}]}}),
    ]
    for kind, field, schema in holds:
        parts[kind.__name__]["properties"][field] = schema
    for field in ("min", "max"):  # without bounds: JSON has no infinity
        parts[Parameter.__name__]["properties"][field].pop("default", None)
    state = parts[StateFile.__name__]
    state["properties"]["do"] = {"enum": list(activities)}
    state["allOf"] = [
        {
            "if": {"properties": {"do": {"const": name}}, "required": ["do"]},
            "then": {
                "properties": {
                    "with": {
                        "type": "object",
                        "properties": dict.fromkeys(arguments, True),
                        "required": [each for each, must in arguments.items() if must],
                        "additionalProperties": False,
                    }
                },
                **({"required": ["with"]} if any(arguments.values()) else {}),
            },
        }
        for name, arguments in activities.items()
    ]
    # A state that only marks a place may be empty.
    parts["State"] = {"anyOf": [of(StateFile), {"type": "null"}]}
    for kind in (ProgramFile, StateFile):
        parts[kind.__name__]["properties"]["states"]["additionalProperties"] = {"$ref": "#/$defs/State"}
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "A program", **top, "$defs": parts}
