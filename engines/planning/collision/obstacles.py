"""A template's shapes in the world, as solids to keep clear of."""

from __future__ import annotations

import weakref
from collections.abc import Iterable
from dataclasses import dataclass, replace

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from affordance_templates.instance import Instance
from affordance_templates.template import ResolvedJoint, Shape
from handrail.messages import Pose

Array = NDArray[np.float64]

_TORUS_SIDES = 24


@dataclass(frozen=True)
class Obstacle:
    """A solid that stands still: convex, or an octree."""

    name: str
    geometry: coal.CollisionGeometry
    placement: pin.SE3
    """in the world"""
    part_of: str = ""
    """the instance that it is part of, if any"""

    @property
    def label(self) -> str:
        """What messages call it."""
        return f"{self.name} of {self.part_of}" if self.part_of else self.name


def placement_of(pose: Pose) -> pin.SE3:
    """A message's pose as a pinocchio placement."""
    x, y, z, w = pose.orientation
    return pin.SE3(pin.Quaternion(w, x, y, z).normalized().toRotationMatrix(), np.array(pose.position))


_KNOWN: dict[int, list[Obstacle]] = {}
"""by identity of an instance that is alive; one does not change, an edit makes another"""


def obstacles_of(instance: Instance) -> list[Obstacle]:
    """Everything of an instance that the arm must not hit.

    What turns with a continuous joint (a wheel's rim and spokes) counts as the whole body of revolution that it sweeps: the wheel
    turns while the arm is at it. What moves with any other joint counts where it is believed to be.
    """
    key = id(instance)
    if key not in _KNOWN:
        _KNOWN[key] = _obstacles(instance)
        weakref.finalize(instance, _KNOWN.pop, key, None)
    return list(_KNOWN[key])


def _obstacles(instance: Instance) -> list[Obstacle]:
    in_world = placement_of(instance.pose_in_world)
    resolved = instance.resolve()
    obstacles: list[Obstacle] = []
    still = list(enumerate(resolved.shapes))
    for joint in resolved.joints.values():
        if joint.kind != "continuous":
            continue
        moved = _moved_by(instance, joint)
        for name in dict.fromkeys(shape.object for number, shape in still if number in moved):
            shapes = [shape for number, shape in still if number in moved and shape.object == name]
            obstacles.append(_revolved(name, shapes, joint, in_world, instance.name))
        still = [(number, shape) for number, shape in still if number not in moved]
    for _, shape in still:
        obstacles.extend(_solids(shape, in_world, instance.name))
    return obstacles


def _moved_by(instance: Instance, joint: ResolvedJoint) -> set[int]:
    """Numbers of the shapes that a joint carries: those elsewhere when it stands elsewhere."""
    turned = replace(instance, joint_state={**instance.joint_state, joint.name: joint.position + 0.1}).resolve()
    before = instance.resolve().shapes
    return {
        number
        for number, (a, b) in enumerate(zip(before, turned.shapes, strict=True))
        if not np.allclose(a.pose_in_template, b.pose_in_template, atol=1e-9)
    }


def _revolved(name: str, shapes: Iterable[Shape], joint: ResolvedJoint, in_world: pin.SE3, part_of: str) -> Obstacle:
    """The smallest cylinder about the joint's axis that holds the shapes at every angle."""
    radius, low, high = 0.0, np.inf, -np.inf
    for shape in shapes:
        points, thickness = _skeleton(shape)
        offset = points - joint.origin
        along = offset @ joint.axis
        across = np.linalg.norm(offset - along[:, None] * joint.axis, axis=1)
        radius = max(radius, across.max() + thickness)
        low, high = min(low, along.min() - thickness), max(high, along.max() + thickness)
    centre = joint.origin + joint.axis * (low + high) / 2
    rotation = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), joint.axis).toRotationMatrix()
    return Obstacle(name, coal.Cylinder(radius, high - low), in_world * pin.SE3(rotation, centre), part_of)


def _skeleton(shape: Shape) -> tuple[Array, float]:
    """Points (k, 3) in the template's frame and a radius: the shape lies within the hull of balls of that radius about them."""
    angles = np.arange(_TORUS_SIDES) * 2 * np.pi / _TORUS_SIDES
    # Circumscribed: the polygon holds the circle.
    ring = np.column_stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)]) / np.cos(np.pi / _TORUS_SIDES)
    match shape.kind:
        case "sphere":
            points, radius = np.zeros((1, 3)), shape.size[0]
        case "capsule":
            points, radius = np.array([[0, 0, -0.5], [0, 0, 0.5]]) * shape.size[1], shape.size[0]
        case "cylinder":
            ends = np.array([0, 0, shape.size[1] / 2])
            points, radius = np.vstack([ring * shape.size[0] - ends, ring * shape.size[0] + ends]), 0.0
        case "box":
            corners = np.array(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5])).reshape(3, -1).T
            points, radius = corners * np.array(shape.size), 0.0
        case "torus":
            points, radius = ring * shape.size[0], shape.size[1]
        case "mesh":
            points, radius = _mesh(shape).points(), 0.0
    pose = shape.pose_in_template
    return points @ pose[:3, :3].T + pose[:3, 3], radius


def _solids(shape: Shape, in_world: pin.SE3, part_of: str) -> list[Obstacle]:
    placement = in_world * pin.SE3(shape.pose_in_template[:3, :3], shape.pose_in_template[:3, 3])
    match shape.kind:
        case "sphere":
            geometry = coal.Sphere(shape.size[0])
        case "capsule":
            geometry = coal.Capsule(shape.size[0], shape.size[1])
        case "cylinder":
            geometry = coal.Cylinder(shape.size[0], shape.size[1])
        case "box":
            geometry = coal.Box(*shape.size)
        case "torus":
            return _ring(shape, placement, part_of)
        case "mesh":
            geometry = _mesh(shape)
    return [Obstacle(shape.object, geometry, placement, part_of)]


def _mesh(shape: Shape) -> coal.ConvexBase:
    """The convex hull of a mesh."""
    mesh = coal.MeshLoader().load(str(shape.file), np.array(shape.size))
    mesh.buildConvexHull(True, "Qt")
    return mesh.convex


def _ring(shape: Shape, placement: pin.SE3, part_of: str) -> list[Obstacle]:
    """A torus as capsules end to end; coal knows convex solids only."""
    major, minor = shape.size
    side = 2 * major * np.tan(np.pi / _TORUS_SIDES)  # circumscribed: nothing of the torus sticks out at the corners
    capsule = coal.Capsule(minor, side)
    pieces = []
    for angle in np.arange(_TORUS_SIDES) * 2 * np.pi / _TORUS_SIDES:
        turn = pin.utils.rotate("z", angle) @ pin.utils.rotate("x", np.pi / 2)  # the capsule's z along the circle
        centre = major * np.array([np.cos(angle), np.sin(angle), 0.0])
        pieces.append(Obstacle(shape.object, capsule, placement * pin.SE3(turn, centre), part_of))
    return pieces
