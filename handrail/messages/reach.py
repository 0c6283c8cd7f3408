"""Which waypoints of a template's trajectory an arm can reach, told while somebody wants to know."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from handrail.messages.base import Message, Name, NonNegative, travels


@travels(priority=2, remote=True)
class GetReach(Message):
    """Which waypoints of an instance's trajectory can an arm reach? Answered by Reach.

    With `lasts` Reach is told as an event, too, whenever an instance or what the arm is carried by moves; ask again to go on.
    """

    instance: Name
    trajectory: Name
    arm: str = ""
    """empty: the robot's only one"""
    clearance: NonNegative = 0.015
    """m, from every instance and of the robot from itself, as ways of `do: trajectory` keep it; on ways that are not free the arm's
    tool may touch the instance itself"""
    rate: Annotated[float, Meta(gt=0, le=30)] = 10.0
    """Hz at most, of events"""
    lasts: Annotated[float, Meta(ge=0, le=60)] = 0.0
    """s of wall time"""


class WaypointReach(msgspec.Struct, kw_only=True):
    """Whether there is a posture for a waypoint."""

    name: str
    state: Literal["reached", "near", "not"]
    """reached: with room to every limit; near: only near one of them; not: in none that was found"""
    constraint: str = ""
    """near: the limit that is nearest, not: what is missed most: `joint limits`, `clearance`, `position`, `direction`, `balance`"""
    about: str = ""
    """the joint, or the two bodies"""
    by: float = 0.0
    """near: what is left until the limit, not: by how much it is missed"""
    unit: Literal["", "m", "rad"] = ""
    turned: float = 0.0
    """rad, about the entry's joint, of a stroke: from where the template has the waypoint to where it is reached"""

    def __str__(self) -> str:
        about = f" ({self.about})" if self.about else ""
        size = f"{1000 * self.by:.0f} mm" if self.unit == "m" else f"{57.29578 * self.by:.1f}°"
        match self.state:
            case "reached":
                return "reached"
            case "near":
                return f"near: {self.constraint}{about}, {size} left"
            case _:
                return f"not reached: {self.constraint}{about} missed by {size}"


@travels(priority=4, reliable=False, superseded_by=("instance", "trajectory", "arm"), remote=True)
class Reach(Message):
    """Which waypoints an arm can reach: of the instance at this version, each by itself, from whichever posture."""

    instance: str
    version: int
    trajectory: str
    arm: str
    waypoints: list[WaypointReach]
    """in the trajectory's order; empty: see `problem`"""
    settled: bool
    """False: from what was found before, as while something is dragged; what is near or not reached may be better from elsewhere"""
    problem: str = ""
    """why nothing can be told: the instance is gone, nobody knows where the robot is, ..."""
