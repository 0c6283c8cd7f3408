"""Joints sent somewhere by hand."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from handrail.messages.base import Message, Name, travels


@travels(priority=1, remote=True)
class Jog(Message):
    """Send joints somewhere, point to point, without a plan: nobody looks ahead for what is in the way but the daemon's guard.

    Answered when they are there, refused with what stopped them. A newer one of the same joints at the same speed takes over on the
    way, from the motion that there is; the older call is then refused as superseded. StopRun, PauseRun and ResumeRun count for it,
    as they do where it goes beside a paused program: that lets go of the joints.
    """

    joints: Annotated[dict[Name, float], Meta(min_length=1, max_length=64)]
    """joint → rad (m)"""
    by: bool = False
    """by so much from where they are commanded to be, or on their way to; else there"""
    speed: Annotated[float, Meta(gt=0, le=1)] = 0.1
    """share of the velocity limits, which the robot's speed (SetSpeed) counts on top of"""


class Jogged(Message):
    """Answer to Jog."""

    joints: dict[str, float]
    """rad (m), where they were sent, and are"""
