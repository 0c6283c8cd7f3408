"""Exact merging of the links that fixed joints connect, on a URDF's XML.

PyBullet's own merge (``URDF_MERGE_FIXED_LINKS``) gets inertia wrong, and a body of more than about 128 links loses its link
states. Merged here by spatial inertia, a link's mass, first moment and inertia about its frame are the sums of its parts';
so are the dynamics of every joint that is left.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

# A body without mass is singular to PyBullet, which makes a missing inertial 1 kg: give it one that nothing can feel.
TINY_MASS = 1e-9
"""kg"""
TINY_INERTIA = 1e-12
"""kg·m²"""


@dataclass(frozen=True)
class Inertial:
    """Mass kg, centre of mass m (3,), rotational inertia kg·m² (3, 3) about it, in some link's axes."""

    mass: float
    centre: np.ndarray
    inertia: np.ndarray

    @classmethod
    def of(cls, link: ET.Element) -> Inertial:
        """A link's own, in its frame; without mass where it states none."""
        element = link.find("inertial")
        if element is None:
            return cls(0.0, np.zeros(3), np.zeros((3, 3)))
        mass, tensor = element.find("mass"), element.find("inertia")
        if mass is None or tensor is None:
            raise ValueError(f"link {link.get('name')}: inertial: expected mass and inertia")
        xx, xy, xz, yy, yz, zz = (float(tensor.get(key, "0")) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
        about = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        placement = origin_of(element)
        rotation = placement[:3, :3]
        return cls(float(mass.get("value", "0")), placement[:3, 3], rotation @ about @ rotation.T)

    def seen_from(self, placement: np.ndarray) -> Inertial:
        """The same body, where `placement` (4, 4) is its frame's pose in another one."""
        rotation = placement[:3, :3]
        centre = rotation @ self.centre + placement[:3, 3]
        return Inertial(self.mass, centre, rotation @ self.inertia @ rotation.T)

    def __add__(self, other: Inertial) -> Inertial:
        mass = self.mass + other.mass
        if mass == 0.0:
            return self
        centre = (self.mass * self.centre + other.mass * other.centre) / mass
        inertia = np.zeros((3, 3))
        for part in (self, other):  # parallel axes
            arm = part.centre - centre
            inertia += part.inertia + part.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        return Inertial(mass, centre, inertia)


def rotation_from_rpy(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """URDF's rotation (3, 3): about the fixed x, then y, then z axis, rad."""
    (sr, cr), (sp, cp), (sy, cy) = ((math.sin(angle), math.cos(angle)) for angle in (roll, pitch, yaw))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def rpy_from_rotation(rotation: np.ndarray) -> tuple[float, float, float]:
    """The inverse of `rotation_from_rpy`, rad; exact to rounding at a pitch of ±90° too, where yaw is taken as zero."""
    across = math.hypot(rotation[0, 0], rotation[1, 0])
    pitch = math.atan2(-rotation[2, 0], across)
    if across < 1e-12:
        return math.atan2(-rotation[1, 2], rotation[1, 1]), pitch, 0.0
    return math.atan2(rotation[2, 1], rotation[2, 2]), pitch, math.atan2(rotation[1, 0], rotation[0, 0])


def origin_of(element: ET.Element) -> np.ndarray:
    """The pose (4, 4) that an element's <origin> states; identity where there is none."""
    placement = np.eye(4)
    origin = element.find("origin")
    if origin is not None:
        placement[:3, :3] = rotation_from_rpy(*(float(x) for x in origin.get("rpy", "0 0 0").split()))
        placement[:3, 3] = [float(x) for x in origin.get("xyz", "0 0 0").split()]
    return placement


def _numbers(values: np.ndarray | tuple[float, ...]) -> str:
    return " ".join(repr(float(value)) for value in values)


def set_origin(element: ET.Element, placement: np.ndarray) -> None:
    """Give an element the <origin> that `origin_of` reads back."""
    origin = element.find("origin")
    if origin is None:
        origin = ET.Element("origin")
        element.insert(0, origin)
    origin.set("xyz", _numbers(placement[:3, 3]))
    origin.set("rpy", _numbers(rpy_from_rotation(placement[:3, :3])))


@dataclass(frozen=True)
class Merged:
    """What a merge gave."""

    root: ET.Element
    """the URDF with moving joints, and the fixed ones that were kept, only"""
    home: dict[str, tuple[str, np.ndarray]]
    """every link of the original → the link that carries it now, and its pose (4, 4) in that link's frame"""


def _end(joint: ET.Element, end: str) -> str:
    element = joint.find(end)
    if element is None:
        raise ValueError(f"joint {joint.get('name')}: has no <{end}>")
    return element.get("link", "")


def root_link(robot: ET.Element) -> str:
    """The link that is nobody's child. Raises ValueError unless there is exactly one."""
    links = {link.get("name", "") for link in robot.findall("link")}
    roots = links - {_end(joint, "child") for joint in robot.findall("joint")}
    if len(roots) != 1:
        raise ValueError(f"expected one root link, got {', '.join(sorted(roots)) or 'none'}")
    return roots.pop()


def merge_fixed_links(robot: ET.Element, keep: Collection[str] = ()) -> Merged:
    """A URDF in which every joint moves, with the same dynamics, shapes and joints. `robot` is not changed.

    `keep`: links that stay links of their own although a fixed joint carries them (a force-torque sensor is cut there).

    Each link that is left keeps its name and frame; visual and collision shapes move with their links. What a joint carries
    besides type, origin, parent, child, axis and limit is dropped: friction and damping are the actuators' business here.
    Raises ValueError for a URDF that is no tree.
    """
    links = {link.get("name", ""): link for link in robot.findall("link")}
    below: dict[str, list[ET.Element]] = {}
    for joint in robot.findall("joint"):
        below.setdefault(_end(joint, "parent"), []).append(joint)
    merged = ET.Element("robot", name=robot.get("name", "robot"))
    merged.extend(robot.findall("material"))
    home: dict[str, tuple[str, np.ndarray]] = {}
    joints: list[ET.Element] = []

    def absorb(name: str, into: ET.Element, placement: np.ndarray, body: Inertial) -> Inertial:
        """Put link `name` and all that is fixed to it into the link `into`; moving joints below start links of their own."""
        carrier = into.get("name", "")
        home[name] = (carrier, placement)
        body = body + Inertial.of(links[name]).seen_from(placement)
        for tag in ("visual", "collision"):
            for shape in links[name].findall(tag):
                copy = ET.fromstring(ET.tostring(shape))
                set_origin(copy, placement @ origin_of(shape))
                into.append(copy)
        for joint in below.get(name, []):
            at = placement @ origin_of(joint)
            if joint.get("type") == "fixed" and _end(joint, "child") not in keep:
                body = absorb(_end(joint, "child"), into, at, body)
            else:
                moving = ET.Element("joint", name=joint.get("name", ""), type=joint.get("type", ""))
                set_origin(moving, at)
                ET.SubElement(moving, "parent", link=carrier)
                moving.extend(joint.findall("child") + joint.findall("axis") + joint.findall("limit"))
                joints.append(moving)
                start(_end(joint, "child"))
        return body

    def start(name: str) -> None:
        link = ET.SubElement(merged, "link", name=name)
        body = absorb(name, link, np.eye(4), Inertial(0.0, np.zeros(3), np.zeros((3, 3))))
        _write_inertial(link, body, is_root=name == root)

    root = root_link(robot)
    start(root)
    merged.extend(joints)
    return Merged(merged, home)


def _write_inertial(link: ET.Element, body: Inertial, *, is_root: bool) -> None:
    """About principal axes, since PyBullet finds those of a full tensor to six digits only; the root keeps its own axes,
    since PyBullet's inverse dynamics takes the base's inertial frame for the world's."""
    mass, tensor, placement = TINY_MASS, np.eye(3) * TINY_INERTIA, np.eye(4)
    if body.mass > 0.0:
        mass, tensor, placement[:3, 3] = body.mass, body.inertia, body.centre
        if not is_root:
            moments, axes = np.linalg.eigh(body.inertia)
            axes[:, 2] *= np.sign(np.linalg.det(axes))  # right-handed
            tensor, placement[:3, :3] = np.diag(moments), axes
    element = ET.Element("inertial")
    set_origin(element, placement)
    ET.SubElement(element, "mass", value=repr(float(mass)))
    entries = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    ET.SubElement(element, "inertia", {key: repr(float(tensor[at])) for key, at in entries.items()})
    link.insert(0, element)
