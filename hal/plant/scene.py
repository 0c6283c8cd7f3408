"""What stands around the robot: a YAML file, read strictly, as bodies for the plant.

A scene names its objects::

    objects:
      valve:
        kind: wheel
        pose_in_world: {position: [0.55, -0.35, 0.30], rpy_deg: [0, 0, 0]}
        radius: 0.15
        hinge_friction: 2.0

`kind` is ``wheel``, ``box`` or ``linkage`` (hal.plant.linkage: things with joints). A pose is a position in m and either
``rpy_deg`` (about the world's x, y, z, in this order, in degrees) or ``orientation`` (unit quaternion x, y, z, w). The world is the
robot's fixed base.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np

from hal.plant import linkage
from hal.plant.linkage import Latch, Link, LinkShape, Thread
from hal.plant.merge import rotation_from_rpy
from handrail import config, workspace
from handrail.messages import Pose

Friction = Annotated[float, msgspec.Meta(ge=0, le=2)]
Coordinate = Annotated[float, msgspec.Meta(ge=-20, le=20)]


class _PoseFile(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    position: tuple[Coordinate, Coordinate, Coordinate]
    rpy_deg: tuple[float, float, float] | None = None
    orientation: tuple[float, float, float, float] | None = None


class Wheel(msgspec.Struct, kw_only=True, forbid_unknown_fields=True, frozen=True, tag_field="kind", tag="wheel"):
    """A valve's wheel on a hinge along its own +x; rim and spokes of round tube, in its y-z plane.

    At hinge angle 0 the first spoke points along +z, the others follow evenly; the hinge turns without end, held by Coulomb
    friction alone.
    """

    pose_in_world: _PoseFile
    radius: Annotated[float, msgspec.Meta(ge=0.03, le=1)] = 0.15
    """m, of the rim's centre line"""
    tube_radius: Annotated[float, msgspec.Meta(ge=0.002, le=0.1)] = 0.012
    """m"""
    spokes: Annotated[int, msgspec.Meta(ge=1, le=12)] = 4
    spoke_radius: Annotated[float, msgspec.Meta(ge=0.002, le=0.1)] = 0.010
    """m"""
    hinge_friction: Annotated[float, msgspec.Meta(ge=0, le=200)] = 2.0
    """N·m, Coulomb"""
    hinge_angle: Annotated[float, msgspec.Meta(ge=-100, le=100)] = 0.0
    """rad, at the start"""
    friction: Friction = 0.6
    """Coulomb coefficient of its surface; a contact's is the product of both"""


class Box(msgspec.Struct, kw_only=True, forbid_unknown_fields=True, frozen=True, tag_field="kind", tag="box"):
    """Something that doesn't move: a wall, a table; or, with a mass, something loose that can be picked up."""

    pose_in_world: _PoseFile
    size: tuple[
        Annotated[float, msgspec.Meta(gt=0, le=20)],
        Annotated[float, msgspec.Meta(gt=0, le=20)],
        Annotated[float, msgspec.Meta(gt=0, le=20)],
    ]
    """m, along its axes"""
    mass: Annotated[float, msgspec.Meta(ge=0.001, le=1000)] | None = None
    """kg; none: it is fixed where it is"""
    friction: Friction = 0.6


class Linkage(msgspec.Struct, kw_only=True, forbid_unknown_fields=True, frozen=True, tag_field="kind", tag="linkage"):
    """A thing with joints of its own (hal.plant.linkage): a door, buttons, a cap."""

    pose_in_world: _PoseFile
    links: dict[str, Link] = {}
    shapes: tuple[LinkShape, ...] = ()
    """of its base"""
    mass: Annotated[float, msgspec.Meta(ge=0.001, le=1000)] | None = None
    """kg, of a base that is loose; none: it is fixed where it is"""
    latches: tuple[Latch, ...] = ()
    threads: tuple[Thread, ...] = ()
    friction: Friction = 0.6


SceneObject = Wheel | Box | Linkage


