"""`do: program`: another program of the library as one state, and whether what it is given is what it wants."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from typing import Any, Protocol

from engines.activities import ACTIVITIES
from engines.activities.base import Argument, Kind
from engines.programs.program import PROGRAM, Program, State
from engines.programs.schema import Resource


class Signature(Protocol):
    """What the check needs to know of what a state does."""

    @property
    def arguments(self) -> Mapping[str, Argument]: ...
    def outputs_of(self, given: Mapping[str, Any], /) -> frozenset[str]: ...
    def problem(self, given: Mapping[str, Any], /) -> tuple[str, str]: ...


class ProgramCall:
    """No activity: the program's states are the state's own, so that a run pauses, steps and is taken up in the midst of them."""

    arguments: Mapping[str, Argument] = {
        "program": Argument(Kind.PROGRAM),
        "bind": Argument(Kind.BINDINGS, required=False),
        "parameters": Argument(Kind.PORTS, required=False),
    }

    def outputs_of(self, given: Mapping[str, Any], /) -> frozenset[str]:
        """Known only with the program."""
        return frozenset()

    def problem(self, given: Mapping[str, Any], /) -> tuple[str, str]:
        """See `check_call`."""
        return "", ""


SIGNATURES: Mapping[str, Signature] = {**ACTIVITIES, PROGRAM: ProgramCall()}
"""what `do` may say"""


def check_call(program: Program, state: State, called: Program) -> None:
    """Raise config.ConfigError unless a state gives the program that it runs what that wants. Expressions were checked before."""
    given, path, error = state.file.with_, f"{state.path}.with", program.document.error
    bind, parameters = given.get("bind") or {}, given.get("parameters") or {}
    if not isinstance(bind, dict):
        raise error(f"{path}.bind", f"got {bind!r}; expected resources of {called.name} with resources of this program")
    for name in bind:
        if name not in called.resources:
            known = ", ".join(called.resources) or "none"
            raise error(f"{path}.bind.{name}", f"{called.name} has no resource {name!r}; expected one of {known}")
    for name, wanted in called.resources.items():
        fitting = [
            mine
            for mine, resource in program.resources.items()
            if resource.kind == wanted.kind and _always(resource, wanted)
        ]
        bound = bind.get(name)
        if bound not in fitting:
            kind = f"{wanted.kind} of template {' or '.join(wanted.templates)}" if wanted.templates else wanted.kind
            there = f"one of: {', '.join(fitting)}" if fitting else f"a declaration of an {kind} under `resources`"
            what = (
                f"missing; {called.name} needs it" if bound is None else f"got {bound!r}, no resource that is an {kind}"
            )
            raise error(f"{path}.bind.{name}", f"{what}; expected {there}")
    for name, value in parameters.items():
        where = f"{path}.parameters.{name}"
        if name not in called.parameters:
            known = ", ".join(called.parameters) or "none"
            raise error(where, f"{called.name} has no parameter {name!r}; expected one of {known}")
        if (constant := _constant(value)) is not None:
            problem, expected = called.problem(name, constant)
            if problem:
                raise error(where, f"got {constant!r}, {problem}; expected {expected}")
        mine, wants = program.parameters.get(str(value)), called.parameters[name]
        if mine is not None and (mine.type, wants.type) != ("integer", "number"):
            for field, has, wanted_ in (("type", mine.type, wants.type), ("unit", mine.unit, wants.unit)):
                if has != wanted_:
                    raise error(where, f"got {value!r}, whose {field} is {has!r}; expected {wanted_!r}")


def _always(mine: Resource, wanted: Resource) -> bool:
    """Whether all that one resource may be bound to is of a template that another one may be of."""
    return not wanted.templates or (bool(mine.templates) and set(mine.templates) <= set(wanted.templates))


def _constant(value: Any) -> Any:
    """The value of a number, a switch or a text in quotes; None of anything else."""
    if not isinstance(value, str):
        return value
    try:
        return ast.literal_eval(value)
    except (ValueError, SyntaxError):
        return None
