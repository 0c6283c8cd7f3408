"""The scene's objects as URDF texts for PyBullet."""

from __future__ import annotations

import math

from hal.plant import linkage
from hal.plant.scene import Box, Linkage, SceneObject, Wheel

HINGE = 0
"""joint index of a wheel's hinge in its body"""
_RIM_PARTS = 24
_STEEL, _PAINT, _MARK = "0.55 0.57 0.6 1", "0.75 0.16 0.12 1", "0.95 0.8 0.2 1"


def object_urdf(name: str, thing: SceneObject) -> str:
    """One object as a body whose base is at the object's pose, and fixed there unless it `is_loose`."""
    match thing:
        case Wheel():
            return _wheel(name, thing)
        case Box():
            return _box(name, thing)
        case Linkage():
            return linkage.urdf(name, thing.mass, thing.shapes, thing.links)


def is_loose(thing: SceneObject) -> bool:
    """The object can be carried away."""
    return isinstance(thing, Box | Linkage) and thing.mass is not None


def hinge_names(name: str, thing: SceneObject) -> tuple[str, ...]:
    """What the ground truth calls an object's joints: OBJECT of a wheel's only one, OBJECT.JOINT of a linkage's."""
    match thing:
        case Wheel():
            return (name,)
        case Linkage():
            return tuple(f"{name}.{joint}" for joint in thing.links)
    return ()


def _inertial(mass: float, xx: float, yy: float, zz: float) -> str:
    return f'<inertial><mass value="{mass}"/><inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial>'


def _shape(geometry: str, origin: str, colour: str) -> str:
    inside = f"{origin}<geometry>{geometry}</geometry>"
    return (
        f"<collision>{inside}</collision>"
        f'<visual>{inside}<material name="{colour}"><color rgba="{colour}"/></material></visual>'
    )


def _box(name: str, box: Box) -> str:
    size = " ".join(map(repr, box.size))
    mass, (x, y, z) = box.mass or 1.0, box.size
    inertial = _inertial(mass, mass * (y * y + z * z) / 12, mass * (x * x + z * z) / 12, mass * (x * x + y * y) / 12)
    shape = _shape(f'<box size="{size}"/>', "", _STEEL)
    return f'<robot name="{name}"><link name="base">{inertial}{shape}</link></robot>'


def _wheel(name: str, wheel: Wheel) -> str:
    """Capsules all round: a torus as a mesh would catch on its edges, and cost more."""
    radius, parts = wheel.radius, []
    for part in range(_RIM_PARTS):
        angle = 2 * math.pi * (part + 0.5) / _RIM_PARTS
        length = 2 * radius * math.sin(math.pi / _RIM_PARTS) * 1.05
        parts.append((angle, radius, angle, wheel.tube_radius, length, _PAINT))
    for spoke in range(wheel.spokes):
        # The first one is painted, so that a picture shows how far the wheel has turned.
        angle = 2 * math.pi * spoke / wheel.spokes + math.pi / 2
        colour = _MARK if spoke == 0 else _PAINT
        parts.append((angle, radius / 2, angle - math.pi / 2, wheel.spoke_radius, radius - 0.02, colour))
    shapes = "".join(
        _shape(
            f'<capsule radius="{thickness}" length="{length}"/>',
            f'<origin xyz="0 {out * math.cos(angle)} {out * math.sin(angle)}" rpy="{tilt} 0 0"/>',
            colour,
        )
        for angle, out, tilt, thickness, length, colour in parts
    )
    # 2 kg, most of it in the rim
    inertia = wheel.radius**2 * 4 / 3
    return (
        f'<robot name="{name}"><link name="base">{_inertial(5, 0.05, 0.05, 0.05)}</link>'
        f'<link name="wheel">{_inertial(2, inertia, inertia / 2, inertia / 2)}{shapes}</link>'
        '<joint name="hinge" type="continuous"><parent link="base"/><child link="wheel"/><axis xyz="1 0 0"/></joint></robot>'
    )
