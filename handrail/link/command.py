"""Who of those that are connected has the command: one key at a time, as long as something is heard of it.

Parts of the body are settled between engines and scripts by the daemon's leases (`daemon/serving/leases.py`). This is between
people: they command through the same engine, and one of them may keep the others from it.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from handrail import messages as m
from handrail.topics import refuse

LAPSES_S = 10.0
"""without a call of his key, whoever has the command has it no more: his link is gone, or his window"""
COMMANDING = (
    *(m.Enable, m.Disable, m.ClearStop, m.StartAction, m.StartBehaviour, m.ResumeAction, m.SetSpeed),
    *(m.StreamPose, m.StreamJoints, m.CommandGripper, m.SwitchRelay),
    *(m.ExecutePlan, m.Jog, m.Run, m.RunTemplate, m.ResumeRun, m.StepRun, m.TakeTransition, m.RunFrom),
    *(m.SetRunParameters, m.SetAutonomy, m.AnswerPrompt),
)
"""calls that move the robot, or let it move: from others they are refused. What ends or pauses something is everybody's; so are
objects, plans and code, which are shared"""


class Command:
    """Nobody has it until somebody takes it."""

    def __init__(self, clock: Callable[[], float] = time.monotonic):
        """`clock`: s."""
        self._clock = clock
        self._holder, self._heard = "", 0.0

    @property
    def holder(self) -> str:
        """Name of the key; empty: whoever is connected may command."""
        if self._holder and self._clock() - self._heard > LAPSES_S:
            self._holder = ""
        return self._holder

    def heard(self, name: str) -> None:
        """A call came with this key."""
        if name == self.holder:
            self._heard = self._clock()

    def take(self, name: str, *, take_over: bool = False) -> str:
        """Who had it (empty: nobody). Raises RefusedError where somebody else has it and it is not taken over."""
        before = self.holder
        if before not in ("", name) and not take_over:
            raise refuse(f"{before} has the command", "take_over", False, f"true, or to wait until {before} returns it")
        self._holder, self._heard = name, self._clock()
        return before

    def give_back(self, name: str) -> None:
        """Raises RefusedError where somebody else has it."""
        if self.holder not in ("", name):
            raise refuse(f"{self.holder} has the command", "by", name, self.holder)
        self._holder = ""

    def check(self, name: str, call: object) -> None:
        """Raises RefusedError where a call commands and somebody else has the command."""
        if isinstance(call, COMMANDING) and self.holder not in ("", name):
            raise refuse(
                f"{self.holder} has the command, and the link knows you as {name}",
                "by",
                name,
                f"{self.holder}, or to take the command over",
            )
