"""What a template's file may say: one struct a part, unknown fields refused."""

from __future__ import annotations

import math
from typing import Annotated, Any

import msgspec

from affordance_templates.template import Approach, JointKind, ShapeKind

Number = float | int | str
"""a number, or an expression"""
Triple = tuple[Number, Number, Number]


class _Struct(msgspec.Struct, forbid_unknown_fields=True):
    pass


class Parameter(_Struct):
    """What an operator may change about an instance."""

    default: float
    unit: str = ""
    """as the file's expressions take it: m, rad, deg, N …"""
    min: float = -math.inf
    max: float = math.inf
    integer: bool = False
    title: str = ""


class ShapeFile(_Struct):
    """A solid, or with `repeat` (index → count) several of them."""

    kind: ShapeKind
    size: list[Number]
    position: Triple = (0, 0, 0)
    rpy: Triple = (0, 0, 0)
    color: tuple[float, float, float, float] = (0.55, 0.6, 0.65, 1.0)
    repeat: dict[str, Number] = {}


class ObjectFile(_Struct):
    """Solids that move together, with `joint` if one is named."""

    shapes: list[ShapeFile]
    joint: str = ""
    title: str = ""


class JointFile(_Struct):
    """A degree of freedom."""

    kind: JointKind
    axis: Triple
    origin: Triple = (0, 0, 0)
    lower: Number | None = None
    upper: Number | None = None


class Avoid(_Struct):
    """Angles about the entry joint where obstacles stand, at joint position 0."""

    angle: Number
    repeat: dict[str, Number] = {}


class EntryFile(_Struct):
    """See template.Entry."""

    joint: str
    span: Number
    avoid: Avoid | None = None
    clearance: Number = 0.0
    contact_offset: Number = 0.0


class PathForceFile(_Struct):
    """See template.ResolvedWaypoint.path_force."""

    gain: Number
    limit: Number


class WaypointFile(_Struct):
    """See template.ResolvedWaypoint."""

    name: Annotated[str, msgspec.Meta(min_length=1)]
    approach: Approach
    position: Triple
    axis: Triple
    joint: str = ""
    to: Number = 0.0
    guard: Number | None = None
    path_force: PathForceFile | None = None
    duration: Number = 0.0


class TrajectoryFile(_Struct):
    """Waypoints in order."""

    waypoints: Annotated[list[WaypointFile], msgspec.Meta(min_length=1)]
    entry: EntryFile | None = None
    title: str = ""


class TemplateFile(_Struct):
    """A whole file; its parts are converted one by one, so that errors know their lines."""

    title: str
    parameters: dict[str, Any] = {}
    definitions: dict[str, Number] = {}
    objects: dict[str, Any] = {}
    joints: dict[str, Any] = {}
    trajectories: dict[str, Any] = {}
