"""A robot as it is drawn: its bodies' meshes and the chain that moves them, read from its description."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
import yourdfpy

from handrail.robot.description import RobotDescription
from tablet_client.models.hands import Span, spans
from tablet_client.models.whole_body import Camera
from tablet_client.scene.kinematics import Chain
from tablet_client.scene.meshes import Mesh, from_file, merged, shaded
from tablet_client.scene.solids import solid

_UNPAINTED = (0.72, 0.74, 0.77, 1.0)
# URDFs paint joints nearly black: on a dark ground that is a hole. Colours are lifted by this much, white stays white.
_LIFT = 0.30

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class DrawnRobot:
    """`meshes[i]` is drawn at the pose of `chain.bodies[i]`."""

    name: str
    chain: Chain
    meshes: tuple[Mesh, ...]
    tips: dict[str, str]
    """arm → the link at its tool's contact point"""
    arm_joints: dict[str, tuple[str, ...]]
    feet: tuple[str, ...]
    """links in the soles' middle"""
    cameras: tuple[Camera, ...]
    grippers: dict[str, Span]
    floor: float
    """m, height of the floor, or where the description has none of the lowest point that does not move"""


def load(description: RobotDescription, cache: Path, progress: Progress | None = None) -> DrawnRobot:
    """Read URDF and meshes; `progress(done, of)` is told as it goes. Raises OSError or ValueError where a mesh can't be read."""
    logging.getLogger("yourdfpy").setLevel(logging.ERROR)
    model = yourdfpy.URDF.load(str(description.urdf), load_meshes=False, build_scene_graph=False)
    chain = Chain(model, description.joints)
    named = {material.name: material for material in model.robot.materials}
    visuals = [(link, visual) for link in model.robot.links if link.name in chain.frames for visual in link.visuals]
    parts: list[list[Mesh]] = [[] for _ in chain.bodies]
    for done, (link, visual) in enumerate(visuals):
        if progress is not None:
            progress(done, len(visuals))
        frame = chain.frames[link.name]
        origin = np.eye(4) if visual.origin is None else visual.origin
        mesh = _mesh(visual.geometry, cache).painted(_color(visual.material, named))
        parts[frame.body].append(mesh.transformed(frame.pose_in_body @ origin))
    meshes = tuple(merged(part) for part in parts)
    lowest = float(meshes[0].vertices[:, 2].min()) if len(meshes[0].vertices) else 0.0
    return DrawnRobot(
        name=description.name,
        chain=chain,
        meshes=meshes,
        tips={name: arm.tip for name, arm in description.arms.items() if arm.tip in chain.frames},
        arm_joints={name: arm.joints for name, arm in description.arms.items()},
        feet=tuple(foot.link for foot in description.feet if foot.link in chain.frames),
        cameras=tuple(
            Camera(each.name, each.link, (0.0, 0.0, 1.0) if each.optical else (1.0, 0.0, 0.0))
            for each in description.cameras
        ),
        grippers=spans(description),
        floor=lowest if description.floor is None else description.floor,
    )


def _mesh(geometry: yourdfpy.Geometry, cache: Path) -> Mesh:
    if geometry.mesh is not None:
        scale = np.ones(3) if geometry.mesh.scale is None else np.broadcast_to(geometry.mesh.scale, 3)
        return from_file(Path(geometry.mesh.filename), (float(scale[0]), float(scale[1]), float(scale[2])), cache)
    if geometry.cylinder is not None:
        return solid("cylinder", (geometry.cylinder.radius, geometry.cylinder.length))
    if geometry.sphere is not None:
        return solid("sphere", (geometry.sphere.radius,))
    return shaded(trimesh.creation.box(extents=geometry.box.size))


def _color(
    material: yourdfpy.Material | None, named: dict[str, yourdfpy.Material]
) -> tuple[float, float, float, float]:
    if material is not None and material.color is None:
        material = named.get(material.name, material)
    if material is None or material.color is None:
        return _UNPAINTED
    red, green, blue, opacity = material.color.rgba
    lifted = [_LIFT + (0.92 - _LIFT) * float(part) for part in (red, green, blue)]
    return lifted[0], lifted[1], lifted[2], float(opacity)
