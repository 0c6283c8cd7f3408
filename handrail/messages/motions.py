"""What an action moves: trajectories, compliance, whole-body tasks, streams."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from handrail.messages.base import Name, NonNegative, Pose, Positive
from handrail.messages.references import Reference


class PathForce(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """Integrates a force along the commanded path's tangent from the tool's lag behind it, and applies it by Jᵀ.

    F ← clip(F + gain · t̂·(x_d − x) · dt, 0, limit), with x, x_d the measured and commanded position of `frame` and t̂ the
    commanded path's unit tangent (the last one where the path stands still).
    """

    frame: Name
    gain: NonNegative = 1500.0
    """N/(m·s)"""
    limit: NonNegative = 60.0
    """N"""


class JointTrajectory(msgspec.Struct, tag="joint_trajectory", kw_only=True, forbid_unknown_fields=True):
    """Follow knots by cubic Hermite interpolation under joint impedance in the drives, gravity and feed-forward from the host."""

    joints: list[Name]
    times: list[float]
    """s from the action's start, strictly increasing, first 0"""
    positions: list[list[float]]
    """rad, knots × joints"""
    velocities: list[list[float]]
    """rad/s, knots × joints"""
    path_force: PathForce | None = None


class CartesianImpedance(msgspec.Struct, tag="cartesian_impedance", kw_only=True, forbid_unknown_fields=True):
    """Move `frame` in a straight line to `goal_in_world` in `duration` s under Cartesian impedance on `joints`."""

    frame: Name
    joints: list[Name]
    goal_in_world: Pose
    duration: Positive
    stiffness: tuple[float, float] = (600.0, 6.0)
    """N/m, N·m/rad"""


TaskAxis = Literal["x", "y", "z", "rx", "ry", "rz"]
"""along, or about, an axis of a task frame"""


class Compliance(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """Lets one axis of a task frame give way: e, how far it is off the path there, follows the wrench w that the frame feels.

    damping · ė = force + w − stiffness · e, with |ė| ≤ speed and |e| ≤ reach. So without stiffness the frame goes on, no faster
    than `speed`, until it exerts `force`; without `force` it is a spring and a damper, or a damper alone.
    """

    axis: TaskAxis
    force: float = 0.0
    """N or N·m that the frame exerts on what it touches"""
    stiffness: NonNegative = 0.0
    """N/m or N·m/rad, less than the motion's own; 0: no spring"""
    damping: NonNegative = 0.0
    """N·s/m or N·m·s/rad; 0: 100 or 2"""
    speed: NonNegative = 0.0
    """m/s or rad/s at most; 0: 0.03 or 0.2"""
    reach: NonNegative = 0.0
    """m or rad at most; 0: 0.1 or 0.5"""


class Dither(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """Swings about the path along one axis of a task frame."""

    axis: TaskAxis
    amplitude: Positive
    """m or rad, commanded"""
    frequency: Positive
    """Hz"""


class CompliantMotion(msgspec.Struct, tag="compliant_motion", kw_only=True, forbid_unknown_fields=True):
    """Move `frame` along a straight path, and let it give way, press or swing on chosen axes of a task frame.

    The path leads from where the frame is commanded to `goal_in_world`, or by `shift`, or nowhere. Done after `duration`.
    """

    frame: Name
    joints: list[Name]
    duration: Positive
    """s"""
    goal_in_world: Pose | None = None
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """m along the task frame's axes, as they are at the start; only without `goal_in_world`"""
    axes: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    """unit quaternion (x, y, z, w): the task frame's axes in the world, or in the frame. Its origin is the frame's"""
    axes_in: Literal["world", "frame"] = "world"
    compliance: list[Compliance] = []
    dither: list[Dither] = []
    stiffness: tuple[float, float] = (600.0, 20.0)
    """N/m, N·m/rad, about the path, displaced by compliance and dither"""


FIRST_KNOT = "motion.positions[0]"
"""how the refused field of a StartAction begins whose trajectory starts elsewhere than the robot is commanded to be: plan again"""


NOT_READY = "not ready"
"""the refused value of a StartAction whose controller is still being made: call again"""


NOT_STANDING = "no hold"
"""likewise of one that stands on feet one of which does not hold: call again once it does"""


class WholeBody(msgspec.Struct, tag="whole_body", kw_only=True, forbid_unknown_fields=True):
    """Run a compound task on `joints`: torques of whole-body control, and an impedance about where they lead.

    Other actions may move the other joints meanwhile; else they are held. What these do is reckoned with, and left to them.

    References that neither compound nor `references` give are where the robot is commanded to be at the start. Ends by itself
    after `duration` s, or with its longest trajectory, and otherwise by an end condition or a cancellation.
    """

    compound: Annotated[str, Meta(min_length=1)]
    """name of a compound task (docs/wbc.md), or its YAML text"""
    joints: list[Name] = []
    """that it moves; none: all of the robot's"""
    frame: str = ""
    """of the tasks and constraints that are about a frame and name none"""
    references: list[Reference] = []
    """at most one a task"""
    duration: NonNegative = 0.0
    """s; 0: as long as the longest trajectory among the references, without one for ever"""
    stiffness: Annotated[float, Meta(ge=0, le=1)] = 0.5
    """of the drives about the desired positions, as a share of the robot's own: what the model does not know (a push, a wrong
    mass) moves light joints far where both are low"""
    damping: Annotated[float, Meta(ge=0, le=1)] = 1.0


class JointTarget(msgspec.Struct, tag="joint_target", kw_only=True, forbid_unknown_fields=True):
    """Go to `positions`, as fast as the limits of acceleration and jerk and `speed` allow, and end there (`done`).

    From a stand in a straight line, all joints arriving together. StreamJoints replaces the target on the way (its velocities
    count for nothing); nobody looks ahead for what stands in the way but the daemon's guard.
    """

    joints: list[Name]
    positions: list[float]
    """rad"""
    speed: Annotated[float, Meta(gt=0, le=1)] = 0.3
    """share of the velocity limits"""


JointsMotion = JointTrajectory | CartesianImpedance | CompliantMotion | JointTarget
"""those that say which joints they move"""


class JointStream(msgspec.Struct, tag="joint_stream", kw_only=True, forbid_unknown_fields=True):
    """Follow what StreamJoints brings, from where the joints are commanded to be; ends with `stream_lost`, or as every motion may.

    Between two samples it goes on at the velocity that was sent, for at most `bridge` s; then it comes to a stand within 0.1 s and
    is held, which an ActionEvent tells (`paused`, with the reason), until the next sample comes or `expiry` is over.
    """

    joints: list[Name]
    bridge: Positive = 0.05
    """s without a sample that are bridged"""
    expiry: Positive = 1.0
    """s without a sample after which it ends"""
    speed: Positive = 0.5
    """rad/s: a sample that is elsewhere than the joints are commanded to be is gone to no faster"""


StepMotion = JointsMotion | WholeBody
"""those that may be a step of a behaviour"""

Motion = StepMotion | JointStream
