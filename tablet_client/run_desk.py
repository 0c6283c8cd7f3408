"""The program's side of the desk: the run as QML sees it, its tree of states, and the buttons' way down."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from PySide6.QtCore import Property, QObject, Signal, Slot

from handrail.messages import Message, SetAutonomy
from tablet_client.models.situation import Situation
from tablet_client.rows import Rows

COMMANDS = ("start", "pause", "resume", "step", "skip", "let_fail", "repeat", "stop_run")
LEVELS = ("off", "low", "high", "full")
_ROLES = ("id", "title", "depth", "does", "mark", "seconds", "visits", "halts", "outcome", "chosen")
_SENT_AS = {
    "start": "Run",
    "pause": "PauseRun",
    "resume": "ResumeRun",
    "step": "StepRun",
    "skip": "TakeTransition",
    "let_fail": "TakeTransition",
    "repeat": "RunFrom",
    "from": "RunFrom",
    "stop_run": "StopRun",
    "breakpoint": "SetBreakpoints",
    "autonomy": "SetAutonomy",
}
_MAP: Any = "QVariantMap"  # PySide takes the names of Qt's types; its stubs do not


class RunDesk(QObject):
    """What QML reads of the run, and calls."""

    changed = Signal()

    def __init__(self, situation: Situation, send: Callable[[Message], None]):
        super().__init__()
        self._situation, self._send = situation, send
        self._view: dict[str, Any] = {}
        self._tree = Rows(_ROLES, "id")
        self._chosen = ""
        self.build()

    @Property(_MAP, notify=changed)
    def view(self) -> dict[str, Any]:
        return self._view

    @Property(QObject, constant=True)
    def tree(self) -> Rows:
        return self._tree

    @Slot(str)
    def command(self, name: str) -> None:
        """One of COMMANDS; does nothing while the button says why it can't."""
        self._do(name)

    @Slot(str)
    def choose(self, state: str) -> None:
        """Show what can be done with a state; the same again: no more."""
        self._chosen = "" if state == self._chosen else state
        self.build()

    @Slot(str)
    def breakpoint(self, state: str) -> None:
        """Pause before what a state does, from now on, or no more."""
        self._do("breakpoint", state)

    @Slot(str)
    def runFrom(self, state: str) -> None:
        """Run the program anew from a state; one under way is stopped before."""
        self._do("from", state)

    @Slot(str)
    def setAutonomy(self, level: str) -> None:
        """How much the program does without asking."""
        if level in LEVELS and not self.why("autonomy"):
            self._send(SetAutonomy(level=level))  # type: ignore[arg-type]

    def why(self, command: str) -> str:
        """Code of the reason why a command can't be given now; empty when it can."""
        if _SENT_AS[command] in self._situation.pending:
            return "sending"
        return self._situation.why_not_command(command)

    def build(self) -> None:
        """Look at the models anew."""
        task = self._situation.task
        run, progress, tree = task.run, task.progress, task.tree
        self._tree.show(
            [asdict(row) | {"chosen": row.id == self._chosen} for row in tree.rows(self._situation.robot.time_ns)]
        )
        chosen = tree.state(self._chosen)
        view = {
            "status": task.status,
            "program": run.program if run else "",
            "title": tree.outline.title if tree.outline else "",
            "hash": run.hash if run else "",
            "detail": (run.detail or "; ".join(run.failing.values())) if run else "",
            "warnings": list(run.warnings) if run else [],
            "advice": self._advice(),
            "failing": bool(run and run.failing),
            "active": list(run.active) if run else [],
            "innermost": tree.innermost,
            "autonomy": run.autonomy if run else "",
            "turned": progress.turned_deg if progress else -1.0,
            "goal": progress.goal_deg if progress else 0.0,
            "facts": [{"label": label, "text": text} for label, text in task.facts],
            "why": {name: self.why(name) for name in (*COMMANDS, "from", "breakpoint", "autonomy")},
            "chosen": chosen.id if chosen else "",
        }
        if view != self._view:
            self._view = view
            self.changed.emit()

    def _advice(self) -> str:
        """What to do next; where the robot itself keeps the program from going on, that comes first."""
        robot, advice = self._situation.robot, self._situation.task.advice
        if advice in ("failed", "failed_at_once", "failing", "stopped"):
            if robot.drives == "stopped":
                return "clear_first"
            if robot.drives in ("fault", "quick_stop", "disabled"):
                return "enable_first"
        return advice

    def _do(self, name: str, state: str = "") -> None:
        call = None if self.why(name) else self._situation.task.call(name, state)
        if call is not None:
            self._send(call)
