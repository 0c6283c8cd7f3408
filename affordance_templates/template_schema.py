"""What a template's file may say: one struct a part, unknown fields refused.

Wherever a number may depend on parameters it may be an expression, `2/3 * radius` or `${2/3 * radius}`. Names of joints, objects,
features and trajectories that are repeated take indices: `button[3]`, `button[i]`.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

import msgspec

from affordance_templates.template import Approach, FeatureKind, JointKind, ShapeKind

Number = float | int | str
"""a number, or an expression"""
Triple = tuple[Number, Number, Number]
Colour = tuple[float, float, float, float]
Axis = Literal["x", "y", "z", "roll", "pitch", "yaw"]
ALL_AXES: tuple[Axis, ...] = ("x", "y", "z", "roll", "pitch", "yaw")


class _Struct(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    pass


class Parameter(_Struct):
    """What an operator may change about an instance."""

    default: float
    unit: str = ""
    """as the file's expressions take it: m, rad, deg, N …"""
    min: float = -math.inf
    max: float = math.inf
    step: Annotated[float, msgspec.Meta(gt=0)] | None = None
    """that a click or a key changes it by"""
    integer: bool = False
    choices: list[float] = []
    """the only values that there are; none given: all between min and max"""
    title: str = ""


class MaterialFile(_Struct):
    """What an object's surface looks like."""

    color: Colour
    """red, green, blue, opacity, each 0..1"""


class ShapeFile(_Struct):
    """A solid, or with `repeat` (index → count) several of them, in its object's frame."""

    kind: ShapeKind
    size: list[Number] = []
    """see template.Shape; of a mesh: factors, 1 each where left out"""
    file: str = ""
    """of a mesh, beside the template's file or below: .stl, .obj or .dae"""
    position: Triple = (0, 0, 0)
    rpy: Triple = (0, 0, 0)
    color: Colour | None = None
    material: str = ""
    repeat: dict[str, Number] = {}


class ObjectFile(_Struct):
    """Solids that move together: with the object that is their `parent`, or on a `joint`, or with the template."""

    shapes: list[ShapeFile] = []
    parent: str = ""
    joint: str = ""
    position: Triple = (0, 0, 0)
    rpy: Triple = (0, 0, 0)
    material: str = ""
    editable: dict[Axis, str] = {}
    """axis of the object's frame → the parameter that is changed by dragging the object along (about) it"""
    repeat: dict[str, Number] = {}
    title: str = ""


class JointFile(_Struct):
    """A degree of freedom. Axis and origin are said in the frame of its `parent`, an object; without one in the template's."""

    kind: JointKind
    axis: Triple
    origin: Triple = (0, 0, 0)
    parent: str = ""
    lower: Number | None = None
    upper: Number | None = None
    pitch: Number = 0.0
    """m along the axis for each turn about it: a thread"""
    repeat: dict[str, Number] = {}
    title: str = ""


class ArgumentFile(_Struct):
    """What may be put in a feature's parentheses."""

    default: Number = 0.0
    min: Number = -1e9
    max: Number = 1e9
    title: str = ""


class FeatureFile(_Struct):
    """A named frame, axis or point `on` an object. `repeat` gives NAME[0], NAME[1] …; `arguments`, in order, NAME(0.3)."""

    kind: FeatureKind = "frame"
    on: str = ""
    position: Triple = (0, 0, 0)
    rpy: Triple | None = None
    pointing: Triple | None = None
    """of a frame, in place of rpy: where a hand that is to be there points (−z)"""
    across: Triple | None = None
    """beside `pointing`: along which its fingers close (y)"""
    axis: Triple | None = None
    """of an axis: its direction, the frame's x"""
    arguments: dict[str, ArgumentFile] = {}
    repeat: dict[str, Number] = {}
    title: str = ""


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


class ForceFile(_Struct):
    """What the hand does to the object: N along a direction in the waypoint's frame."""

    direction: Triple
    size: Number


class ToleranceFile(_Struct):
    """To either side along and about the waypoint's own axes: one number for all three, or three. π: free."""

    position: Number | Triple = 0.01
    """m"""
    rotation: Number | Triple = "2 * deg"
    """rad"""


class StanceFile(_Struct):
    """Where the robot should stand, in the template's frame."""

    position: Triple
    yaw: Number = 0.0


class WaypointFile(_Struct):
    """See template.ResolvedWaypoint.

    Where the hand is to be: `position` and either `rpy`, or `axis` (where it points) and, unless it may turn about that, `across`
    (along which its fingers close); without any of these as `frame` lies.
    """

    name: Annotated[str, msgspec.Meta(min_length=1)]
    approach: Approach
    frame: str = ""
    """an object or a feature; empty: the template"""
    position: Triple | None = None
    axis: Triple | None = None
    across: Triple | None = None
    rpy: Triple | None = None
    tool: Triple = (0, 0, 0)
    tolerance: ToleranceFile | None = None
    joint: str = ""
    to: Number = 0.0
    guard: Number | None = None
    until: Number | None = None
    path_force: PathForceFile | None = None
    force: ForceFile | None = None
    duration: Number = 0.0
    speed: Number | None = None
    hand_pose: str = ""
    stance: StanceFile | None = None
    title: str = ""


class TrajectoryFile(_Struct):
    """Waypoints in order, for one abstract hand."""

    waypoints: Annotated[list[WaypointFile], msgspec.Meta(min_length=1)]
    hand: Annotated[str, msgspec.Meta(min_length=1)] = "hand"
    side: Literal["", "left", "right"] = ""
    entry: EntryFile | None = None
    stance: StanceFile | None = None
    """of every waypoint that has none of its own"""
    repeat: dict[str, Number] = {}
    title: str = ""


class SyncFile(_Struct):
    """Trajectories of several hands that go on together: TRAJECTORY.WAYPOINT of a point are reached at one time."""

    trajectories: Annotated[list[str], msgspec.Meta(min_length=2)]
    points: list[Annotated[list[str], msgspec.Meta(min_length=2)]] = []
    title: str = ""


class TemplateFile(_Struct):
    """A whole file; its parts are converted one by one, so that errors know their lines."""

    title: str
    description: str = ""
    editable: list[Axis] = msgspec.field(default_factory=lambda: list(ALL_AXES))
    """along and about which an operator may move an instance"""
    parameters: dict[str, Any] = {}
    definitions: dict[str, Number] = {}
    materials: dict[str, Any] = {}
    objects: dict[str, Any] = {}
    joints: dict[str, Any] = {}
    features: dict[str, Any] = {}
    trajectories: dict[str, Any] = {}
    sync: dict[str, Any] = {}


PARTS: dict[str, type[_Struct]] = {
    "parameters": Parameter,
    "materials": MaterialFile,
    "objects": ObjectFile,
    "joints": JointFile,
    "features": FeatureFile,
    "trajectories": TrajectoryFile,
    "sync": SyncFile,
}
"""field of a file → what its values are"""


def json_schema() -> dict[str, Any]:
    """The JSON Schema of a template's file (draft 2020-12)."""
    kinds = [TemplateFile, *PARTS.values()]
    _, parts = msgspec.json.schema_components(kinds, ref_template="#/$defs/{name}")
    for field, kind in PARTS.items():
        parts["TemplateFile"]["properties"][field] = {
            "type": "object",
            "additionalProperties": {"$ref": f"#/$defs/{kind.__name__}"},
            "default": {},
        }
    for name in ("min", "max"):  # JSON has no infinity
        parts["Parameter"]["properties"][name].pop("default")
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "An affordance template",
        "$ref": "#/$defs/TemplateFile",
        "$defs": parts,
    }
