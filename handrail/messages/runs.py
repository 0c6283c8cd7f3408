"""A program's run: started, paused, stepped, told."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from handrail.messages.base import Message, Name, travels
from handrail.messages.instances import InstanceState
from handrail.messages.plans import PlanPreview
from handrail.messages.prompts import Prompt

OnFailure = Literal["pause", "end"]
"""what a run does when what a state does has failed, and the program has no way on from that but its end, or nobody could foresee
it (refused, crashed): it pauses, for somebody to help, or goes the program's way"""


@travels(priority=1, remote=True)
class Run(Message):
    """Start a deployed program."""

    deployment: Name
    on_failure: OnFailure = "end"


@travels(priority=1, remote=True)
class PauseRun(Message):
    """Pause the running program: the motion really stops."""

    engine: str = ""


@travels(priority=1, remote=True)
class ResumeRun(Message):
    """Go on. Refused, once, where a pre-condition of what the states do is not met: the run stays paused, and says which."""

    engine: str = ""


@travels(priority=1, remote=True)
class StopRun(Message):
    """End the running program: cancel its motion, leave the robot holding."""

    engine: str = ""


@travels(priority=1, remote=True)
class StepRun(Message):
    """Let a paused program go on until the next activity is about to begin."""

    engine: str = ""


@travels(priority=1, remote=True)
class SetBreakpoints(Message):
    """Pause the program before these states do what they do. Replaces those that there were; counts for the next runs too."""

    states: list[Name]
    engine: str = ""


@travels(priority=1, remote=True)
class TakeTransition(Message):
    """Leave an active state by a way out of the operator's choice, whatever its guard says; what it does is cancelled."""

    state: Name
    way: Annotated[int, Meta(ge=0)] | Literal["failed"] | None = None
    """index of the state's transition in the program's file; None: skip, by the first way that it has for being done; failed: what
    it does has failed, the run has paused for that, and the program is to go on from it as it says"""
    engine: str = ""


@travels(priority=1, remote=True)
class RunFrom(Message):
    """Run the last program anew from a state, with its variables as they stand. A run under way is stopped before.

    With `deployment` it goes on in another version of the program, with those of its variables that this one has, too. Refused
    where that has no such state.
    """

    state: Name
    paused: bool = False
    """True: wait before the state's activity until the run is resumed or stepped"""
    deployment: str = ""
    """of the same program, whose parameters then count; empty: the one that has run"""
    engine: str = ""


@travels(priority=1, remote=True)
class SetRunParameters(Message):
    """Change parameters of the running program: each counts from when it is used next."""

    parameters: dict[str, Any]
    engine: str = ""


@travels(priority=1, remote=True)
class SetAutonomy(Message):
    """How much programs do without asking, from now on: transitions that name this level or one above it are asked about."""

    level: Literal["off", "low", "high", "full"]
    engine: str = ""


@travels(priority=1, remote=True)
class GetRunHistory(Message):
    """What the last run went through."""

    engine: str = ""


class StateVisit(msgspec.Struct, kw_only=True):
    """One stay in a state."""

    state: str
    entered_ns: int
    """by the robot's clock"""
    left_ns: int = 0
    """0: it is active"""
    event: str = ""
    """what ended it; empty: a guard alone"""


class RunHistory(Message):
    """Answer to GetRunHistory."""

    run: str
    visits: list[StateVisit]
    """in the order in which the states were entered, the last 2000"""


@travels(priority=2, remote=True)
class RunState(Message):
    """A program's run, at every change."""

    run: str
    deployment: str
    program: str
    hash: str
    status: Literal["ready", "running", "paused", "succeeded", "failed", "stopped"]
    active: list[str]
    """ids of the active states, outermost first"""
    data: dict[str, Any] = {}
    """the program's variables as they stand, then its parameters; no name is both. Those of a program that an active state runs
    have the state's id before their names: ``grasping/force``"""
    failing: dict[str, str] = {}
    """active states whose activity has failed, and why, where the run has paused for that: it begins anew when the run goes on"""
    on_failure: OnFailure = "end"
    waiting: list[str] = []
    """active states that have not begun what they do, because the run is paused"""
    breakpoints: list[str] = []
    """states before whose activity the run pauses"""
    autonomy: str = "full"
    """transitions that name this level or one above it are asked about"""
    detail: str = ""
    """why it failed, stopped, or paused by itself"""
    warnings: list[str] = []
    """what of it looks like past runs that failed"""
    time_ns: int = 0


@travels(priority=1, remote=True)
class GetEngine(Message):
    """Everything a late client needs: instances, fresh and stale plans, the run, open prompts."""

    engine: str = ""


class EngineSnapshot(Message):
    """Answer to GetEngine."""

    instances: list[InstanceState]
    plans: list[PlanPreview]
    run: RunState | None
    prompts: list[Prompt]


@travels(priority=6, remote=True)
class LogLine(Message):
    """One line for people."""

    source: str
    """the engine's name, ``ENGINE/NODE`` of a process node that it runs, or ``daemon``"""
    level: Literal["info", "warning", "error"]
    text: str
    time_ns: int = 0
