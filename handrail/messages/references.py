"""Where a whole-body task's reference goes: it stays, follows a trajectory, or is streamed."""

from __future__ import annotations

import msgspec

from handrail.messages.base import Name, Pose, Positive, Vector


class FixedPose(msgspec.Struct, tag="fixed", kw_only=True, forbid_unknown_fields=True):
    """A task's frame is brought to `pose` and stays there: gone to at `speed` and `turn` at most, not jumped to."""

    task: Name
    pose: Pose | None = None
    """in the frame that the task is relative to; none: where it is at the start, and `shift`"""
    shift: Vector = (0.0, 0.0, 0.0)
    """m, on the axes of the frame that the task is relative to; only without `pose`"""
    speed: Positive = 0.25
    """m/s"""
    turn: Positive = 1.0
    """rad/s"""


class FrameLine(msgspec.Struct, tag="line", kw_only=True, forbid_unknown_fields=True):
    """A task's frame goes in a straight line to `goal`, minimum-jerk in `duration` s, from where it is at the start."""

    task: Name
    duration: Positive
    goal: Pose | None = None
    """in the frame that the task is relative to; none: where it is at the start, and `shift`"""
    shift: Vector = (0.0, 0.0, 0.0)
    """m, on the axes of the frame that the task is relative to; only without `goal`"""


class FrameKnots(msgspec.Struct, tag="frame_knots", kw_only=True, forbid_unknown_fields=True):
    """A task's frame goes through knots, by cubic Hermite interpolation of where it is; its orientation stays.

    Where it is not at the first knot at the start, what is between is taken up minimum-jerk on the way: it ends at the last knot.
    """

    task: Name
    times: list[float]
    """s from the action's start, strictly increasing, first 0"""
    positions: list[Vector]
    """m, in the frame that the task is relative to, one a knot"""
    velocities: list[Vector]
    """m/s"""


class PostureKnots(msgspec.Struct, tag="knots", kw_only=True, forbid_unknown_fields=True):
    """A JPos goes through knots, by cubic Hermite interpolation; joints that are not named stay where they are commanded."""

    task: Name
    joints: list[Name]
    times: list[float]
    """s from the action's start, strictly increasing, first 0"""
    positions: list[list[float]]
    """rad, knots × joints"""
    velocities: list[list[float]]
    """rad/s, knots × joints"""


class PoseStream(msgspec.Struct, tag="stream", kw_only=True, forbid_unknown_fields=True):
    """A task's frame follows what StreamPose brings, and stands when nothing has come for `stale` s."""

    task: Name
    stale: Positive = 0.1
    """s"""
    speed: Positive = 0.5
    """m/s: a pose that is far off is gone to no faster"""
    turn: Positive = 1.5
    """rad/s"""


Reference = FixedPose | FrameLine | FrameKnots | PostureKnots | PoseStream
