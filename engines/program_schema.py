"""What a program's file may say: one struct a part, unknown fields refused."""

from __future__ import annotations

import math
from typing import Any, Literal

import msgspec

Literals = str | int | float | bool | None


class _Struct(msgspec.Struct, forbid_unknown_fields=True):
    pass


class Resource(_Struct):
    """Something of the robot or the world that the program names abstractly; bound when it is deployed."""

    kind: Literal["arm", "instance"]
    template: str = ""
    """instance: which template it must be of"""
    title: str = ""


class Parameter(_Struct):
    """A number, word or switch that may be given at deployment."""

    default: Literals
    type: Literal["number", "integer", "text", "bool"] = "number"
    unit: str = ""
    min: float = -math.inf
    max: float = math.inf
    title: str = ""


class TransitionFile(_Struct):
    """SCXML's transition. `set`: variable → expression, carried out on the way."""

    target: str | None = None
    event: str | None = None
    cond: str | None = None
    set: dict[str, Any] = {}
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
    transitions: list[Any] = []
    states: dict[str, Any] = {}
    history: dict[str, Any] = {}
    outcome: Literal["succeeded", "failed", ""] = ""
    """top-level final states: how the run ends"""
    detail: str = ""
    """top-level final states: words for people, with {expression} in them"""


class ProgramFile(_Struct):
    """A whole file; its parts are converted one by one, so that errors know their lines."""

    title: str
    states: dict[str, Any]
    resources: dict[str, Any] = {}
    parameters: dict[str, Any] = {}
    variables: dict[str, Literals] = {}
