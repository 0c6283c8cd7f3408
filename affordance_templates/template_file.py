"""A template's file: parameters, objects, joints and trajectories, with expressions where numbers may depend on parameters.

`read` checks a file whole (every expression is evaluated with the parameters' defaults), so that what loads also resolves; errors
name file, line, field, value and expectation. `Template.resolve` puts numbers in.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from affordance_templates import expressions
from affordance_templates.expressions import ExpressionError
from affordance_templates.template import (
    Array,
    Entry,
    ResolvedJoint,
    ResolvedTemplate,
    ResolvedTrajectory,
    ResolvedWaypoint,
    Shape,
)
from affordance_templates.template_schema import (
    EntryFile,
    JointFile,
    Number,
    ObjectFile,
    Parameter,
    TemplateFile,
    TrajectoryFile,
    Triple,
    WaypointFile,
)
from handrail import config

_T = TypeVar("_T")
_MOST_REPEATS = 200
_SIZES: Mapping[str, int] = {"capsule": 2, "cylinder": 2, "box": 3, "sphere": 1, "torus": 2}


@dataclass(frozen=True)
class Template:
    """A template of the library, checked."""

    name: str
    title: str
    hash: str
    """of the file's content"""
    parameters: Mapping[str, Parameter]
    document: config.Document
    _definitions: Mapping[str, Number]
    _objects: Mapping[str, ObjectFile]
    _joints: Mapping[str, JointFile]
    _trajectories: Mapping[str, TrajectoryFile]

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the degrees of freedom."""
        return tuple(self._joints)

    def values(self, given: Mapping[str, float]) -> dict[str, float]:
        """Every parameter's value, those given over the defaults. Raises ValueError naming parameter, value and expectation."""
        for name, value in given.items():
            if problem := self.problem(name, value):
                raise ValueError(f"{name}: {problem}")
        return {name: float(given.get(name, parameter.default)) for name, parameter in self.parameters.items()}

    def problem(self, name: str, value: float) -> str:
        """Why a parameter can't have this value; empty when it can."""
        parameter = self.parameters.get(name)
        if parameter is None:
            return f"no such parameter; expected one of {', '.join(self.parameters)}"
        unit = f" {parameter.unit}" if parameter.unit else ""
        if not math.isfinite(value) or not parameter.min <= value <= parameter.max:
            return f"got {value:g}{unit}; expected {parameter.min:g} to {parameter.max:g}{unit}"
        if parameter.integer and value != round(value):
            return f"got {value:g}{unit}; expected a whole number"
        return ""

    def resolve(
        self, parameters: Mapping[str, float] | None = None, joint_state: Mapping[str, float] | None = None
    ) -> ResolvedTemplate:
        """The template with numbers.

        :param parameters: those that differ from the defaults, in the file's units
        :param joint_state: joint → rad (prismatic: m); joints not named are at 0
        :raises ValueError: on an unknown parameter, or a value out of bounds
        :raises config.ConfigError: where the file's expressions have no value with these parameters
        """
        names = self.values(parameters or {})
        for name, text in self._definitions.items():
            names[name] = self._number(f"definitions.{name}", text, names)
        joints = {name: self._joint(name, names, joint_state or {}) for name in self._joints}
        shapes = [shape for name in self._objects for shape in self._shapes(name, names, joints)]
        trajectories = {name: self._trajectory(name, names) for name in self._trajectories}
        return ResolvedTemplate(tuple(shapes), joints, trajectories)

    def _number(self, field: str, text: Number, names: Mapping[str, float]) -> float:
        try:
            return expressions.evaluate(text, names)
        except ExpressionError as problem:
            raise self.document.error(field, str(problem)) from problem

    def _vector(self, field: str, texts: Triple, names: Mapping[str, float]) -> Array:
        return np.array([self._number(f"{field}[{k}]", text, names) for k, text in enumerate(texts)])

    def _direction(self, field: str, texts: Triple, names: Mapping[str, float]) -> Array:
        vector = self._vector(field, texts, names)
        length = float(np.linalg.norm(vector))
        if length < 1e-9:
            raise self.document.error(field, f"got {vector.tolist()}; expected a vector with a direction")
        return vector / length

    def _repeated(self, field: str, repeat: Mapping[str, Number], names: Mapping[str, float]) -> list[dict[str, float]]:
        """The names with the running index added, once per repetition."""
        if not repeat:
            return [dict(names)]
        if len(repeat) != 1:
            raise self.document.error(f"{field}.repeat", f"got {len(repeat)} indices; expected one, e.g. {{i: spokes}}")
        index, text = next(iter(repeat.items()))
        count = self._number(f"{field}.repeat.{index}", text, names)
        if count != round(count) or not 1 <= count <= _MOST_REPEATS:
            raise self.document.error(
                f"{field}.repeat.{index}", f"got {count:g}; expected a whole number, 1 to {_MOST_REPEATS}"
            )
        return [{**names, index: float(k)} for k in range(int(count))]

    def _joint(self, name: str, names: Mapping[str, float], state: Mapping[str, float]) -> ResolvedJoint:
        field, joint = f"joints.{name}", self._joints[name]
        endless = joint.kind == "continuous"
        bounds = []
        for side, text, unbounded in (("lower", joint.lower, -math.inf), ("upper", joint.upper, math.inf)):
            if endless != (text is None):
                wanted = "none" if endless else "a number"
                raise self.document.error(f"{field}.{side}", f"a {joint.kind} joint; expected {wanted}")
            bounds.append(unbounded if text is None else self._number(f"{field}.{side}", text, names))
        return ResolvedJoint(
            name=name,
            kind=joint.kind,
            axis=self._direction(f"{field}.axis", joint.axis, names),
            origin=self._vector(f"{field}.origin", joint.origin, names),
            position=float(state.get(name, 0.0)),
            lower=bounds[0],
            upper=bounds[1],
        )

    def _shapes(self, name: str, names: Mapping[str, float], joints: Mapping[str, ResolvedJoint]) -> list[Shape]:
        thing = self._objects[name]
        if thing.joint and thing.joint not in joints:
            raise self.document.error(
                f"objects.{name}.joint", f"got {thing.joint!r}; expected one of {', '.join(joints)}"
            )
        moved = _displacement(joints[thing.joint]) if thing.joint else np.eye(4)
        shapes = []
        for k, shape in enumerate(thing.shapes):
            field = f"objects.{name}.shapes[{k}]"
            if len(shape.size) != _SIZES[shape.kind]:
                raise self.document.error(
                    f"{field}.size", f"got {len(shape.size)} numbers; a {shape.kind} has {_SIZES[shape.kind]}"
                )
            for each in self._repeated(field, shape.repeat, names):
                size = tuple(self._number(f"{field}.size[{i}]", text, each) for i, text in enumerate(shape.size))
                if min(size) <= 0:
                    raise self.document.error(f"{field}.size", f"got {list(size)} m; expected all above 0")
                pose = np.eye(4)
                pose[:3, :3] = _rotation(self._vector(f"{field}.rpy", shape.rpy, each))
                pose[:3, 3] = self._vector(f"{field}.position", shape.position, each)
                shapes.append(Shape(shape.kind, size, moved @ pose, name, shape.color))
        return shapes

    def _trajectory(self, name: str, names: Mapping[str, float]) -> ResolvedTrajectory:
        field, trajectory = f"trajectories.{name}", self._trajectories[name]
        entry = self._entry(f"{field}.entry", trajectory.entry, names) if trajectory.entry else None
        waypoints: list[ResolvedWaypoint] = []
        for k, waypoint in enumerate(trajectory.waypoints):
            waypoints.append(self._waypoint(f"{field}.waypoints[{k}]", waypoint, names, entry))
            if any(waypoint.name == other.name for other in waypoints[:-1]):
                raise self.document.error(
                    f"{field}.waypoints[{k}].name", f"{waypoint.name!r} is there twice; expected one"
                )
        return ResolvedTrajectory(name, entry, tuple(waypoints))

    def _entry(self, field: str, entry: EntryFile, names: Mapping[str, float]) -> Entry:
        self._known_joint(f"{field}.joint", entry.joint)
        avoid: tuple[float, ...] = ()
        if entry.avoid is not None:
            repeated = self._repeated(f"{field}.avoid", entry.avoid.repeat, names)
            avoid = tuple(self._number(f"{field}.avoid.angle", entry.avoid.angle, each) for each in repeated)
        return Entry(
            joint=entry.joint,
            span=self._positive(f"{field}.span", entry.span, names),
            avoid=avoid,
            clearance=self._number(f"{field}.clearance", entry.clearance, names),
            contact_offset=self._number(f"{field}.contact_offset", entry.contact_offset, names),
        )

    def _waypoint(
        self, field: str, waypoint: WaypointFile, names: Mapping[str, float], entry: Entry | None
    ) -> ResolvedWaypoint:
        to: Any = 0.0
        if waypoint.approach == "along":
            self._known_joint(f"{field}.joint", waypoint.joint)
            to = "arc_end" if waypoint.to == "arc_end" else self._number(f"{field}.to", waypoint.to, names)
            if to == "arc_end" and entry is None:
                raise self.document.error(
                    f"{field}.to", "arc_end, but the trajectory has no entry; expected one, or an angle"
                )
        force = waypoint.path_force
        return ResolvedWaypoint(
            name=waypoint.name,
            position=self._vector(f"{field}.position", waypoint.position, names),
            axis=self._direction(f"{field}.axis", waypoint.axis, names),
            approach=waypoint.approach,
            joint=waypoint.joint,
            to=to,
            guard=None if waypoint.guard is None else self._positive(f"{field}.guard", waypoint.guard, names),
            path_force=None
            if force is None
            else (
                self._positive(f"{field}.path_force.gain", force.gain, names),
                self._positive(f"{field}.path_force.limit", force.limit, names),
            ),
            duration=self._number(f"{field}.duration", waypoint.duration, names),
        )

    def _positive(self, field: str, text: Number, names: Mapping[str, float]) -> float:
        value = self._number(field, text, names)
        if value <= 0:
            raise self.document.error(field, f"got {value:g}; expected above 0")
        return value

    def _known_joint(self, field: str, joint: str) -> None:
        if joint not in self._joints:
            raise self.document.error(
                field, f"got {joint!r}; expected one of the joints: {', '.join(self._joints) or 'none'}"
            )


