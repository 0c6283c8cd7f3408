"""The program that runs: what it is, where it stands, how far it got, and what may be done with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from handrail.messages import (
    Message,
    PauseRun,
    ResumeRun,
    Run,
    RunFrom,
    RunState,
    SetBreakpoints,
    StepRun,
    StopRun,
    TakeTransition,
)
from tablet_client.models.program_tree import ProgramTree
from tablet_client.models.quantities import has_unit, label, plain, quantity

_OVER = ("succeeded", "failed", "stopped")


@dataclass(frozen=True)
class Progress:
    """How far a program has turned something: degrees so far, and the goal (0: none is known)."""

    turned_deg: float
    goal_deg: float


class Task:
    """The engine's one run."""

    def __init__(self) -> None:
        self.run: RunState | None = None
        self.tree = ProgramTree()

    def take(self, run: RunState | None) -> None:
        self.run = run
        self.tree.take_run(run)

    @property
    def status(self) -> str:
        """The run's status, or `none`."""
        return self.run.status if self.run else "none"

    @property
    def progress(self) -> Progress | None:
        """From the program's `turned_deg` and `goal_deg` (or `turned`, `goal` in rad), variables or parameters."""
        if self.run is None:
            return None
        turned, goal = _angle(self.run.data, "turned"), _angle(self.run.data, "goal")
        return None if turned is None else Progress(turned, goal or 0.0)

    @property
    def facts(self) -> list[tuple[str, str]]:
        """Counters and quantities as (label, text), in the program's order; bare fractions are its own affair."""
        if self.run is None:
            return []
        shown = []
        for name, value in self.run.data.items():
            if name in ("turned", "turned_deg", "goal", "goal_deg"):
                continue
            if isinstance(value, bool) or not isinstance(value, int | float):
                continue
            if has_unit(name):
                shown.append(quantity(name, value))
            elif isinstance(value, int):
                shown.append((label(name), plain(value)))
        return shown

    def call(self, command: str, state: str = "") -> Message | None:
        """What to send for a command that may be given (`why_not`)."""
        run = self.run
        if run is None:
            return None
        if command == "breakpoint":
            return SetBreakpoints(states=sorted(set(run.breakpoints) ^ {state}))
        made: dict[str, Callable[[], Message]] = {
            "start": lambda: Run(deployment=run.deployment, on_failure="pause"),
            "pause": PauseRun,
            "resume": ResumeRun,
            "step": StepRun,
            "stop_run": StopRun,
            "skip": lambda: TakeTransition(state=self._failing or self.tree.innermost),
            "let_fail": lambda: TakeTransition(state=self._failing, way="failed"),
            "repeat": lambda: RunFrom(state=self.tree.innermost),
            "from": lambda: RunFrom(state=state),
        }
        return made[command]()

    @property
    def _failing(self) -> str:
        """The state that waits for help."""
        return next(iter(self.run.failing), "") if self.run is not None else ""

    @property
    def advice(self) -> str:
        """Code of what to do next where the run does not go on by itself; empty: nothing is needed."""
        if self.run is None:
            return ""
        if self.run.status == "failed":
            return "failed" if self.tree.innermost else "failed_at_once"
        if self.run.status == "stopped":
            return "stopped"
        if self.run.status == "paused" and self._failing:
            return "failing"
        if self.run.status == "paused":
            return "paused_before" if self.run.waiting else "paused"
        return ""

    def why_not(self, command: str) -> str:
        """Code of the reason why a command can't be given; empty when it can.

        `pause`, `resume`, `stop_run`, `step`; `skip` of the state that is at work, `let_fail` of the one that waits for help;
        `start` (again), `repeat` its last state, `from` a state; `autonomy`, `breakpoint`.
        """
        if self.run is None:
            return "no_program"
        if command in ("autonomy", "breakpoint", "from"):
            return ""
        if command == "start":
            return "" if self.run.status in (*_OVER, "ready") else "run_under_way"
        if command == "repeat":
            return "" if self.tree.innermost else "no_state"
        if self.run.status in _OVER:
            return "run_over"
        if command == "pause":
            return {"running": "", "paused": "already_paused"}.get(self.run.status, "not_running")
        if command == "let_fail":
            return "" if self._failing else "nothing_failed"
        if command == "skip":
            return "" if self.tree.innermost else "no_state"
        if command in ("resume", "step"):
            return "" if self.run.status == "paused" else "not_paused"
        return "" if self.run.status in ("running", "paused") else "not_running"


def _angle(data: dict[str, Any], name: str) -> float | None:
    for key, factor in ((f"{name}_deg", 1.0), (name, 57.29577951308232)):
        if isinstance(data.get(key), int | float):
            return float(data[key]) * factor
    return None
