"""Behaviours: actions in a chain, each with its end conditions, that the loop runs without a round trip.

Source: Hebert et al., Supervised remote robot with guided autonomy and teleoperation (SURROGATE), ICRA 2015, §III-D: a state
machine whose states are actions, and whose transitions are their end conditions.
"""

from __future__ import annotations

from daemon.exchange import (
    MotionCommand,
    Outcome,
    PreparedMotion,
    StepCommand,
    StreamMotion,
    TargetMotion,
    TrajectoryMotion,
)


class Chain:
    """The steps of one behaviour, and where it stands."""

    def __init__(self, steps: tuple[StepCommand, ...], most: int):
        """`most`: steps that it may take."""
        self.steps, self.most = steps, most
        self.at, self.before, self.taken = 0, -1, 1
        """row of the step that runs, of the one before (−1: none); how many have been taken"""

    def following(self, outcome: Outcome, condition: int) -> int | None:
        """Row of the step that an end of the present one leads to; None: the behaviour ends, too.

        `condition`: of its end conditions, the one that tripped, where `outcome` says so.
        """
        if outcome not in (Outcome.DONE, Outcome.CONDITION):
            return None
        row = self.steps[self.at].then[0 if outcome is Outcome.DONE else 1 + condition]
        return None if row < 0 else row

    def go(self, row: int) -> None:
        """The step of `row` runs from now on."""
        self.before, self.at = self.at, row
        self.taken += 1


def frame_of(motion: MotionCommand) -> str:
    """The frame that a motion needs the external wrench at; "": none."""
    if isinstance(motion, TrajectoryMotion):
        return motion.path_force.frame if motion.path_force else ""
    return "" if isinstance(motion, PreparedMotion | StreamMotion | TargetMotion) else motion.frame
