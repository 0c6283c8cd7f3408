"""The program that runs: what it is, where it stands, how far it got, and what may be done with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from handrail.messages import RunState
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

    def take(self, run: RunState | None) -> None:
        self.run = run

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

    def why_not(self, command: str) -> str:
        """Code of the reason why `pause`, `resume` or `stop_run` can't be pressed; empty when it can."""
        if self.run is None:
            return "no_program"
        if self.run.status in _OVER:
            return "run_over"
        if command == "pause":
            return {"running": "", "paused": "already_paused"}.get(self.run.status, "not_running")
        if command == "resume":
            return "" if self.run.status == "paused" else "not_paused"
        return "" if self.run.status in ("running", "paused") else "not_running"


def _angle(data: dict[str, Any], name: str) -> float | None:
    for key, factor in ((f"{name}_deg", 1.0), (name, 57.29577951308232)):
        if isinstance(data.get(key), int | float):
            return float(data[key]) * factor
    return None
