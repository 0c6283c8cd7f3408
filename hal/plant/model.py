"""The robot as PyBullet wants it: the assembled URDF with fixed links merged, and shapes only where they are needed.

Loaded as it comes, a URDF gives PyBullet dynamics that are badly wrong (links without inertia become 1 kg, its own merge
corrupts inertia) and collision meshes that cost more than everything else. What is prepared here agrees with pinocchio to
1e-9, and collides with convex hulls of the links that may touch something.
"""

from __future__ import annotations

import hashlib
import os
import xml.etree.ElementTree as ET
from collections.abc import Collection
from pathlib import Path

import numpy as np

from hal.plant.merge import Merged, merge_fixed_links
from handrail.robot.description import RobotDescription
from handrail.robot.urdf import cache_folder, whole_folder

# Part of the cache's key: raise it when what is prepared changes.
_VERSION = "1"
# From the elbow outward an arm works in contact: its last four joints carry forearm, wrist and tool.
_CONTACT_JOINTS = 4


def contact_links(description: RobotDescription) -> set[str]:
    """The merged links that collide: of every arm, those that its last four joints move (forearm, wrist, tool), and of every
    gripper those that it moves; of a robot with a free base whatever ends a chain too, since it stands on some of them."""
    robot = ET.parse(description.urdf).getroot()
    joints = {joint for arm in description.arms.values() for joint in arm.joints[-_CONTACT_JOINTS:]}
    joints |= {*description.device_limits, *description.mimics}
    links: set[str] = set()
    parents = set()
    for joint in _merged(description, robot).root.findall("joint"):
        parent, child = (joint.find(end) for end in ("parent", "child"))
        assert parent is not None and child is not None  # merging read them
        parents.add(parent.get("link", ""))
        if joint.get("name") in joints or (parent.get("link") in links and joint.get("type") == "fixed"):
            links.add(child.get("link", ""))
    if description.base == "free":
        links |= {link.get("name", "") for link in robot.findall("link")} - parents
    return links


def _merged(description: RobotDescription, robot: ET.Element) -> Merged:
    return merge_fixed_links(robot, [d.link for d in description.devices if d.family == "force_torque"])


def carriers(description: RobotDescription) -> dict[str, tuple[str, np.ndarray]]:
    """Every link of the robot → the link of the prepared URDF that carries it, and its pose (4, 4) in that link's frame."""
    return _merged(description, ET.parse(description.urdf).getroot()).home


def prepare(description: RobotDescription, *, visual: bool = False) -> Path:
    """The robot's URDF for the plant, made once and kept in the user's cache under a hash of all that it is made from.

    `visual`: with the robot's looks, for pictures; the plant itself does without. Raises FileNotFoundError for a mesh that is
    not there, ValueError for a URDF or mesh that can't be used.
    """
    robot = _merged(description, ET.parse(description.urdf).getroot()).root
    _drop_shapes(robot, contact_links(description), visual)
    folder = cache_folder() / f"plant-{description.name}-{_content_hash(robot)}"
    if not folder.is_dir():
        _write(robot, folder)
    return folder / "robot.urdf"


def _drop_shapes(robot: ET.Element, touching: Collection[str], visual: bool) -> None:
    for link in robot.findall("link"):
        for shape in link.findall("collision"):
            if link.get("name") not in touching:
                link.remove(shape)
        if not visual:
            for shape in link.findall("visual"):
                link.remove(shape)


def _content_hash(robot: ET.Element) -> str:
    digest = hashlib.sha256(_VERSION.encode())
    digest.update(ET.tostring(robot))
    for name in sorted({mesh.get("filename", "") for mesh in robot.iter("mesh")}):
        file = Path(name)
        if not file.is_file():
            raise FileNotFoundError(f"mesh {name} is not there; expected an absolute path to a mesh that trimesh reads")
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def _write(robot: ET.Element, folder: Path) -> None:
    """Write URDF and meshes beside each other."""
    with whole_folder(folder) as partial:
        for kind in ("collision", "visual"):
            for mesh in robot.iterfind(f"./link/{kind}/geometry/mesh"):
                _localise(mesh, partial, hull=kind == "collision")
        ET.ElementTree(robot).write(partial / "robot.urdf", encoding="utf-8", xml_declaration=True)


def _localise(mesh: ET.Element, folder: Path, *, hull: bool) -> None:
    """Replace a mesh by an OBJ beside the URDF: of its convex hull, or as it is, with its scale (mirrors too) applied."""
    source = mesh.get("filename", "")
    scale = mesh.attrib.pop("scale", "1 1 1")
    key = hashlib.sha256(f"{source} {scale} {hull}".encode()).hexdigest()[:12]
    name = f"{Path(source).stem.lower()}_{key}.obj"
    mesh.set("filename", name)
    if os.path.exists(folder / name):
        return
    import trimesh  # half of what a plant imports; it does without once its model is in the cache

    shape = trimesh.load(source, force="mesh")
    if not isinstance(shape, trimesh.Trimesh) or len(shape.vertices) == 0:
        raise ValueError(f"mesh {source}: has no triangles")
    shape.apply_transform(np.diag([*(float(factor) for factor in scale.split()), 1.0]))
    if hull:
        shape = shape.convex_hull
    shape.export(folder / name, include_normals=not hull, include_color=False, include_texture=False)
