"""A template's objects on their joints: where each is, with numbers for parameters and joints."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from affordance_templates.expressions import ExpressionError
from affordance_templates.numbers import Names, Numbers, indexed
from affordance_templates.placement import Array, rotation_of
from affordance_templates.reference import Reference, refer
from affordance_templates.template import ResolvedJoint, Shape
from affordance_templates.template_schema import Colour, JointFile, MaterialFile, ObjectFile, ShapeFile

_SIZES: Mapping[str, int] = {"capsule": 2, "cylinder": 2, "box": 3, "sphere": 1, "torus": 2, "mesh": 3}
_MESHES = (".stl", ".obj", ".dae")
_MOST_SHAPES = 2000
_GREY: Colour = (0.55, 0.6, 0.65, 1.0)


@dataclass(frozen=True)
class _Part:
    """One object or joint of those that a file's entry means."""

    field: str
    entry: str
    names: Names


class Tree:
    """Objects and joints of one template, parameters having values. Everything raises config.ConfigError."""

    def __init__(
        self, numbers: Numbers, names: Names, objects: Mapping[str, ObjectFile], joints: Mapping[str, JointFile],
        materials: Mapping[str, MaterialFile],
    ):  # fmt: skip
        self._numbers, self._objects, self._joints, self._materials = numbers, objects, joints, materials
        self._names = names
        self._posed: dict[tuple[tuple[str, float], ...], Posed] = {}
        self._object_parts = self._parts("objects", objects)
        self._joint_parts = self._parts("joints", joints)

    def _parts(self, field: str, files: Mapping[str, ObjectFile] | Mapping[str, JointFile]) -> dict[str, _Part]:
        parts = {}
        for name, file in files.items():
            for indices, names in self._numbers.repeated(f"{field}.{name}", file.repeat, self._names):
                parts[indexed(name, indices)] = _Part(f"{field}.{name}", name, names)
        return parts

    @property
    def object_names(self) -> list[str]:
        """All objects', in the file's order."""
        return list(self._object_parts)

    def reference(self, field: str, text: str, names: Names) -> Reference:
        """A reference in a field, read."""
        try:
            return refer(text, names)
        except ExpressionError as problem:
            raise self._numbers.document.error(field, str(problem)) from problem

    def joint_name(self, field: str, text: str, names: Names) -> str:
        """The joint that a field means."""
        return self._known(field, self.reference(field, text, names).text, self._joint_parts, "joints")

    def object_name(self, field: str, text: str, names: Names) -> str:
        """The object that a field means."""
        return self._known(field, self.reference(field, text, names).text, self._object_parts, "objects")

    def _known(self, field: str, name: str, known: Mapping[str, _Part], kind: str) -> str:
        if name not in known:
            raise self._numbers.document.error(
                field, f"got {name!r}; expected one of {', '.join(known) or f'none: there are no {kind}'}"
            )
        return name

    def at(self, state: Mapping[str, float]) -> Posed:
        """With the joints at `state`, rad (m); those not named at 0."""
        key = tuple(state.items())
        if key not in self._posed:
            self._posed[key] = Posed(self, dict(state))
        return self._posed[key]


