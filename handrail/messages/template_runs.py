"""A template that runs alone: its trajectory as a program of its own."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from handrail.messages.base import Message, Name, travels
from handrail.messages.runs import OnFailure


@travels(priority=1, remote=True)
class ExpandTemplate(Message):
    """Which program would an instance's trajectory be? Answered by TemplateProgram."""

    instance: Name
    trajectory: Name
    arm: str = ""
    """empty: the robot's only one"""
    other: str = ""
    """of a sync, in place of a trajectory: the arm of its second hand, `arm` being its first one's; empty: the arms that its hands
    are named as, or of a robot with two arms the other one"""
    first: str = ""
    """waypoint to go to first; empty: the first of that way or, where there are `steps` or it goes backwards, the next one from
    where the last such run left the hand"""
    steps: Annotated[int, Meta(ge=0)] = 0
    """waypoints to go to; 0: all that are left"""
    backwards: bool = False
    """each leg as it was gone forwards; the hand gets the shapes that it had before"""
    loop: Annotated[int, Meta(ge=1, le=1000)] = 1
    """times: after the last waypoint the first one follows; forwards only"""


@travels(priority=1, remote=True)
class RunTemplate(Message):
    """Expand a trajectory as ExpandTemplate does, and run the program. Answered by its RunState."""

    instance: Name
    trajectory: Name
    arm: str = ""
    other: str = ""
    first: str = ""
    steps: Annotated[int, Meta(ge=0)] = 0
    backwards: bool = False
    loop: Annotated[int, Meta(ge=1, le=1000)] = 1
    on_failure: OnFailure = "end"


class TemplateProgram(Message):
    """Answer to ExpandTemplate: a program's file, which may be saved as one's own and changed."""

    name: str
    text: str
    bindings: dict[str, str]
    """with which it would run"""
