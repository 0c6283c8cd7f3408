"""The fields of an instance that operators edit, each by itself: `position`, `orientation`, `parameters.NAME`, `joints.NAME`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from affordance_templates.instance import Instance
from handrail.messages import EditInstance, Pose

Value = tuple[float, ...]
"""(3,) m; (4,) unit quaternion (x, y, z, w); (1,) a parameter in its unit, a joint in rad (prismatic: m)"""

POSE = ("position", "orientation")
_PARAMETER, _JOINT = "parameters.", "joints."


def asked(edit: EditInstance) -> dict[str, Value]:
    """What an edit wants to be so."""
    pose = {"position": edit.position, "orientation": edit.orientation}
    return {
        **{field: value for field, value in pose.items() if value is not None},
        **{_PARAMETER + name: (value,) for name, value in edit.parameters.items()},
        **{_JOINT + name: (value,) for name, value in edit.joints.items()},
    }


def names(instance: Instance) -> Iterator[str]:
    """All its fields."""
    yield from POSE
    yield from (_PARAMETER + name for name in instance.template.parameters)
    yield from (_JOINT + name for name in instance.resolve().joints)


def value(instance: Instance, field: str) -> Value | None:
    """None: it has no such field, which a template that was edited may have lost."""
    if field in POSE:
        return tuple(getattr(instance.pose_in_world, field))
    name = field.partition(".")[2]
    if field.startswith(_PARAMETER):
        parameter = instance.template.parameters.get(name)
        return None if parameter is None else (float(instance.parameters.get(name, parameter.default)),)
    return (float(instance.joint_state.get(name, 0.0)),) if name in instance.resolve().joints else None


def with_values(instance: Instance, values: Mapping[str, Value]) -> Instance:
    """The instance with other values in some fields."""
    changes: dict[str, Any] = {}
    if pose := {field: values[field] for field in POSE if field in values}:
        kept = {field: getattr(instance.pose_in_world, field) for field in POSE}
        changes["pose_in_world"] = Pose(**{**kept, **pose})  # type: ignore[arg-type]
    for prefix, attribute in ((_PARAMETER, "parameters"), (_JOINT, "joint_state")):
        of_kind = {field.removeprefix(prefix): one[0] for field, one in values.items() if field.startswith(prefix)}
        if of_kind:
            changes[attribute] = {**getattr(instance, attribute), **of_kind}
    return instance.changed(**changes)


def joint(name: str) -> str:
    """A joint's field."""
    return _JOINT + name


def of_joint(field: str) -> bool:
    """Whether a field is a joint's."""
    return field.startswith(_JOINT)
