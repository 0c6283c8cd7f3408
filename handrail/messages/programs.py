"""The library of programs, their deployment and their check."""

from __future__ import annotations

from typing import Any, Literal

import msgspec

from handrail.messages.base import Message, Name, travels


@travels(priority=1, remote=True)
class ListLibrary(Message):
    """What programs and templates are there?"""

    engine: str = ""


class LibraryEntry(msgspec.Struct, kw_only=True):
    name: str
    kind: Literal["program", "template"]
    title: str = ""
    hash: str = ""
    problem: str = ""
    """why it can't be used, with file and line"""


class Library(Message):
    """Answer to ListLibrary."""

    entries: list[LibraryEntry]


@travels(priority=1, remote=True)
class Deploy(Message):
    """Check a program whole, bind its resources and make it ready to run."""

    program: Name
    bindings: dict[str, str]
    """resource → robot part or instance, e.g. arm → right, valve → wheel_1"""
    parameters: dict[str, Any] = {}
    engine: str = ""
    """that shall have it, empty: the first"""


class Deployment(Message):
    """Answer to Deploy."""

    id: str
    program: str
    hash: str
    """of the content that will run"""
    warnings: list[str] = []
    """what of it looks like past runs that failed (docs/learning.md)"""


@travels(priority=1, remote=True)
class CheckTask(Message):
    """Rehearse a deployed program from where the robot is, without moving it: every motion planned and verified end to end.

    Answered when it has ended, or with the first motion that is infeasible. Where its motions end is where the program looks first
    when it runs.
    """

    deployment: Name


class TaskStep(msgspec.Struct, kw_only=True):
    """One activity of a rehearsal that plans a motion, or could not be done."""

    state: str
    activity: str
    what: str = ""
    """the plan, or the behaviour"""
    clearance: float | None = None
    """m"""
    limit_margin: float | None = None
    """rad"""
    duration: float | None = None
    """s"""
    unknown: bool = False
    """what it does is found out by doing it: it was taken to go well, and was not verified"""
    problem: str = ""
    """why it can't be done, with what is missed and by how much"""


class TaskCheck(Message):
    """Answer to CheckTask."""

    program: str
    hash: str
    feasible: bool
    first_infeasible: str
    """id of the state, empty: none"""
    outcome: str
    """of the program, if everything goes as planned"""
    detail: str
    steps: list[TaskStep]


@travels(priority=1, remote=True)
class GetOutline(Message):
    """Which states does a deployed program have?"""

    deployment: str = ""
    """empty: the one that ran last, or runs"""
    engine: str = ""


class OutlineState(msgspec.Struct, kw_only=True):
    """One state of a program."""

    id: str
    """as RunState names it"""
    parent: str = ""
    """id of the state that it is in"""
    title: str = ""
    does: str = ""
    """its activity; empty: it only decides, or holds other states"""
    parallel: bool = False
    """all states in it are active together"""
    outcome: str = ""
    """of the program, where it ends it"""
    ways: list[str] = []
    """the states that its transitions lead to, in the file's order (TakeTransition.way); empty: it stays where it is"""


class Outline(Message):
    """Answer to GetOutline."""

    deployment: str
    program: str
    title: str
    hash: str
    states: list[OutlineState]
    """as they stand in the file; those of a program that a state runs come after that state"""
