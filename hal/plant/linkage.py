"""Things with joints of their own in a scene: a door with its handle and latch, buttons on springs, a cap on its thread.

A scene names such a thing's links, each on a joint to its parent (the base, where none is named)::

    door:
      kind: linkage
      pose_in_world: {position: [0.6, 0.2, 0.2]}
      links:
        hinge: {joint: {kind: revolute, axis: [0, 0, 1], lower: 0, upper: 1.9, friction: 1.0}, mass: 8, shapes: [...]}
        latch: {parent: hinge, joint: {kind: revolute, axis: [-1, 0, 0], upper: 0.7, stiffness: 1.5, rest: -0.3}, shapes: [...]}
      latches: [{holds: hinge, freed_by: latch, beyond: 0.5}]

Joints have their links' names; the ground truth has them as ``door.hinge``. A link's frame is at its joint, turned as its
parent's at position 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Annotated, Literal

import msgspec
import numpy as np

from hal.plant.bullet import pybullet as p
from hal.plant.merge import rotation_from_rpy

Vector = tuple[float, float, float]
NonNegative = Annotated[float, msgspec.Meta(ge=0)]
_SIZES = {"box": 3, "cylinder": 2, "capsule": 2, "sphere": 1}
_LEAST = 1e-6
"""kg·m², of a link's inertia"""
_BASE = "base"
_THREAD_FORCE, _THREAD_GAIN = 1e4, 0.3


class LinkShape(msgspec.Struct, kw_only=True, forbid_unknown_fields=True, frozen=True):
    """A solid of a link, in the link's frame."""

    kind: Literal["box", "cylinder", "capsule", "sphere"]
    size: tuple[Annotated[float, msgspec.Meta(gt=0, le=20)], ...]
    """m. box: full edges; cylinder, capsule: radius, length along z (a capsule's without its caps); sphere: radius"""
    position: Vector = (0.0, 0.0, 0.0)
    rpy_deg: Vector = (0.0, 0.0, 0.0)
    color: tuple[float, float, float, float] = (0.55, 0.57, 0.6, 1.0)


class LinkJoint(msgspec.Struct, kw_only=True, forbid_unknown_fields=True, frozen=True):
    """A link's joint. Revolute and prismatic ones have limits, continuous ones none."""

    kind: Literal["revolute", "continuous", "prismatic"]
    axis: Vector
    origin: Vector = (0.0, 0.0, 0.0)
    """m, in the parent's frame"""
    lower: float = 0.0
    upper: float = 0.0
    """rad or m"""
    friction: NonNegative = 0.0
    """N·m or N, Coulomb"""
    stiffness: NonNegative = 0.0
    """N·m/rad or N/m, of a spring"""
    rest: float = 0.0
    """rad or m, where the spring is slack"""
    position: float = 0.0
    """rad or m, at the start"""


class Link(msgspec.Struct, kw_only=True, forbid_unknown_fields=True, frozen=True):
    """What moves with a joint."""

    joint: LinkJoint
    parent: str = ""
    mass: Annotated[float, msgspec.Meta(ge=0.001, le=1000)] = 0.5
    """kg, spread over the box about its shapes"""
    shapes: tuple[LinkShape, ...] = ()


class Latch(msgspec.Struct, kw_only=True, forbid_unknown_fields=True, frozen=True):
    """Holds a joint near a position while another one has not gone far enough."""

    holds: str
    freed_by: str
    beyond: float
    """rad or m of the freeing joint"""
    at: float = 0.0
    """rad or m of the held joint"""
    within: NonNegative = 0.02
    """rad or m about that: where it catches"""
    strength: NonNegative = 300.0
    """N·m or N"""


class Thread(msgspec.Struct, kw_only=True, forbid_unknown_fields=True, frozen=True):
    """A sliding joint that goes with a turning one, the slider's link carrying the turner's, or the other way round."""

    turning: str
    sliding: str
    pitch: float
    """m a turn"""


