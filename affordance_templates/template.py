"""What a template is once its parameters have numbers: shapes, joints and trajectories in the template's own frame.

Everything here is plain data: planners, the tablet and programs read it. SI units, radians. `template_file` makes it from YAML.

Angles about a joint are right-handed about its axis and count from where the waypoints' positions are written: a waypoint at
position (x, 0.10, 0) with a hinge along +x through the origin stands at angle 0, and at (x, 0.10 cos φ, 0.10 sin φ) at angle φ.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ShapeKind = Literal["capsule", "cylinder", "box", "sphere", "torus"]
JointKind = Literal["revolute", "continuous", "prismatic"]
Approach = Literal["free", "straight", "along"]


@dataclass(frozen=True)
class Shape:
    """A solid that is drawn, and kept clear of when planning."""

    kind: ShapeKind
    size: tuple[float, ...]
    """m. capsule and cylinder: (radius, length) along the shape's z, a capsule's length without its caps; box: full edges
    (x, y, z); sphere: (radius,); torus: (major, minor) radius around the shape's z axis"""
    pose_in_template: Array
    """(4, 4) homogeneous transform of the shape's frame (its centre), the template's joints at their present positions"""
    object: str
    """the template's object that it belongs to, e.g. rim"""
    color: tuple[float, float, float, float] = (0.55, 0.6, 0.65, 1.0)
    """red, green, blue, opacity, each 0..1"""


@dataclass(frozen=True)
class ResolvedJoint:
    """One degree of freedom of the template's object, in the template's frame."""

    name: str
    kind: JointKind
    axis: Array
    """(3,) unit vector"""
    origin: Array
    """(3,) m, a point on the axis"""
    position: float
    """rad (prismatic: m), as believed now"""
    lower: float
    upper: float
    """rad (prismatic: m); a continuous joint has -inf and inf"""


@dataclass(frozen=True)
class Entry:
    """Where along a joint's motion a trajectory may begin: clear of what stands in the way, on an arc that the planner places."""

    joint: str
    span: float
    """rad, the arc's whole width about the joint; its centre is the planner's to choose"""
    avoid: tuple[float, ...]
    """rad about the joint: where obstacles (spokes) stand while the joint is at position 0; they move with it"""
    clearance: float
    """rad, wanted between tool and obstacle beyond their touching"""
    contact_offset: float
    """rad δ: tool and obstacle touch when their angles differ by this, asin((tool radius + obstacle radius) / engage radius)"""


@dataclass(frozen=True)
class ResolvedWaypoint:
    """A goal for the tool's tip, and how to get there."""

    name: str
    position: Array
    """(3,) m, tool tip in the template's frame at entry angle 0"""
    axis: Array
    """(3,) unit vector, the tool's pointing direction in the template's frame"""
    approach: Approach
    """free: any collision-free way; straight: the tip moves on a line; along: the tip turns about `joint` from where it is"""
    joint: str = ""
    """along: the joint"""
    to: Literal["arc_end"] | float = 0.0
    """along: to the end of the entry's arc, or by so many rad (m) from where the tip is"""
    guard: float | None = None
    """m: ends the motion when the tip lags its command by more along the waypoint's axis"""
    path_force: tuple[float, float] | None = None
    """(gain N/(m·s), limit N) of handrail.messages.PathForce, or none"""
    duration: float = 0.0
    """s, at least"""


@dataclass(frozen=True)
class ResolvedTrajectory:
    """Waypoints in order, all done in one visit."""

    name: str
    entry: Entry | None
    waypoints: tuple[ResolvedWaypoint, ...]


@dataclass(frozen=True)
class ResolvedTemplate:
    """A template with numbers for its parameters and joints."""

    shapes: tuple[Shape, ...] = ()
    joints: Mapping[str, ResolvedJoint] = field(default_factory=dict)
    trajectories: Mapping[str, ResolvedTrajectory] = field(default_factory=dict)
