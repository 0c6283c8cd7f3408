"""One URDF of a robot as it is used: joints made rigid, parts cut off, tools put on, mesh paths that any reader can open.

Works on the XML alone (no kinematics library), so that the plant, the planners and the tablet read the same file.
"""

from __future__ import annotations

import fnmatch
import hashlib
import os
import re
import shutil
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import metadata
from pathlib import Path
from typing import Annotated

import msgspec

from handrail.robot.srdf import disabled_pairs


class Tool(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """A rigid cylinder on a link, along its own −z; its `tip` frame is where it touches, −z pointing out of it."""

    name: str
    parent: str
    position: tuple[float, float, float]
    """m, of the tool's root in the parent link's frame"""
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """rad"""
    radius: Annotated[float, msgspec.Meta(gt=0)]
    """m"""
    length: Annotated[float, msgspec.Meta(gt=0)]
    """m"""
    mass: Annotated[float, msgspec.Meta(gt=0)]
    """kg"""
    tip: Annotated[float, msgspec.Meta(gt=0)]
    """m from the root to the contact point"""

    @property
    def tip_frame(self) -> str:
        return f"{self.name}_tip"


class Frame(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """A frame without mass or shape that the URDF lacks: where a gripper grasps, say."""

    name: str
    parent: str
    position: tuple[float, float, float]
    """m, in the parent link's frame"""
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """rad"""


class Block(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """A box that stands for a part of a link where it touches things."""

    size: tuple[
        Annotated[float, msgspec.Meta(gt=0)], Annotated[float, msgspec.Meta(gt=0)], Annotated[float, msgspec.Meta(gt=0)]
    ]
    """m"""
    position: tuple[float, float, float]
    """m, of its middle in the link's frame"""
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """rad"""


class Model(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """Where the robot's URDF comes from, and what is done to it."""

    distribution: str = ""
    """the installed package that carries it"""
    urdf: str = ""
    """path below the distribution's robots folder"""
    file: str = ""
    """instead of both: a URDF in the robot's own folder, with its meshes beside it"""
    srdf: str = ""
    """a semantic description beside it, path as the URDF's: pairs of links that it disables may touch"""
    fix: list[str] = []
    """joints made rigid at zero, as glob patterns"""
    cut: list[str] = []
    """links that are removed with all that hangs on them, as glob patterns"""
    tools: list[Tool] = []
    frames: list[Frame] = []
    touches: dict[str, Annotated[list[Block], msgspec.Meta(min_length=1)]] = {}
    """link → boxes that replace its collision shapes: a mesh collides as its convex hull, which fills what is hollow"""


def models_folder(distribution: str) -> Path:
    """The robots folder of an installed model package (example-robot-data ships data only, below cmeel.prefix).

    Raises FileNotFoundError when it is not installed.
    """
    try:
        files = metadata.files(distribution) or []
    except metadata.PackageNotFoundError as error:
        raise FileNotFoundError(f"the package {distribution} is not installed: pip install {distribution}") from error
    for entry in files:
        match = re.match(r"(.*share/[^/]+/robots)/", str(entry))
        if match:
            return Path(str(entry.locate())).parents[len(Path(str(entry)).parts) - len(Path(match[1]).parts) - 1]
    raise FileNotFoundError(f"the package {distribution} has no share/*/robots folder")


def assemble(model: Model, folder: Path | None = None) -> Path:
    """The assembled URDF as a file in the user's cache, named by its content; `folder` is the robot's own.

    Raises FileNotFoundError, ValueError.
    """
    source, robots = _source(model, folder)
    try:
        root = ET.parse(source).getroot()
    except ET.ParseError as error:
        raise ValueError(f"{source} is not a URDF: {error}") from error
    for tag in ("gazebo", "transmission"):
        for element in root.findall(tag):
            root.remove(element)
    _cut(root, model.cut)
    _fix(root, model.fix)
    for tool in model.tools:
        _mount(root, tool)
    for link, blocks in model.touches.items():
        _touch(root, link, blocks)
    for frame in model.frames:
        _check_parent(root, f"model.frames: {frame.name}", frame.parent)
        root.append(ET.fromstring(f'<link name="{frame.name}"/>'))
        root.append(_fixed_joint(f"{frame.name}_joint", frame.parent, frame.name, frame.position, frame.rpy))
    for mesh in root.iter("mesh"):
        name = re.sub(r"^package:/{2,3}[^/]+/robots/", f"{robots}/", mesh.get("filename", ""))
        mesh.set("filename", name if "://" in name else str(source.parent / name))
    text = ET.tostring(root, encoding="utf-8")
    return cached(text, f"{root.get('name', 'robot')}-{hashlib.sha256(text).hexdigest()[:16]}.urdf")


def _touch(root: ET.Element, name: str, blocks: Sequence[Block]) -> None:
    _check_parent(root, "model.touches", name)
    link = next(link for link in root.findall("link") if link.get("name") == name)
    for shape in link.findall("collision"):
        link.remove(shape)
    for block in blocks:
        position, rpy, size = (" ".join(map(str, numbers)) for numbers in (block.position, block.rpy, block.size))
        placed = f'<origin xyz="{position}" rpy="{rpy}"/><geometry><box size="{size}"/></geometry>'
        link.append(ET.fromstring(f"<collision>{placed}</collision>"))


def _source(model: Model, folder: Path | None) -> tuple[Path, Path]:
    """The URDF's file, and the folder that its package paths start in."""
    if model.file:
        if model.distribution or model.urdf:
            raise ValueError("has file and distribution or urdf; expected one or the other")
        if folder is None or not (folder / model.file).is_file():
            raise FileNotFoundError(f"model.file: {model.file} is not in {folder}")
        return folder / model.file, folder
    if not model.distribution or not model.urdf:
        raise ValueError("expected distribution and urdf, or file")
    robots = models_folder(model.distribution)
    if not (robots / model.urdf).is_file():
        raise FileNotFoundError(f"model.urdf: {model.urdf} is not in {robots}")
    return robots / model.urdf, robots


def allowed_pairs(model: Model, folder: Path) -> tuple[tuple[str, str], ...]:
    """Names of links that may touch by the model's SRDF. Raises FileNotFoundError, ValueError."""
    if not model.srdf:
        return ()
    file = _source(model, folder)[1] / model.srdf
    if not file.is_file():
        raise FileNotFoundError(f"model.srdf: {model.srdf} is not in {file.parent}")
    return disabled_pairs(file)


def cache_folder() -> Path:
    """Where derived models are kept: they can be deleted at any time."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    folder = Path(base) / "handrail" / "models"
    folder.mkdir(parents=True, exist_ok=True)
    return folder


@contextmanager
def whole_folder(folder: Path) -> Iterator[Path]:
    """A folder to be filled, which becomes `folder` at the end: whole or not at all, whoever else makes the same now."""
    partial = Path(tempfile.mkdtemp(dir=folder.parent, prefix=f".{folder.name}-"))
    try:
        yield partial
        try:
            partial.rename(folder)
        except OSError:
            if not folder.is_dir():  # else another process was faster, with the same content
                raise
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def cached(text: bytes, name: str) -> Path:
    """A file in the cache, whose name tells what is in it."""
    path = cache_folder() / name
    if not path.exists():
        with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as partial:
            partial.write(text)
        os.replace(partial.name, path)  # whole or not at all, whoever else writes it now
    return path


def _matching(names: Sequence[str], patterns: Sequence[str], field: str) -> set[str]:
    found: set[str] = set()
    for pattern in patterns:
        hits = fnmatch.filter(names, pattern)
        if not hits:
            raise ValueError(f"{field}: {pattern!r} matches nothing in the URDF")
        found.update(hits)
    return found


def _link(joint: ET.Element, end: str) -> str:
    element = joint.find(end)
    if element is None:
        raise ValueError(f"joint {joint.get('name')}: has no {end}")
    return element.get("link", "")


def _cut(root: ET.Element, patterns: Sequence[str]) -> None:
    dead = _matching([link.get("name", "") for link in root.findall("link")], patterns, "model.cut")
    joints = root.findall("joint")
    while True:
        below = {_link(joint, "child") for joint in joints if _link(joint, "parent") in dead} - dead
        if not below:
            break
        dead |= below
    for joint in joints:
        if _link(joint, "child") in dead:
            root.remove(joint)
    for link in root.findall("link"):
        if link.get("name") in dead:
            root.remove(link)


def _fix(root: ET.Element, patterns: Sequence[str]) -> None:
    moving = [joint for joint in root.findall("joint") if joint.get("type") != "fixed"]
    chosen = _matching([joint.get("name", "") for joint in moving], patterns, "model.fix")
    for joint in moving:
        if joint.get("name") in chosen:
            joint.set("type", "fixed")
            for tag in ("axis", "limit", "dynamics", "mimic", "safety_controller", "calibration"):
                for element in joint.findall(tag):
                    joint.remove(element)


def _check_parent(root: ET.Element, field: str, parent: str) -> None:
    if parent not in {link.get("name") for link in root.findall("link")}:
        raise ValueError(f"{field}: no link {parent!r} in the URDF")


def _mount(root: ET.Element, tool: Tool) -> None:
    _check_parent(root, f"model.tools: {tool.name}", tool.parent)
    half, r, m = tool.length / 2, tool.radius, tool.mass
    across, along = m * (3 * r * r + tool.length**2) / 12, m * r * r / 2  # solid cylinder
    shape = f'<origin xyz="0 0 {-half}"/><geometry><cylinder radius="{r}" length="{tool.length}"/></geometry>'
    root.append(
        ET.fromstring(
            f'<link name="{tool.name}"><inertial><origin xyz="0 0 {-half}"/><mass value="{m}"/>'
            f'<inertia ixx="{across}" iyy="{across}" izz="{along}" ixy="0" ixz="0" iyz="0"/></inertial>'
            f'<visual>{shape}<material name="{tool.name}"><color rgba="0.75 0.77 0.8 1"/></material></visual>'
            f"<collision>{shape}</collision></link>"
        )
    )
    root.append(_fixed_joint(f"{tool.name}_mount", tool.parent, tool.name, tool.position, tool.rpy))
    root.append(ET.fromstring(f'<link name="{tool.tip_frame}"/>'))
    root.append(_fixed_joint(f"{tool.tip_frame}_joint", tool.name, tool.tip_frame, (0.0, 0.0, -tool.tip)))


def _fixed_joint(
    name: str, parent: str, child: str, xyz: Sequence[float], rpy: Sequence[float] = (0.0, 0.0, 0.0)
) -> ET.Element:
    return ET.fromstring(
        f'<joint name="{name}" type="fixed"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{" ".join(map(str, xyz))}" rpy="{" ".join(map(str, rpy))}"/></joint>'
    )