def problem(links: Mapping[str, Link], latches: Iterable[Latch], threads: Iterable[Thread]) -> tuple[str, str] | None:
    """What is wrong with a linkage: field and expectation; None: nothing."""
    for name, link in links.items():
        field = f"links.{name}"
        if not name.isidentifier() or name == _BASE:
            return (
                field,
                f"expected a name of letters, digits and underscores, and not {_BASE}: what carries it is called that",
            )
        seen, at = {name}, link.parent
        while at:
            if at not in links:
                return f"{field}.parent", f"got {at!r}; expected one of {', '.join(links)}"
            if at in seen:
                return f"{field}.parent", f"{at} carries itself; expected a tree"
            seen.add(at)
            at = links[at].parent
        joint = link.joint
        if not any(joint.axis):
            return f"{field}.joint.axis", "got no direction; expected one"
        if joint.kind == "continuous":
            if joint.lower or joint.upper:
                return f"{field}.joint.upper", "is continuous; expected no limits"
        elif not joint.lower < joint.upper:
            return f"{field}.joint.upper", f"got {joint.upper:g}; expected more than lower, {joint.lower:g}"
        elif not joint.lower <= joint.position <= joint.upper:
            return f"{field}.joint.position", f"got {joint.position:g}; expected {joint.lower:g} to {joint.upper:g}"
        for k, shape in enumerate(link.shapes):
            if wrong := shape_problem(shape):
                return f"{field}.shapes[{k}].size", wrong
    for k, latch in enumerate(latches):
        for field in ("holds", "freed_by"):
            if getattr(latch, field) not in links:
                return f"latches[{k}].{field}", f"got {getattr(latch, field)!r}; expected one of {', '.join(links)}"
    for k, thread in enumerate(threads):
        for field, slides in (("turning", False), ("sliding", True)):
            name = getattr(thread, field)
            if name not in links or (links[name].joint.kind == "prismatic") != slides:
                kind = "a prismatic" if slides else "a turning"
                return f"threads[{k}].{field}", f"got {name!r}; expected a link on {kind} joint"
    return None


def shape_problem(shape: LinkShape) -> str:
    """What is wrong with a shape's size; empty: nothing."""
    wanted = _SIZES[shape.kind]
    return "" if len(shape.size) == wanted else f"got {len(shape.size)} numbers; a {shape.kind} has {wanted}"


def urdf(name: str, mass: float | None, base: Iterable[LinkShape], links: Mapping[str, Link]) -> str:
    """The whole as a body; a loose base's frame (one with a mass) is its centre of mass."""
    base = tuple(base)
    size = np.ptp(_corners(base), axis=0) if base else np.full(3, 0.1)
    parts = [f'<link name="{_BASE}">{_inertial(mass or 1.0, np.zeros(3), size)}{"".join(map(_solid, base))}</link>']
    for link_name, link in links.items():
        corners = _corners(link.shapes) if link.shapes else np.zeros((2, 3))
        centre, size = corners.mean(axis=0), np.ptp(corners, axis=0)
        solids = "".join(map(_solid, link.shapes))
        parts.append(f'<link name="{link_name}">{_inertial(link.mass, centre, size)}{solids}</link>')
        joint = link.joint
        limit = (
            ""
            if joint.kind == "continuous"
            else f'<limit lower="{joint.lower}" upper="{joint.upper}" effort="1e6" velocity="1e3"/>'
        )
        parts.append(
            f'<joint name="{link_name}" type="{joint.kind}"><parent link="{link.parent or _BASE}"/><child link="{link_name}"/>'
            f'<origin xyz="{_words(joint.origin)}"/><axis xyz="{_words(joint.axis)}"/>{limit}</joint>'
        )
    return f'<robot name="{name}">{"".join(parts)}</robot>'


def _words(numbers: Iterable[float]) -> str:
    return " ".join(repr(float(number)) for number in numbers)


def _inertial(mass: float, centre: np.ndarray, size: np.ndarray) -> str:
    """Of a full box of that size about its centre."""
    xx, yy, zz = np.maximum(mass * (np.sum(size**2) - size**2) / 12, _LEAST).tolist()
    return (
        f'<inertial><origin xyz="{_words(centre)}"/><mass value="{mass}"/>'
        f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial>'
    )


def _corners(shapes: Iterable[LinkShape]) -> np.ndarray:
    """(2, 3) m, least and largest of the boxes about the shapes."""
    found = []
    for shape in shapes:
        match shape.kind:
            case "box":
                half = np.array(shape.size) / 2
            case "sphere":
                half = np.full(3, shape.size[0])
            case _:
                ends = shape.size[0] if shape.kind == "capsule" else 0.0
                half = np.array([shape.size[0], shape.size[0], shape.size[1] / 2 + ends])
        reach = np.abs(rotation_from_rpy(*np.radians(shape.rpy_deg))) @ half
        found += [np.array(shape.position) - reach, np.array(shape.position) + reach]
    return np.array([np.min(found, axis=0), np.max(found, axis=0)])


