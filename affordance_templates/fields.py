"""The fields of an instance that operators edit, each by itself.

`position` and `orientation`, in the frame of what the instance goes along with; `attachment`, what that is; `parameters.NAME`;
`joints.NAME`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from affordance_templates import attachments
from affordance_templates.instance import Instance
from affordance_templates.placement import Array
from handrail.messages import EditInstance, Pose

Value = tuple[float, ...] | str
"""(3,) m; (4,) unit quaternion (x, y, z, w); (1,) a parameter in its unit, a joint in rad (prismatic: m); an attachment's text"""

POSE = ("position", "orientation")
ATTACHMENT = "attachment"
WHERE = (*POSE, ATTACHMENT)
"""those that say where it is: with another attachment all three are other ones"""
_PARAMETER, _JOINT = "parameters.", "joints."


def asked(edit: EditInstance, instance: Instance) -> dict[str, Value]:
    """What an edit, which says places in the world, wants to be so."""
    values: dict[str, Value] = {
        **{_PARAMETER + name: (value,) for name, value in edit.parameters.items()},
        **{_JOINT + name: (value,) for name, value in edit.joints.items()},
    }
    there = instance.pose_in_world
    pose = attachments.seen_from(
        attachments.parent_in_world(instance),
        Pose(
            position=there.position if edit.position is None else edit.position,
            orientation=there.orientation if edit.orientation is None else edit.orientation,
        ),
    )
    if edit.position is not None:
        values["position"] = pose.position
    if edit.orientation is not None:
        values["orientation"] = pose.orientation
    return values


def names(instance: Instance) -> Iterator[str]:
    """All its fields."""
    yield from WHERE
    yield from (_PARAMETER + name for name in instance.template.parameters)
    yield from (_JOINT + name for name in instance.resolve().joints)


def value(instance: Instance, field: str) -> Value | None:
    """None: it has no such field, which a template that was edited may have lost."""
    if field in POSE:
        return tuple(getattr(instance.own_pose, field))
    if field == ATTACHMENT:
        return instance.attached_to
    name = field.partition(".")[2]
    if field.startswith(_PARAMETER):
        parameter = instance.template.parameters.get(name)
        return None if parameter is None else (float(instance.parameters.get(name, parameter.default)),)
    return (float(instance.joint_state.get(name, 0.0)),) if name in instance.resolve().joints else None


def with_values(instance: Instance, values: Mapping[str, Value], parent: Array | None) -> Instance:
    """The instance with other values in some fields.

    :param parent: (4, 4), where what it then goes along with is in the world; None: it stands there itself
    """
    changes: dict[str, Any] = {}
    for prefix, attribute in ((_PARAMETER, "parameters"), (_JOINT, "joint_state")):
        of_kind = {field.removeprefix(prefix): one[0] for field, one in values.items() if field.startswith(prefix)}
        if of_kind:
            changes[attribute] = {**getattr(instance, attribute), **of_kind}
    new = instance.changed(**changes) if changes else instance
    if not values.keys() & set(WHERE):
        return new
    own = {field: values.get(field, getattr(instance.own_pose, field)) for field in POSE}
    to = str(values.get(ATTACHMENT, instance.attached_to))
    return attachments.with_own_pose(new, Pose(**own), to, parent)  # type: ignore[arg-type]


def joint(name: str) -> str:
    """A joint's field."""
    return _JOINT + name


def of_joint(field: str) -> bool:
    """Whether a field is a joint's."""
    return field.startswith(_JOINT)