class _SceneFile(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    objects: dict[str, Any]


@dataclass(frozen=True)
class Scene:
    """Objects by name, with their poses in the world."""

    file: Path
    objects: dict[str, SceneObject]
    poses_in_world: dict[str, Pose]


EMPTY = Scene(Path(), {}, {})
"""No objects: the robot alone."""


def library() -> dict[str, Path]:
    """Name → file of the scenes that there are."""
    return workspace.files(workspace.search_path("scenes", "rtc_programs", "scenes"))


def find(name_or_file: str | os.PathLike[str]) -> Path:
    """The scene's file. Raises config.ConfigError naming what there is."""
    given = Path(name_or_file)
    if given.is_file():
        return given
    known = library()
    if str(name_or_file) in known:
        return known[str(name_or_file)]
    raise config.ConfigError(
        str(name_or_file), None, "scene", f"no such scene; expected one of {', '.join(sorted(known))}, or a YAML file"
    )


def load(name_or_file: str | os.PathLike[str]) -> Scene:
    """Read a scene by name or file. Raises config.ConfigError with file, line, field and expectation."""
    document = config.read(find(name_or_file))
    objects: dict[str, SceneObject] = {}
    poses: dict[str, Pose] = {}
    for name in document.convert(_SceneFile).objects:
        field = f"objects.{name}"
        if not name.isidentifier():
            raise document.error(field, "expected a name of letters, digits and underscores")
        if not isinstance(document.data["objects"][name], dict):
            raise document.error(field, "expected a mapping with kind and pose_in_world")
        _convert_links(document, field)
        thing: SceneObject = document.convert(SceneObject, field)  # type: ignore[arg-type]
        _check_finite(document, field, document.data["objects"][name])
        if isinstance(thing, Wheel) and thing.tube_radius > thing.radius / 2:
            raise document.error(
                f"{field}.tube_radius",
                f"got {thing.tube_radius} m; expected at most half the radius, {thing.radius / 2:g}",
            )
        if isinstance(thing, Linkage):
            _check_linkage(document, field, thing)
        objects[name] = thing
        poses[name] = _pose(document, f"{field}.pose_in_world", thing.pose_in_world)
    return Scene(document.file, objects, poses)


def _convert_links(document: config.Document, field: str) -> None:
    """A linkage's links one by one, so that an error knows its link and line."""
    given = document.data["objects"][field.partition(".")[2]]
    if given.get("kind") == "linkage" and isinstance(given.get("links"), dict):
        for name in given["links"]:
            document.convert(Link, f"{field}.links.{name}")


def _check_linkage(document: config.Document, field: str, thing: Linkage) -> None:
    for k, shape in enumerate(thing.shapes):
        if wrong := linkage.shape_problem(shape):
            raise document.error(f"{field}.shapes[{k}].size", wrong)
    if found := linkage.problem(thing.links, thing.latches, thing.threads):
        raise document.error(f"{field}.{found[0]}", found[1])


def _check_finite(document: config.Document, field: str, node: Any) -> None:
    """YAML has .nan and .inf, and a NaN passes every bound."""
    children = node.items() if isinstance(node, dict) else enumerate(node) if isinstance(node, list) else ()
    for key, child in children:
        _check_finite(document, f"{field}.{key}" if isinstance(node, dict) else f"{field}[{key}]", child)
    if isinstance(node, float) and not math.isfinite(node):
        raise document.error(field, f"got {float(node)}; expected a finite number")


def _pose(document: config.Document, field: str, given: _PoseFile) -> Pose:
    if given.orientation is not None:
        if given.rpy_deg is not None:
            raise document.error(field, "has rpy_deg and orientation; expected one of them")
        length = math.hypot(*given.orientation)
        if abs(length - 1.0) > 1e-3:
            raise document.error(
                f"{field}.orientation", f"got a length of {length:.6g}; expected a unit quaternion (x, y, z, w)"
            )
        x, y, z, w = (component / length for component in given.orientation)
        return Pose(position=given.position, orientation=(x, y, z, w))
    rotation = rotation_from_rpy(*(math.radians(angle) for angle in given.rpy_deg or (0.0, 0.0, 0.0)))
    return Pose(position=given.position, orientation=quaternion(rotation))


def quaternion(rotation: np.ndarray) -> tuple[float, float, float, float]:
    """The unit quaternion (x, y, z, w), w ≥ 0, of a rotation (3, 3)."""
    # Each row holds 4 q_i q_j (Bar-Itzhack): the largest diagonal is never small, so nothing is lost to cancellation.
    r = rotation
    products = np.array(
        [
            [1 + r[0, 0] - r[1, 1] - r[2, 2], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0], r[2, 1] - r[1, 2]],
            [r[0, 1] + r[1, 0], 1 - r[0, 0] + r[1, 1] - r[2, 2], r[1, 2] + r[2, 1], r[0, 2] - r[2, 0]],
            [r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], 1 - r[0, 0] - r[1, 1] + r[2, 2], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], 1 + r[0, 0] + r[1, 1] + r[2, 2]],
        ]
    )
    row = products[int(np.argmax(np.diag(products)))]
    x, y, z, w = (row / np.linalg.norm(row) * (1.0 if row[3] >= 0 else -1.0)).tolist()
    return x, y, z, w