class Posed:
    """A tree with its joints at some state; frames are found once each, when they are asked for."""

    def __init__(self, tree: Tree, state: Mapping[str, float]):
        self._tree, self.state = tree, state
        self._numbers = tree._numbers
        self._frames: dict[str, Array | None] = {"": np.eye(4)}
        self._known_joints: dict[str, ResolvedJoint] = {}
        self.features: dict[object, Array] = {}
        """frames of features that were asked for, by their references"""

    @property
    def object_names(self) -> list[str]:
        """All objects'."""
        return self._tree.object_names

    def object_name(self, field: str, text: str, names: Names) -> str:
        """The object that a field means."""
        return self._tree.object_name(field, text, names)

    def frame(self, name: str) -> Array:
        """(4, 4) of an object in the template's frame."""
        if name not in self._frames:
            self._frames[name] = None
            self._frames[name] = self._object(name)
        found = self._frames[name]
        if found is None:
            part = self._tree._object_parts[name]
            raise self._numbers.document.error(part.field, "carries itself; expected a tree of parents and joints")
        return found

    def _object(self, name: str) -> Array:
        part = self._tree._object_parts[name]
        file, field = self._tree._objects[part.entry], part.field
        if file.parent and file.joint:
            raise self._numbers.document.error(
                f"{field}.parent", "there is a joint as well; expected one of both (a joint has a parent of its own)"
            )
        base = np.eye(4)
        if file.parent:
            base = self.frame(self._tree.object_name(f"{field}.parent", file.parent, part.names))
        elif file.joint:
            joint = self._tree.joint_name(f"{field}.joint", file.joint, part.names)
            resolved = self.joint(joint)
            base = resolved.displacement(resolved.position) @ self._carrier(joint)
        return base @ self._numbers.placement(field, file.position, file.rpy, part.names)

    def _carrier(self, joint: str) -> Array:
        """(4, 4): the frame that a joint's axis and origin are said in."""
        part = self._tree._joint_parts[joint]
        parent = self._tree._joints[part.entry].parent
        if not parent:
            return np.eye(4)
        return self.frame(self._tree.object_name(f"{part.field}.parent", parent, part.names))

    def joint(self, name: str) -> ResolvedJoint:
        """A joint in the template's frame."""
        if name not in self._known_joints:
            self._known_joints[name] = self._joint(name)
        return self._known_joints[name]

    def _joint(self, name: str) -> ResolvedJoint:
        part = self._tree._joint_parts[name]
        field, joint, numbers = part.field, self._tree._joints[part.entry], self._numbers
        endless = joint.kind == "continuous"
        bounds = []
        for side, text, unbounded in (("lower", joint.lower, -math.inf), ("upper", joint.upper, math.inf)):
            if endless != (text is None):
                wanted = "none" if endless else "a number"
                raise numbers.document.error(f"{field}.{side}", f"a {joint.kind} joint; expected {wanted}")
            bounds.append(unbounded if text is None else numbers.number(f"{field}.{side}", text, part.names))
        if bounds[0] > bounds[1]:
            raise numbers.document.error(f"{field}.lower", f"got {bounds[0]:g}; expected at most upper, {bounds[1]:g}")
        pitch = numbers.number(f"{field}.pitch", joint.pitch, part.names)
        if pitch and joint.kind == "prismatic":
            raise numbers.document.error(f"{field}.pitch", "a prismatic joint; expected none")
        carrier = self._carrier(name)
        origin = numbers.vector(f"{field}.origin", joint.origin, part.names)
        return ResolvedJoint(
            name=name,
            kind=joint.kind,
            axis=carrier[:3, :3] @ numbers.direction(f"{field}.axis", joint.axis, part.names),
            origin=carrier[:3, :3] @ origin + carrier[:3, 3],
            position=float(self.state.get(name, 0.0)),
            lower=bounds[0],
            upper=bounds[1],
            pitch=pitch,
        )

    def joints(self) -> dict[str, ResolvedJoint]:
        """All of them."""
        return {name: self.joint(name) for name in self._tree._joint_parts}

    def frames(self) -> dict[str, Array]:
        """All objects'."""
        return {name: self.frame(name) for name in self._tree._object_parts}

    def shapes(self) -> list[Shape]:
        """All objects' solids."""
        found: list[Shape] = []
        for name, part in self._tree._object_parts.items():
            base = self.frame(name)
            for k, shape in enumerate(self._tree._objects[part.entry].shapes):
                field = f"{part.field}.shapes[{k}]"
                found.extend(self._shapes(field, shape, part, name, base))
            if len(found) > _MOST_SHAPES:
                raise self._numbers.document.error(part.field, f"more than {_MOST_SHAPES} shapes; expected fewer")
        return found

    def _shapes(self, field: str, shape: ShapeFile, part: _Part, name: str, base: Array) -> list[Shape]:
        numbers = self._numbers
        sizes = shape.size or ([1, 1, 1] if shape.kind == "mesh" else [])
        if len(sizes) != _SIZES[shape.kind]:
            raise numbers.document.error(
                f"{field}.size", f"got {len(sizes)} numbers; expected {_SIZES[shape.kind]} of a {shape.kind}"
            )
        file, color = self._mesh(field, shape), self._color(field, shape, part)
        found = []
        for _, names in numbers.repeated(field, shape.repeat, part.names):
            size = tuple(numbers.number(f"{field}.size[{i}]", text, names) for i, text in enumerate(sizes))
            if min(size) <= 0:
                raise numbers.document.error(f"{field}.size", f"got {list(size)} m; expected all above 0")
            pose = np.eye(4)
            if tuple(shape.rpy) != (0, 0, 0):
                pose[:3, :3] = rotation_of(numbers.vector(f"{field}.rpy", shape.rpy, names))
            pose[:3, 3] = numbers.vector(f"{field}.position", shape.position, names)
            found.append(Shape(shape.kind, size, base @ pose, name, color, file))
        return found

    def _color(self, field: str, shape: ShapeFile, part: _Part) -> Colour:
        if shape.color is not None:
            return shape.color
        entry = self._tree._objects[part.entry]
        for where, material in ((f"{field}.material", shape.material), (f"{part.field}.material", entry.material)):
            if material:
                known = self._tree._materials
                if material not in known:
                    raise self._numbers.document.error(
                        where, f"got {material!r}; expected one of {', '.join(known) or 'none: materials names them'}"
                    )
                return known[material].color
        return _GREY

    def _mesh(self, field: str, shape: ShapeFile) -> Path | None:
        document = self._numbers.document
        if shape.kind != "mesh":
            if shape.file:
                raise document.error(f"{field}.file", f"a {shape.kind}; expected none, only a mesh has a file")
            return None
        given = Path(shape.file)
        if not shape.file or given.is_absolute() or ".." in given.parts or given.suffix.lower() not in _MESHES:
            raise document.error(
                f"{field}.file",
                f"got {shape.file!r}; expected a {', '.join(_MESHES)} file beside the template's or below",
            )
        file = document.file.parent / given
        if not file.is_file():
            raise document.error(f"{field}.file", f"no such file: {file}")
        return file
