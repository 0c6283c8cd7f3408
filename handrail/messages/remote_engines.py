"""An engine on another machine and the robot's gate: the engine fetches what it is called for, and brings answers and events.

Both are asked by the engine's side, so that only the robot has to be reachable. Only keys with the role `engine` may.
"""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from handrail.messages.base import Message, travels

PIECE = 512 * 1024
"""bytes: what is longer than this is said in pieces"""


@travels(priority=1, remote=True)
class FetchCalls(Message):
    """What is the engine called for? Answered as soon as there is something, at the latest after half a second.

    It is also the engine's sign of life: where none comes for 3 s, the engine has gone for everybody on the robot's side.
    """

    process: Annotated[str, Meta(max_length=64)] = ""
    """a word that no other process has: one at a time is the engine. Empty: only which engine the key is"""


class CallForEngine(msgspec.Struct, forbid_unknown_fields=True):
    """A call as local services have it."""

    number: int
    payload: bytes


class CallsForEngine(Message):
    """Answer to FetchCalls."""

    engine: str
    """its name here: that of its key"""
    calls: list[CallForEngine] = []


class Said(msgspec.Struct, forbid_unknown_fields=True):
    """An answer or an event of an engine, or a piece of one."""

    payload: bytes
    number: Annotated[int, Meta(ge=0)] = 0
    """of the call that is answered; 0: an event"""
    event: Annotated[str, Meta(max_length=64)] = ""
    """its type"""
    piece: Annotated[int, Meta(ge=0)] = 0
    more: bool = False
    """the next piece goes on with it"""


@travels(priority=1, remote=True)
class EngineSays(Message):
    """What the engine answers and tells, in order."""

    process: Annotated[str, Meta(max_length=64)]
    batch: Annotated[int, Meta(ge=1)]
    """one that has been brought already, and whose answer was lost with the line, counts once"""
    said: list[Said]


FetchCalls.Reply = CallsForEngine
