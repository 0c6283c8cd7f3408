"""What a template is once its parameters have numbers: shapes, joints, features and trajectories in the template's own frame.

Everything here is plain data: planners, the tablet and programs read it. SI units, radians. `template_file` makes it from YAML.

A hand's frame, as templates mean it: it points along its −z, its fingers close along its y. `affordance_templates.binding` says
where that is on a robot.

Angles about a joint are right-handed about its axis and count from where the waypoints' positions are written: a waypoint at
position (x, 0.10, 0) with a hinge along +x through the origin stands at angle 0, and at (x, 0.10 cos φ, 0.10 sin φ) at angle φ.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from affordance_templates.placement import Array, moved_along, placed, shortest_turn

ShapeKind = Literal["capsule", "cylinder", "box", "sphere", "torus", "mesh"]
JointKind = Literal["revolute", "continuous", "prismatic"]
FeatureKind = Literal["frame", "axis", "point"]
Approach = Literal["free", "straight", "guarded", "along"]


@dataclass(frozen=True)
class Shape:
    """A solid that is drawn, and kept clear of when planning."""

    kind: ShapeKind
    size: tuple[float, ...]
    """m. capsule and cylinder: (radius, length) along the shape's z, a capsule's length without its caps; box: full edges
    (x, y, z); sphere: (radius,); torus: (major, minor) radius around the shape's z axis; mesh: factors along x, y, z"""
    pose_in_template: Array
    """(4, 4) homogeneous transform of the shape's frame (its centre), the template's joints at their present positions"""
    object: str
    """the template's object that it belongs to, e.g. rim or button[2]"""
    color: tuple[float, float, float, float] = (0.55, 0.6, 0.65, 1.0)
    """red, green, blue, opacity, each 0..1"""
    file: Path | None = None
    """of a mesh"""


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
    pitch: float = 0.0
    """m along the axis for each turn about it: a thread"""

    def displacement(self, amount: float) -> Array:
        """(4, 4), in the template's frame: how what hangs on the joint moves when the joint moves by `amount` rad (m)."""
        if self.kind == "prismatic":
            return moved_along(self.axis, self.origin, 0.0, amount)
        return moved_along(self.axis, self.origin, amount, self.pitch * amount / (2 * np.pi))

    @property
    def frame_in_template(self) -> Array:
        """(4, 4): x along the axis, turned and moved as far as the joint is."""
        straight = placed(self.origin, shortest_turn((1.0, 0.0, 0.0), self.axis))
        return self.displacement(self.position) @ straight


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
class Tolerance:
    """How far from its pose a waypoint may be reached, along and about the pose's own axes."""

    position: Array
    """(3,) m, to either side"""
    rotation: Array
    """(3,) rad, to either side; π: turning about this axis is free"""


@dataclass(frozen=True)
class Stance:
    """Where the robot should stand for a waypoint, in the template's frame."""

    position: Array
    """(3,) m, of the robot's base"""
    yaw: float
    """rad, about the template's z"""


