"""When an action ends, beside by its motion."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from handrail.messages.base import Name, NonNegative, Positive


class TimeEnd(msgspec.Struct, tag="time", kw_only=True, forbid_unknown_fields=True):
    """Ends `after` s of the action's own running time: pauses do not count, and at half the speed half of it does."""

    after: Positive


class PoseErrorEnd(msgspec.Struct, tag="pose_error", kw_only=True, forbid_unknown_fields=True):
    """Ends when `frame` is further than `position` m (along `axis` in the world frame, if given) from where it is commanded."""

    frame: Name
    position: Positive
    axis: tuple[float, float, float] | None = None


class ForceEnd(msgspec.Struct, tag="force", kw_only=True, forbid_unknown_fields=True):
    """Ends when the external force on `frame` along `axis` (world), felt or estimated, exceeds `limit` N in size."""

    frame: Name
    axis: tuple[float, float, float]
    limit: Positive


class ContactEnd(msgspec.Struct, tag="contact", kw_only=True, forbid_unknown_fields=True):
    """Ends when the size of the external force on `frame`, felt or estimated, exceeds `threshold` N."""

    frame: Name
    threshold: Positive


class JointLimitEnd(msgspec.Struct, tag="joint_limit", kw_only=True, forbid_unknown_fields=True):
    """Ends when a claimed joint is measured within `margin` rad of a position limit."""

    margin: NonNegative


class DivergenceEnd(msgspec.Struct, tag="divergence", kw_only=True, forbid_unknown_fields=True):
    """Ends when a claimed joint is further than `error` rad from its command."""

    error: Positive


class TorqueLimitEnd(msgspec.Struct, tag="torque_limit", kw_only=True, forbid_unknown_fields=True):
    """Ends when a claimed joint's spring bears more than `share` of the joint's torque limit."""

    share: Annotated[float, Meta(gt=0, le=1)]


class StallEnd(msgspec.Struct, tag="stall", kw_only=True, forbid_unknown_fields=True):
    """Ends when `frame` is measured to have moved less than `distance` m in `within` s of the action's own running time."""

    frame: Name
    distance: Positive
    within: Positive


class TravelEnd(msgspec.Struct, tag="travel", kw_only=True, forbid_unknown_fields=True):
    """Ends when `frame` is measured `distance` m from where it was at the action's start, along `axis` (world) if given."""

    frame: Name
    distance: Positive
    axis: tuple[float, float, float] | None = None


class GripperHoldsEnd(msgspec.Struct, tag="gripper_holds", kw_only=True, forbid_unknown_fields=True):
    """Ends when a gripper stands still at its effort limit, short of where it was sent: something is in it."""

    gripper: Name


class GripperAtEnd(msgspec.Struct, tag="gripper_at", kw_only=True, forbid_unknown_fields=True):
    """Ends when a gripper is measured within `tolerance` of `position`: open, closed on nothing, or as wide as it shall be."""

    gripper: Name
    position: float
    """rad or m, of the driven joint"""
    tolerance: Positive
    """likewise"""


EndCondition = (
    TimeEnd
    | PoseErrorEnd
    | ForceEnd
    | ContactEnd
    | JointLimitEnd
    | DivergenceEnd
    | TorqueLimitEnd
    | StallEnd
    | TravelEnd
    | GripperHoldsEnd
    | GripperAtEnd
)
