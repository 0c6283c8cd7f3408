"""The engines of a robot: which there are, and what each does."""

from __future__ import annotations

from typing import Literal

from handrail.messages.base import Message, Name, travels


@travels(priority=2, remote=True)
class EngineInfo(Message):
    """An engine: told when it comes, when it goes, and when its code or its run is another one."""

    name: Name
    up: bool = True
    host: str = ""
    """the machine that it runs on"""
    release: int = 0
    """number of the code in force, 0: nothing was ever deployed to it"""
    program: str = ""
    """that it ran last, or runs"""
    status: Literal["", "ready", "running", "paused", "succeeded", "failed", "stopped"] = ""
    """of that run"""
    hash: str = ""
    """of the content that it runs"""


@travels(priority=1, remote=True)
class GetEngines(Message):
    """Which engines are there? Answered by the link; an engine asked itself tells of itself alone."""

    engine: str = ""


class Engines(Message):
    """Answer to GetEngines."""

    engines: list[EngineInfo]
    """the first one first"""


GetEngines.Reply = Engines
