"""Messages as Foxglove shows them: its own well-known types, and JSON schemas for ours.

Foxglove reads JSON messages by their JSON Schema, of which it understands a part: objects, arrays of one type, strings, numbers,
booleans; no references, no alternatives. `schema` writes any struct of ours in that part, so that plots and tables work on every
recorded message. Names and fields of the well-known types: https://docs.foxglove.dev/docs/sdk/schemas.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np
from msgspec import inspect

from handrail.cloud import Points
from handrail.messages import Pose

_NS = 1_000_000_000


class Time(msgspec.Struct):
    sec: int
    nsec: int


class Vector3(msgspec.Struct):
    x: float
    y: float
    z: float


class Quaternion(msgspec.Struct):
    x: float
    y: float
    z: float
    w: float


class FrameTransform(msgspec.Struct):
    timestamp: Time
    parent_frame_id: str
    child_frame_id: str
    translation: Vector3
    rotation: Quaternion


class FrameTransforms(msgspec.Struct):
    transforms: list[FrameTransform]


class PoseValue(msgspec.Struct):
    position: Vector3
    orientation: Quaternion


class PoseInFrame(msgspec.Struct):
    timestamp: Time
    frame_id: str
    pose: PoseValue


class JointState(msgspec.Struct, omit_defaults=True):
    name: str
    position: float
    """rad"""
    velocity: float | None = None
    """rad/s"""
    effort: float | None = None
    """N·m"""


class JointStates(msgspec.Struct):
    timestamp: Time
    joints: list[JointState]


class PackedElementField(msgspec.Struct):
    name: str
    offset: int
    """bytes"""
    type: int
    """NumericType: 1 uint8, 7 float32"""


class PointCloud(msgspec.Struct):
    timestamp: Time
    frame_id: str
    pose: PoseValue
    point_stride: int
    fields: list[PackedElementField]
    data: bytes
    """base64 in JSON"""


class Log(msgspec.Struct):
    timestamp: Time
    level: int
    message: str
    name: str
    file: str = ""
    line: int = 0


LOG_LEVEL = {"info": 2, "warning": 3, "error": 4}

_UINT8, _FLOAT32 = 1, 7
_POINT = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1"), ("alpha", "u1")]
)

WELL_KNOWN = (FrameTransforms, PoseInFrame, JointStates, PointCloud, Log)


def time(time_ns: int) -> Time:
    """A Foxglove timestamp from integer nanoseconds."""
    return Time(*divmod(time_ns, _NS))


def pose_value(pose: Pose) -> PoseValue:
    return PoseValue(Vector3(*pose.position), Quaternion(*pose.orientation))


def transform(time_ns: int, parent: str, child: str, pose: Pose) -> FrameTransform:
    """`pose` is the child's in the parent's frame."""
    return FrameTransform(time(time_ns), parent, child, Vector3(*pose.position), Quaternion(*pose.orientation))


def joint_states(
    time_ns: int,
    names: Sequence[str],
    position: Sequence[float],
    velocity: Sequence[float | None] | None = None,
    effort: Sequence[float | None] | None = None,
) -> JointStates:
    """One row a joint: rad, rad/s, N·m."""
    nothing = [None] * len(names)
    rows = zip(names, position, velocity or nothing, effort or nothing, strict=True)
    return JointStates(time(time_ns), [JointState(*row) for row in rows])


def point_cloud(time_ns: int, frame: str, points: Points) -> PointCloud:
    """A cloud in `frame`, every point with its colour (white where it has none)."""
    rows = np.empty(len(points.positions), _POINT)
    for axis, name in enumerate("xyz"):
        rows[name] = points.positions[:, axis]
    for part, name in enumerate(("red", "green", "blue")):
        rows[name] = 255 if points.colours is None else points.colours[:, part]
    rows["alpha"] = 255
    fields = [
        PackedElementField(name, offset, _FLOAT32 if kind.kind == "f" else _UINT8)
        for name, (kind, offset, *_) in (_POINT.fields or {}).items()
    ]
    return PointCloud(time(time_ns), frame, pose_value(Pose()), _POINT.itemsize, fields, rows.tobytes())


def schema_name(kind: type) -> str:
    """The name that Foxglove knows a well-known type by, or ours."""
    return f"foxglove.{kind.__name__}" if kind in WELL_KNOWN else f"handrail.{kind.__name__}"


def schema(kind: type) -> dict[str, Any]:
    """JSON Schema of a struct, in the part of it that Foxglove understands. Raises TypeError for a field that has none."""
    return {"title": schema_name(kind), **_schema(inspect.type_info(kind), kind.__name__)}


def _schema(info: inspect.Type, where: str) -> dict[str, Any]:
    match info:
        case inspect.Metadata():
            return _schema(info.type, where)
        case inspect.BoolType():
            return {"type": "boolean"}
        case inspect.IntType():
            return {"type": "integer"}
        case inspect.FloatType():
            return {"type": "number"}
        case inspect.StrType():
            return {"type": "string"}
        case inspect.BytesType():
            return {"type": "string", "contentEncoding": "base64"}
        case inspect.LiteralType() if all(isinstance(value, str) for value in info.values):
            return {"type": "string"}
        case inspect.ListType() | inspect.VarTupleType():
            return {"type": "array", "items": _schema(info.item_type, where)}
        case inspect.TupleType() if all(item == info.item_types[0] for item in info.item_types):
            return {"type": "array", "items": _schema(info.item_types[0], where)}
        case inspect.DictType():
            return {"type": "object", "properties": {}}  # its keys are only known in each message
        case inspect.StructType():
            fields = {field.encode_name: _schema(field.type, f"{where}.{field.name}") for field in info.fields}
            tag = {info.tag_field: {"type": "string"}} if info.tag_field else {}
            return {"type": "object", "properties": tag | fields}
        case inspect.UnionType() if info.includes_none and len(info.types) == 2:
            (other,) = (kind for kind in info.types if not isinstance(kind, inspect.NoneType))
            return _schema(other, where)
    raise TypeError(f"{where}: {info} has no form that Foxglove understands")
