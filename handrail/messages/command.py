"""Who of those that are connected commands the robot: taken and returned by people, kept at the link (docs/safety.md)."""

from __future__ import annotations

from handrail.messages.base import Message, travels
from handrail.messages.processes import ClientIdentity


@travels(priority=1, remote=True)
class TakeCommand(Message):
    """From now on only who has this key moves the robot over the link, until he returns it or is not heard for 10 s.

    STOP, cancel and pause stay everybody's. Refused where somebody else has it, unless it is taken over.
    """

    take_over: bool = False


@travels(priority=1, remote=True)
class ReturnCommand(Message):
    """Whoever is connected may command again. Refused where somebody else has it."""


TakeCommand.Reply = ReturnCommand.Reply = ClientIdentity
