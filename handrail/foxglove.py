"""Messages as Foxglove shows them: its own well-known types, and JSON schemas for ours.

Foxglove reads JSON messages by their JSON Schema, of which it understands a part: objects, arrays of one type, strings, numbers,
booleans; no references, no alternatives. `schema` writes any struct of ours in that part, so that plots and tables work on every
recorded message. Names and fields of the well-known types: https://docs.foxglove.dev/docs/sdk/schemas.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec
from msgspec import inspect

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


class Log(msgspec.Struct):
    timestamp: Time
    level: int
    message: str
    name: str
    file: str = ""
    line: int = 0


LOG_LEVEL = {"info": 2, "warning": 3, "error": 4}

WELL_KNOWN = (FrameTransforms, PoseInFrame, JointStates, Log)


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
