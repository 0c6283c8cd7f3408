"""Who commands which part of the robot, and the signs of life by which he keeps it."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from handrail.messages.base import Message, Name, travels


@travels(priority=1)
class CheckIn(Message):
    """I am alive. Actions whose owner does not check in for 1 s, of the wall's time and of the robot's, are ended safely."""

    owner: Name


@travels(priority=1)
class TakeLease(Message):
    """From now on, `owner` alone may command a part of the body (docs/safety.md, Leases). It must check in, as for an action.

    Refused where a joint of it is another owner's, unless it is taken over: then his actions on it are ended.
    """

    owner: Name
    part: Name
    """body, a group of the robot, or a gripper"""
    take_over: bool = False


class Lease(Message):
    """Answer to TakeLease: what the owner's commands must say from now on."""

    part: str
    owner: str
    epoch: int
    sequence: int
    """of the owner's last command; the next one's is higher"""


@travels(priority=1)
class ReturnLease(Message):
    """The part is free again. What runs on it goes on."""

    owner: Name
    part: Name
    epoch: int


@travels(priority=1, remote=True)
class BindKeepalive(Message):
    """From now on `owner` must answer challenges (KeepAlive) within `timeout_s`, at best at a third of it; or the robot holds what
    he commands, settles, and is damped to a stop (docs/safety.md). Bound anew, the timeout is another one.
    """

    owner: Name
    timeout_s: Annotated[float, Meta(ge=0.1, le=60.0)]
    """s of the robot's clock"""
    by: Annotated[str, Meta(max_length=128)] = ""
    """whose key it came with, as the link's gate says it; empty: from the robot's own machine"""


class Challenge(Message):
    """Answer to BindKeepalive, GetChallenge and KeepAlive: what the next KeepAlive answers."""

    challenge: str


@travels(priority=1, remote=True)
class GetChallenge(Message):
    """A new challenge for one who has lost his, as by a restart of the daemon's server. It keeps nothing alive."""

    owner: Name
    by: Annotated[str, Meta(max_length=128)] = ""
    """whose key it came with, as the link's gate says it; empty: from the robot's own machine"""


@travels(priority=1, remote=True)
class KeepAlive(Message):
    """I am there. Refused, and not counted, where the answer is wrong; final where the robot was damped meanwhile."""

    owner: Name
    answer: Annotated[str, Meta(max_length=200)]
    """handrail.keepalive.answer of the last challenge"""
    by: Annotated[str, Meta(max_length=128)] = ""
    """whose key it came with, as the link's gate says it; empty: from the robot's own machine"""


@travels(priority=1, remote=True)
class ReleaseKeepalive(Message):
    """`owner` need not answer any more. Over the link it is his to say who bound it."""

    owner: Name
    by: Annotated[str, Meta(max_length=128)] = ""
    """whose key it came with, as the link's gate says it; empty: from the robot's own machine"""
