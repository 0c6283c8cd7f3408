"""The processes that `handrail up` keeps alive: how they are, what they said, and starting one anew; and who asks."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from handrail.messages.base import Message, Name, NonNegative, travels

MOST_LINES = 200
"""of a process that are kept"""


class ProcessUse(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """A process of the robot's service, or one that such a process has started itself."""

    name: Name
    depth: Annotated[int, Meta(ge=0)] = 0
    """0: the service's own; n: started by the one above it with n - 1"""
    state: Literal["waiting", "starting", "up", "back-off", "gone"]
    """`back-off`: it died, and is started anew after a while; `gone`: its supervisor has not noticed yet"""
    for_s: NonNegative = 0.0
    """wall time in that state, s"""
    process: int = 0
    """its number on the robot's computer; 0: there is none now"""
    cpu: NonNegative = 0.0
    """share of one core, 1 is all of it, since somebody asked last"""
    memory_mb: NonNegative = 0.0
    """resident, MB"""
    deaths: Annotated[int, Meta(ge=0)] = 0
    last: str = ""
    """the last line that it said, or that was said about it"""


@travels(priority=5, remote=True)
class GetProcesses(Message):
    """How are the processes of the robot's service? Answered by their supervisor, whatever else is dead."""


class Processes(Message):
    """Answer to GetProcesses, in the order of their start."""

    processes: list[ProcessUse]


class SaidLine(msgspec.Struct, forbid_unknown_fields=True):
    """A line that a process said, or that its supervisor said about it."""

    age_s: NonNegative
    """how long ago, s of wall time"""
    text: str


@travels(priority=6, remote=True)
class GetProcessLog(Message):
    """What did a process say last?"""

    process: Name
    lines: Annotated[int, Meta(ge=1, le=MOST_LINES)] = 100


class ProcessLog(Message):
    """Answer to GetProcessLog: the oldest line first, lines cut at 500 characters."""

    process: Name
    lines: list[SaidLine]


@travels(priority=1, remote=True)
class RestartProcess(Message):
    """End a process of the service and start it anew, with those that can't go on without it. For people: engines may not."""

    process: Name
    by: str = ""
    """whose key the call came with: the link writes it"""
    role: str = ""


@travels(priority=1, remote=True)
class GetIdentity(Message):
    """Whose key is this, and what may it do? Answered by the link itself: it tells how long a call takes there and back."""


class ClientIdentity(Message):
    """Answer to GetIdentity."""

    name: str
    role: Literal["observer", "operator", "developer", "engine", "none"]
    """`none`: the key is not let in any more"""
    commander: str = ""
    """who has the command (TakeCommand): name of a key; empty: whoever is connected may command"""


GetProcesses.Reply = Processes
GetProcessLog.Reply = ProcessLog
GetIdentity.Reply = ClientIdentity