def _solid(shape: LinkShape) -> str:
    match shape.kind:
        case "box":
            geometry = f'<box size="{_words(shape.size)}"/>'
        case "sphere":
            geometry = f'<sphere radius="{shape.size[0]}"/>'
        case _:
            geometry = f'<{shape.kind} radius="{shape.size[0]}" length="{shape.size[1]}"/>'
    origin = f'<origin xyz="{_words(shape.position)}" rpy="{_words(np.radians(shape.rpy_deg))}"/>'
    colour = _words(shape.color)
    inside = f"{origin}<geometry>{geometry}</geometry>"
    return (
        f"<collision>{inside}</collision>"
        f'<visual>{inside}<material name="{colour}"><color rgba="{colour}"/></material></visual>'
    )


class LinkageBody:
    """A linkage in PyBullet: its springs, friction, latches and threads."""

    def __init__(
        self, client: int, body: int, links: Mapping[str, Link], latches: Iterable[Latch], threads: Iterable[Thread]
    ):  # fmt: skip
        self._client, self._body = client, body
        self.rows = joint_rows(client, body)
        """joint → PyBullet's index"""
        self._joints = {name: link.joint for name, link in links.items()}
        self._sprung = [name for name, joint in self._joints.items() if joint.stiffness]
        self._latches: dict[str, list[Latch]] = {}
        """held joint → what may hold it"""
        for latch in latches:
            self._latches.setdefault(latch.holds, []).append(latch)
        self._holding: dict[str, float] = {}
        """held joint → N·m or N"""
        self.pushes: dict[str, float] = {}
        """joint → N·m or N from outside, at every step (for tests and exercises)"""
        for name, joint in self._joints.items():
            p.resetJointState(body, self.rows[name], joint.position, physicsClientId=client)
            self._hold(name, joint.friction)
        for thread in threads:
            self._couple(thread)

    def _hold(self, joint: str, strength: float) -> None:
        """A motor that wants to stand still, and may use so much force for it, is Coulomb friction."""
        p.setJointMotorControl2(
            self._body, self.rows[joint], p.VELOCITY_CONTROL, targetVelocity=0, force=strength,
            physicsClientId=self._client,
        )  # fmt: skip

    def _couple(self, thread: Thread) -> None:
        gear = p.createConstraint(
            self._body, self.rows[thread.sliding], self._body, self.rows[thread.turning], p.JOINT_GEAR, (1, 0, 0),
            (0, 0, 0), (0, 0, 0), physicsClientId=self._client,
        )  # fmt: skip
        start = self._joints[thread.sliding].position
        ratio = thread.pitch / (2 * math.pi)
        offset = start - ratio * self._joints[thread.turning].position
        # PyBullet's gear keeps: slider + gearRatio · turner = relativePositionTarget.
        p.changeConstraint(
            gear, gearRatio=-ratio, relativePositionTarget=offset, erp=_THREAD_GAIN, maxForce=_THREAD_FORCE,
            physicsClientId=self._client,
        )  # fmt: skip

    def position(self, joint: str) -> float:
        """rad or m"""
        return p.getJointState(self._body, self.rows[joint], physicsClientId=self._client)[0]

    def place(self, joint: str, position: float) -> None:
        """Put a joint somewhere, at rest (for pictures and tests)."""
        p.resetJointState(self._body, self.rows[joint], position, physicsClientId=self._client)

    def work(self) -> None:
        """Before a step: springs pull, latches catch and free."""
        for name in {*self._sprung, *self.pushes}:
            joint = self._joints[name]
            pull = joint.stiffness * (joint.rest - self.position(name)) + self.pushes.get(name, 0.0)
            p.setJointMotorControl2(
                self._body, self.rows[name], p.TORQUE_CONTROL, force=pull, physicsClientId=self._client
            )
        for held, latches in self._latches.items():
            strengths = [latch.strength for latch in latches if self._caught(latch)]
            strength = max(strengths, default=self._joints[held].friction)
            if strength != self._holding.get(held):
                self._holding[held] = strength
                self._hold(held, strength)

    def _caught(self, latch: Latch) -> bool:
        near = abs(self.position(latch.holds) - latch.at) <= latch.within
        return near and self.position(latch.freed_by) <= latch.beyond


def joint_rows(client: int, body: int) -> dict[str, int]:
    """A body's joints by name."""
    count = p.getNumJoints(body, physicsClientId=client)
    return {p.getJointInfo(body, k, physicsClientId=client)[1].decode(): k for k in range(count)}