@dataclass(frozen=True)
class ResolvedWaypoint:
    """A goal for a hand, and how to get there."""

    name: str
    pose_in_template: Array
    """(4, 4): where the hand's tool point is to be, the joints that waypoints before it moved being where they left them. Of a
    trajectory with an entry: at entry angle 0"""
    approach: Approach
    """free: any collision-free way; straight: on a line; guarded: on a line, until `until` N are felt; along: with `joint`, as
    though the hand held it, from where it is"""
    joint: str = ""
    """along: the joint"""
    to: Literal["arc_end"] | float = 0.0
    """along: to the end of the entry's arc, or by so many rad (m) from where the joint is"""
    guard: float | None = None
    """m: ends the motion when the tip lags its command by more along the waypoint's axis"""
    until: float | None = None
    """guarded: N along the way"""
    path_force: tuple[float, float] | None = None
    """(gain N/(m·s), limit N) of handrail.messages.PathForce, or none"""
    force: Array | None = None
    """(3,) N in the template's frame, what the hand does to the object while it is there"""
    duration: float = 0.0
    """s, at least"""
    speed: float | None = None
    """m/s, at most"""
    hand_pose: str = ""
    """the hand's, by name, when the waypoint is reached; empty: as it was"""
    tool: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) m in the hand's frame: the point that is brought to the pose"""
    tolerance: Tolerance = field(default_factory=lambda: Tolerance(np.zeros(3), np.zeros(3)))
    stance: Stance | None = None
    reference: Array = field(default_factory=lambda: np.eye(4))
    """(4, 4): the frame, in the template's, that the pose was said in: what is mirrored for a hand of the other side is mirrored
    in its x-z plane"""

    @property
    def position(self) -> Array:
        """(3,) m, tool tip in the template's frame (at entry angle 0)."""
        return self.pose_in_template[:3, 3]

    @property
    def axis(self) -> Array:
        """(3,) unit vector, the tool's pointing direction in the template's frame."""
        return -self.pose_in_template[:3, 2]


@dataclass(frozen=True)
class ResolvedTrajectory:
    """Waypoints in order, all done in one visit by one hand."""

    name: str
    entry: Entry | None
    waypoints: tuple[ResolvedWaypoint, ...]
    hand: str = "hand"
    """the abstract hand that goes along it"""
    side: Literal["", "left", "right"] = ""
    """that its poses are written for: a hand of the other side goes along their mirror images. Empty: either hand as they are"""


@dataclass(frozen=True)
class Sync:
    """Trajectories of several hands at once."""

    name: str
    trajectories: tuple[str, ...]
    """one a hand"""
    points: tuple[Mapping[str, int], ...]
    """in order, each trajectory → the number of the waypoint that is reached when the others named are"""


@dataclass(frozen=True)
class Feature:
    """A named frame, axis or point of the template."""

    name: str
    kind: FeatureKind
    object: str
    """that it goes with; empty: the template"""
    arguments: Mapping[str, tuple[float, float, float]]
    """argument of NAME(…) → default, least, largest"""
    indices: tuple[int, ...]
    """of NAME[…]: how many there are of each index"""


def _no_feature(reference: str) -> Array:
    raise ValueError(f"got {reference!r}; expected a feature: there is none")


@dataclass(frozen=True)
class ResolvedTemplate:
    """A template with numbers for its parameters and joints."""

    shapes: tuple[Shape, ...] = ()
    joints: Mapping[str, ResolvedJoint] = field(default_factory=dict)
    trajectories: Mapping[str, ResolvedTrajectory] = field(default_factory=dict)
    objects: Mapping[str, Array] = field(default_factory=dict)
    """name → (4, 4), its frame in the template's"""
    features: Mapping[str, Feature] = field(default_factory=dict)
    syncs: Mapping[str, Sync] = field(default_factory=dict)
    _frame: Callable[[str], Array] = field(default=_no_feature, repr=False, compare=False)

    def frame(self, reference: str) -> Array:
        """(4, 4), in the template's frame: of a feature, `rim(0.5)` or `button[3]`; an object; a joint (x along its axis, turned
        as far as the joint is); or a waypoint, TRAJECTORY.WAYPOINT. Empty: the template's own.

        Raises ValueError naming what there is.
        """
        if not reference:
            return np.eye(4)
        known: dict[str, Callable[[], Array]] = {}
        for name, joint in self.joints.items():
            known[name] = partial(getattr, joint, "frame_in_template")
        for trajectory in self.trajectories.values():
            for waypoint in trajectory.waypoints:
                known[f"{trajectory.name}.{waypoint.name}"] = partial(getattr, waypoint, "pose_in_template")
        if reference in known:
            return known[reference]()
        if (
            reference.partition("[")[0].partition("(")[0] in {*self.features, *self.objects}
            or reference in self.objects
        ):
            return self._frame(reference)
        raise ValueError(f"got {reference!r}; expected one of {', '.join([*self.features, *known, *self.objects])}")
