"""What an edit of an instance may say: each refuses with the field, its value and what was expected."""

from __future__ import annotations

import math
from collections.abc import Mapping

import msgspec

from affordance_templates import fields
from affordance_templates.instance import Instance
from affordance_templates.template_file import Template
from handrail.messages import EditInstance, Pose
from handrail.topics import refuse

Quaternion = tuple[float, float, float, float]

_FAR = 1000.0
"""m, beyond which a place is a slip of the keyboard"""


def edit(instance: Instance, asked: EditInstance) -> dict[str, fields.Value]:
    """field → value that an edit gives it."""
    if asked.position is not None:
        _near(asked.position, "position")
    if asked.orientation is not None:
        asked = msgspec.structs.replace(asked, orientation=unit(asked.orientation, "orientation"))
    parameters(instance.template, asked.parameters)
    for name, position in asked.joints.items():
        joint(instance, name, position)
    if asked.base is not None and not 0 < asked.base <= instance.version:
        raise refuse("no version that there was", "base", asked.base, f"1 to {instance.version}, the present one")
    return fields.asked(asked, instance)


def pose(given: Pose) -> Pose:
    """Finite, with a unit quaternion (one that is off by rounding is normalised)."""
    if not all(map(math.isfinite, (*given.position, *given.orientation))):
        raise refuse("the pose is not finite", "pose_in_world", given, "finite numbers")
    _near(given.position, "pose_in_world.position")
    return Pose(position=given.position, orientation=unit(given.orientation, "pose_in_world.orientation"))


def unit(quaternion: Quaternion, field: str) -> Quaternion:
    """Of norm 1; one that is off by rounding is normalised."""
    _finite(quaternion, field)
    norm = math.sqrt(sum(part * part for part in quaternion))
    if abs(norm - 1) > 1e-3:
        raise refuse(f"a quaternion of norm {norm:.4g}", field, quaternion, "norm 1 (x, y, z, w)")
    x, y, z, w = (part / norm for part in quaternion)
    return x, y, z, w


def parameters(template: Template, given: Mapping[str, float]) -> dict[str, float]:
    """Known ones within their bounds."""
    for name, value in given.items():
        if problem := template.problem(name, value):
            raise refuse(
                f"parameter {name}: {problem}", f"parameters.{name}", value, problem.rpartition("expected ")[2]
            )
    return dict(given)


def joint(instance: Instance, name: str, position: float) -> None:
    """A joint that it has, and a number."""
    joints = instance.resolve().joints
    if name not in joints:
        raise refuse("no such joint", "joint", name, f"one of: {', '.join(joints) or 'none: it has no joints'}")
    if not math.isfinite(position):
        raise refuse("not a position", "position", position, "a finite number")


def resolvable(instance: Instance) -> Instance:
    """One whose template has a shape with its parameters."""
    if problem := shape(instance):
        raise refuse(
            "the template has no shape with these parameters", "parameters", dict(instance.parameters), problem
        )
    return instance


def shape(instance: Instance) -> str:
    """Why its template has no shape with its parameters; empty: it has."""
    try:
        instance.resolve()
    except ValueError as problem:
        return str(problem)
    return ""


def _near(position: tuple[float, ...], field: str) -> None:
    _finite(position, field)
    if max(map(abs, position)) > _FAR:
        raise refuse("no robot reaches there", field, position, f"within {_FAR:g} m of the world's origin")


def _finite(numbers: tuple[float, ...], field: str) -> None:
    if not all(map(math.isfinite, numbers)):
        raise refuse("not finite", field, numbers, "finite numbers")
