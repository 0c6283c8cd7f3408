"""A program in python-statemachine's own words.

Expressions of a program that a state of another one runs are marked with their scope (`engines.programs.expressions.within`). A
failure is known only to the program whose activity has failed: a parallel region that runs another one hears nothing of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from engines.programs import actions
from engines.programs.actions import Action
from engines.programs.check import BEGIN, STOPPED, takes
from engines.programs.expressions import FAILED_IN, location, within
from engines.programs.program import AUTONOMY, Program, State, Transition

STOP = "handrail.stop"
TAKE = "handrail.take"
AFTER = "handrail.after"
RETRY = "handrail.retry"
ALLOW = "handrail.allow"


def chart(program: Program, start_at: Sequence[str]) -> dict[str, Any]:
    """The program, with a final state that StopRun leads to from everywhere.

    :param start_at: the states that it begins in, however deep; none: as the program says. How a state is
        entered later is not touched by that.
    """
    first = next((root.id for root in program.roots if root.file.initial), program.roots[0].id)
    several = any(state.called is not None for state in program.states())
    begin: dict[str, Any] = {}
    if targets := " ".join(start_at or program.start):
        first = BEGIN
        begin = {BEGIN: {"initial": True, "transitions": [{"target": targets}]}}
    states = {state.id: _state(state, state.id == first, several) for state in program.roots}
    return {"name": program.name, "states": {**begin, **states, STOPPED: {"final": True}}}


def _state(state: State, first: bool, several: bool) -> dict[str, Any]:
    """`first`: it is entered with its parent; `several`: there are programs that others run."""
    done = {"enter": actions.native(state.enter, state.scope), "exit": actions.native(state.exit, state.scope)}
    if state.file.final:
        given = [
            {"name": name, "expr": within(state.scope, value if isinstance(value, str) else repr(value))}
            for name, value in state.file.data.items()
        ]
        data = {"donedata": {"params": given}} if given else {}
        return {"final": True, "initial": first, **done, **data}
    native: dict[str, Any] = {"initial": first, "parallel": state.file.parallel, **done}
    native["transitions"] = [
        each for k, way in enumerate(state.transitions) for each in _ways(way, state, f"{state.id}.{k}", several)
    ]
    if state.file.retry:
        native["transitions"].append({"event": f"{RETRY}.{state.id}", "target": state.id})
    native["transitions"] += [
        _taken(way, state.scope, f"{TAKE}.{state.id}.{k}") for k, way in enumerate(state.transitions) if way.file.target
    ]
    if not state.children or any(child.file.final for child in state.children):
        # First in each innermost state: no other transition of the program can take the event away.
        native["transitions"].insert(0, {"event": STOP, "target": STOPPED})
    if state.start is not None:
        native["transitions"].append({"initial": True, **_transition(state.start, state.scope, None)})
    if state.children:
        entered = {child.id for child in state.initial_children()} if state.start is None else set()
        native["states"] = {
            child.id: _state(child, not state.file.parallel and child.id in entered, several)
            for child in state.children
        }
    if state.history:
        native["history"] = {
            name: {
                "type": state.history_type[name],
                "transitions": [_transition(way, state.scope, way.file.cond) for way in ways],
            }
            for name, ways in state.history.items()
        }
    return native


def _ways(way: Transition, state: State, key: str, several: bool) -> list[dict[str, Any]]:
    """A transition; where the operator may have to be asked, it is three: without asking, the question, and with his leave.

    `key`: state and index, dotted.
    """
    cond, timeout = way.file.cond, f"{AFTER}.{key}"
    if several and takes(way, "error.execution"):
        own = f"({FAILED_IN} == None or {FAILED_IN} == {state.scope!r})"
        cond = f"({cond}) and {own}" if cond else own
    if not way.file.autonomy:
        return [_transition(way, state.scope, cond, timeout)]
    free = f"autonomy_level > {AUTONOMY[way.file.autonomy]}"
    native = _transition(way, state.scope, f"({cond}) and {free}" if cond else free, timeout)
    question = _transition(way, state.scope, cond, timeout)
    asks = {name: question[name] for name in ("event", "cond") if name in question}
    return [
        native,
        asks | {"on": [{"assign": {"location": "asked", "expr": repr(key)}}]},
        {**native, "event": f"{ALLOW}.{key}", "cond": "True"},
    ]


def _transition(way: Transition, scope: str, cond: str | None, timeout: str = "") -> dict[str, Any]:
    """`timeout`: the event that comes when the time is over that the transition waits for, where it does."""
    native: dict[str, Any] = {
        key: value for key in ("event", "target") if (value := getattr(way.file, key)) is not None
    }
    if cond is not None:
        native["cond"] = within(scope, cond)
    if way.file.internal:
        native["internal"] = True
    if way.file.after is not None:
        native["event"] = timeout
    return native | _does(way.file.set, way.actions, scope)


def _taken(way: Transition, scope: str, event: str) -> dict[str, Any]:
    """The same way out for an operator who orders it: no guard, and nothing is set from the data of an event that did not come."""
    known = {name: value for name, value in way.file.set.items() if "_event" not in str(value)}
    blind = [each for each in way.actions if "_event" not in str(each)]
    return {"event": event, "target": way.file.target, **_does(known, blind, scope)}


def _does(values: Mapping[str, Any], then: Sequence[Action], scope: str) -> dict[str, Any]:
    if not values and not then:
        return {}
    return {
        "on": [
            *(
                {
                    "assign": {
                        "location": location(scope, name),
                        "expr": within(scope, expression if isinstance(expression, str) else repr(expression)),
                    }
                }
                for name, expression in values.items()
            ),
            *actions.native(then, scope),
        ]
    }
