"""The limits in the loop, and the guard behind them: applied to each cycle's command, and noted where they begin to cut."""

from __future__ import annotations

import numpy as np

from daemon.controllers.manager import ControllerManager
from daemon.exchange import Rule
from daemon.safety.guard import Guard
from daemon.safety.ledger import Ledger
from daemon.safety.limits import LIMITS, Cut, Limits, cut_of, enforce
from daemon.state.robot_state import RobotState
from hal.joint import JointCommand, JointState

HELD_BACK = 0.02
"""rad by which the limits may hold a command back before its action ends"""


class LastWord:
    """Says what is written. A limit that cuts in many cycles on end trips once, and holds while it does."""

    def __init__(self, manager: ControllerManager, robot: RobotState, ledger: Ledger, largest: JointCommand | None):
        """`largest`: the largest set-points that can be written (limits.Limits)."""
        self.limits = Limits.of(robot.kinematics.description, largest)
        self.guard, self._ledger = Guard(manager, robot, ledger), ledger
        self.limited = 0
        """cycles in which something was cut"""
        self._which = 0

    def say(self, out: JointCommand, wanted: JointCommand, previous: JointCommand, state: JointState) -> Cut:
        """`limits.enforce`, noted. `wanted`, the manager's command, becomes that of a brake where the guard has one put on."""
        cut = enforce(out, wanted, previous, state, self.limits)
        if cut.changed >= 0 and self.guard.brakes(out, previous):
            cut = enforce(out, wanted, previous, state, self.limits)
        if cut.which != self._which:
            self._note(cut, wanted, previous, state)
        if cut.changed > 0:
            self.limited += 1
        return cut

    def held_back(self, out: JointCommand, wanted: JointCommand) -> tuple[int, float] | None:
        """(joint, rad) where the limits hold a command back by too much. To be asked for where they cut something."""
        off = np.abs(out.position - wanted.position)
        worst = int(np.argmax(off))
        if not off[worst] > HELD_BACK:
            return None
        self._ledger.trip(Rule.HELD_BACK, worst, float(off[worst]), HELD_BACK)
        return worst, float(off[worst])

    def _note(self, cut: Cut, wanted: JointCommand, previous: JointCommand, state: JointState) -> None:
        for bit, limit in enumerate(LIMITS):
            now, before = cut.which >> bit & 1, self._which >> bit & 1
            if now and not before:
                asked, allowed = cut_of(limit, cut.joint, wanted, previous, state, self.limits)
                self._ledger.trip(limit, cut.joint, asked, allowed, holds=True)
            elif before and not now:
                self._ledger.release(limit)
        self._which = cut.which
