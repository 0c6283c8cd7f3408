"""What a robot's file says of how near its bodies may come to each other, and where they may not go (daemon.safety.guard)."""

from __future__ import annotations

from typing import Annotated

import msgspec

ROUNDING = 0.004
"""m by which the guard may take a body for larger than its hull is"""
Metres = Annotated[float, msgspec.Meta(ge=-20, le=20)]
Margin = Annotated[float, msgspec.Meta(ge=0, le=1)]


class HalfSpace(
    msgspec.Struct, kw_only=True, forbid_unknown_fields=True, frozen=True, tag_field="kind", tag="half_space"
):
    """A plane that `links` stay on one side of: a table, a wall. Its frame is a link that no joint moves."""

    name: str
    frame: str
    point: tuple[Metres, Metres, Metres]
    """m, on the plane, in the frame"""
    normal: tuple[float, float, float]
    """to the side that is free, in the frame; any length"""
    margin: Margin = 0.01
    """m"""
    links: tuple[str, ...] = ("*",)
    """glob patterns; links that no joint moves against the frame never count"""


class KeepOut(msgspec.Struct, kw_only=True, forbid_unknown_fields=True, frozen=True, tag_field="kind", tag="keep_out"):
    """A box that `links` stay out of: where the operator stands. It moves with the link that is its frame."""

    name: str
    frame: str
    position: tuple[Metres, Metres, Metres]
    """m, of its middle, in the frame"""
    size: tuple[
        Annotated[float, msgspec.Meta(gt=0, le=20)],
        Annotated[float, msgspec.Meta(gt=0, le=20)],
        Annotated[float, msgspec.Meta(gt=0, le=20)],
    ]
    """m, along its axes"""
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """rad, in the frame"""
    margin: Margin = 0.01
    """m"""
    links: tuple[str, ...] = ("*",)
    """as above"""


Region = HalfSpace | KeepOut


class Guarding(msgspec.Struct, kw_only=True, forbid_unknown_fields=True, frozen=True):
    """`guard` of robot.yaml."""

    self_collision: bool = True
    """watch that the robot does not run into itself; `allowed_collision_pairs` and links two joints apart aside"""
    margin: Margin = 0.01
    """m, between two of its bodies"""
    regions: tuple[Region, ...] = ()

    @property
    def planned(self) -> float:
        """m that a plan keeps between two of its bodies, so that the guard lets the robot stand wherever the plan leads it."""
        return self.margin + 2.0 * ROUNDING + _FOLLOWED


_FOLLOWED = 0.001
"""m that commands between a plan's rows may be nearer"""
