"""What a motion is to reach or keep."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from handrail.messages.base import Name, NonNegative, Pose, Positive

Room = NonNegative | None
"""m; none: no bound"""


class JointsGoal(msgspec.Struct, tag="joints", kw_only=True, forbid_unknown_fields=True):
    """Joints are at positions."""

    positions: dict[Name, float]
    """joint → rad"""
    tolerance: NonNegative = 0.0
    """rad"""


class PostureGoal(msgspec.Struct, tag="posture", kw_only=True, forbid_unknown_fields=True):
    """All joints that may move are where one of the robot's postures has them."""

    name: Name


class RelationGoal(msgspec.Struct, tag="relation", kw_only=True, forbid_unknown_fields=True):
    """lower ≤ Σ coefficient · position ≤ upper: left as right is {left: 1, right: -1}, 0 to 0."""

    coefficients: dict[Name, float]
    lower: float = 0.0
    upper: float = 0.0


class FrameGoal(msgspec.Struct, tag="frame", kw_only=True, forbid_unknown_fields=True):
    """A frame of the robot is at a pose, within tolerances."""

    frame: str = ""
    """empty: the arm's tool tip"""
    pose: Pose
    in_frame: str = ""
    instance: str = ""
    feature: str = ""
    below: tuple[Room, Room, Room] = (0.0, 0.0, 0.0)
    """along the pose's x, y, z, that the frame may be below it"""
    above: tuple[Room, Room, Room] = (0.0, 0.0, 0.0)
    angle: NonNegative = 0.0
    """rad, that it may be turned by; π: any orientation"""
    about: Literal["", "x", "y", "z"] = ""
    """turning about this axis of the frame is free; `angle` is the cone that the axis stays in"""


class GazeGoal(msgspec.Struct, tag="gaze", kw_only=True, forbid_unknown_fields=True):
    """A point is within the cone about an axis of a frame: a camera sees it."""

    frame: Name
    """or a camera's name: along what it looks along then"""
    target: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """m"""
    in_frame: str = ""
    instance: str = ""
    feature: str = ""
    axis: tuple[float, float, float] = (1.0, 0.0, 0.0)
    """in `frame`"""
    cone: Positive
    """rad, half-angle"""


class CentreOfMassGoal(msgspec.Struct, tag="centre_of_mass", kw_only=True, forbid_unknown_fields=True):
    """The robot's centre of mass, what is held of it included, is at a place."""

    position: tuple[float, float, float]
    """m, world"""
    across: Room = 0.0
    """m, that it may be off to the front, back and either side, as the robot's base (or the sole it stands on) is turned"""
    height: Room = 0.0
    """m, that it may be above or below"""


Goal = JointsGoal | PostureGoal | RelationGoal | FrameGoal | GazeGoal | CentreOfMassGoal


class KeyFrame(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """What must hold at one time on the way."""

    goals: Annotated[list[Goal], Meta(min_length=1, max_length=32)]


class Along(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """A frame goes with a joint of an instance from where it is, as though it held it: a valve is turned, a door opened."""

    instance: Name
    joint: Name
    by: float
    """rad about the joint's axis, m along it"""
    frame: str = ""
    """empty: the arm's tool tip"""
    about: Literal["", "x", "y", "z"] = ""
    """turning about this axis of the frame is free"""
    touch: bool = True
    """the arm's tool may touch the instance"""