def read(file: Path | str) -> Template:
    """Read and check a template's file; its name is the file's. Raises config.ConfigError."""
    document = config.read(file)
    whole = document.convert(TemplateFile)
    template = Template(
        name=Path(file).stem,
        title=whole.title,
        hash=hashlib.sha256(Path(file).read_bytes()).hexdigest()[:16],
        parameters=_each(document, "parameters", whole.parameters, Parameter),
        document=document,
        _definitions=whole.definitions,
        _objects=_each(document, "objects", whole.objects, ObjectFile),
        _joints=_each(document, "joints", whole.joints, JointFile),
        _trajectories=_each(document, "trajectories", whole.trajectories, TrajectoryFile),
    )
    for name, parameter in template.parameters.items():
        if problem := template.problem(name, parameter.default):
            raise document.error(f"parameters.{name}.default", problem)
    for name in (*template.parameters, *whole.definitions):
        if not name.isidentifier() or name in expressions.CONSTANTS or name in expressions.FUNCTIONS:
            where = "parameters" if name in template.parameters else "definitions"
            raise document.error(f"{where}.{name}", f"{name!r} can't be used in expressions; expected another name")
    template.resolve()
    return template


def _each(document: config.Document, field: str, parts: Mapping[str, Any], kind: type[_T]) -> dict[str, _T]:
    """Convert a mapping's values one by one, so that an error knows its key and line."""
    return {name: document.convert(kind, f"{field}.{name}") for name in parts}


def _rotation(rpy: Array) -> Array:
    """(3, 3) rotation of URDF's roll, pitch, yaw: about the fixed x, then y, then z axis."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(rpy), np.cos(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _displacement(joint: ResolvedJoint) -> Array:
    """(4, 4) motion of what hangs on a joint, from position 0 to its present one."""
    moved = np.eye(4)
    if joint.kind == "prismatic":
        moved[:3, 3] = joint.axis * joint.position
        return moved
    x, y, z = joint.axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned = np.eye(3) + math.sin(joint.position) * cross + (1 - math.cos(joint.position)) * cross @ cross
    moved[:3, :3] = turned
    moved[:3, 3] = joint.origin - turned @ joint.origin
    return moved
