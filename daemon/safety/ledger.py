"""Which safety rules have tripped, when, and which of them hold the robot now."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from daemon.exchange import SAFETY, Outcome, Rule
from daemon.safety.bounds import DIVERGED, STALE

if TYPE_CHECKING:
    from daemon.actions.table import Action
    from daemon.controllers.base import Ended

GUARDS = (Rule.SELF_COLLISION, Rule.WORKSPACE)
"""the rules that keep bodies apart: what they stop may start again once somebody has acknowledged it"""


class Ledger:
    """One row a rule (exchange.SAFETY); whoever publishes takes them over when there is `news`, and gives those the time."""

    def __init__(self) -> None:
        self.rows = np.zeros(len(Rule), SAFETY)
        self.rows["joint"] = -1
        self.news: list[Rule] = []
        """what has changed since somebody looked"""

    def trip(
        self,
        rule: Rule,
        joint: int = -1,
        value: float = 0.0,
        limit: float = 0.0,
        *,
        holds: bool = False,
        other: int = -1,
    ) -> None:
        """`rule` has tripped. `holds`: and holds the robot until `release`."""
        row = self.rows[rule]
        row["holds"], row["times"], row["joint"], row["other"] = holds, row["times"] + 1, joint, other
        row["value"], row["limit"] = value, limit
        row["time_ns"] = -1  # in this cycle
        self.news.append(rule)

    def note_end(self, of: Action | Ended) -> None:
        """An action, or a controller, was ended in this cycle; note it where a rule did that."""
        match of.outcome:
            case Outcome.DIVERGED:
                self.trip(Rule.DIVERGED, of.joint, of.value, DIVERGED)
            case Outcome.STALE_STATE:
                self.trip(Rule.STALE, of.joint, of.value, STALE)
            case Outcome.OWNER_LOST:
                self.trip(Rule.OWNER_LOST)

    def release(self, *rules: Rule) -> None:
        """These hold the robot no longer."""
        for rule in rules:
            if self.rows["holds"][rule]:
                self.rows["holds"][rule] = False
                self.news.append(rule)

    def holds(self, rule: Rule) -> bool:
        return bool(self.rows["holds"][rule])

    def told(self, time_ns: int) -> np.ndarray:
        """(len(Rule),) all rows, what has tripped since the last call as of `time_ns`."""
        self.rows["time_ns"][self.rows["time_ns"] < 0] = time_ns
        self.news.clear()
        return self.rows
