"""What becomes of the robot, in lines for people: enabled, disabled, held by a safety rule and let go."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np

from daemon.exchange import Flag, Rule
from daemon.safety.report import safety_report
from daemon.serving.drive_reports import drive_problems
from handrail.robot.description import RobotDescription

Line = tuple[Literal["info", "warning", "error"], str]

_HOLDING = int(Rule.NOT_FINITE)
"""the rules before it hold the robot; the others end one action, which says so itself, or cut a set-point"""


class Happenings:
    """Compares each newest snapshot with the one before."""

    def __init__(self, description: RobotDescription):
        self._description = description
        self._enabled = False
        self._held = np.zeros(_HOLDING, bool)
        self._times = np.zeros(_HOLDING, np.int64)

    def between(self, newest: np.ndarray) -> Iterator[Line]:
        """What has happened since the last call, to the robot whose loop published this snapshot, shape ()."""
        enabled = Flag.ENABLED in Flag(int(newest["flags"]))
        held, times = newest["safety"]["holds"][:_HOLDING].astype(bool), newest["safety"]["times"][:_HOLDING]
        if enabled == self._enabled and (held == self._held).all() and (times == self._times).all():
            return
        before, self._enabled = self._enabled, enabled
        began, ended = held & (~self._held | (times != self._times)), self._held & ~held
        self._held[:], self._times[:] = held, times
        if began.any():
            report = safety_report(newest, self._description, drive_problems(newest, self._description))
            for rule in report.rules:
                if (row := Rule[rule.rule.upper()]) < _HOLDING and began[row]:
                    detail = f" ({rule.detail})" if rule.detail else ""
                    # A stop is what somebody wanted; windows warn of the rest.
                    level: Literal["info", "error"] = "info" if row == Rule.OPERATOR_STOP else "error"
                    yield level, f"held by {rule.rule}{detail}; `handrail safety explain` says how to recover"
        for which in np.flatnonzero(ended).tolist():
            yield "info", f"no longer held by {Rule(which).name.lower()}"
        if enabled != before:
            yield "info", "enabled: it holds where it is" if enabled else "no longer enabled"

    def begin_anew(self) -> None:
        """The loop was started anew: it counts from nothing."""
        self._enabled = False
        self._held[:], self._times[:] = False, 0
