"""A template's file: parameters, objects, joints, features, trajectories, with expressions where numbers may depend on parameters.

`read` checks a file whole (every expression is evaluated with the parameters' defaults), so that what loads also resolves; errors
name file, line, field, value and expectation. `Template.resolve` puts numbers in.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

from affordance_templates.features import Features
from affordance_templates.numbers import Names, Numbers, usable
from affordance_templates.template import ResolvedTemplate
from affordance_templates.template_schema import (
    PARTS,
    FeatureFile,
    JointFile,
    MaterialFile,
    ObjectFile,
    Parameter,
    SyncFile,
    TemplateFile,
    TrajectoryFile,
)
from affordance_templates.trajectories import Trajectories, synchronised
from affordance_templates.tree import Tree
from handrail import config

_MOST_NODES = 50_000
"""of a file's fields, those that aliases repeat counted each time"""


@dataclass(frozen=True)
class Template:
    """A template of the library, checked."""

    name: str
    title: str
    hash: str
    """of the file's content, and of its meshes'"""
    parameters: Mapping[str, Parameter]
    document: config.Document
    file: TemplateFile
    objects: Mapping[str, ObjectFile]
    joints: Mapping[str, JointFile]
    features: Mapping[str, FeatureFile]
    trajectories: Mapping[str, TrajectoryFile]
    materials: Mapping[str, MaterialFile]
    sync: Mapping[str, SyncFile]

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
        if parameter.choices and value not in parameter.choices:
            return f"got {value:g}{unit}; expected one of {', '.join(f'{each:g}' for each in parameter.choices)}"
        return ""

    @property
    def hands(self) -> tuple[str, ...]:
        """The abstract hands that its trajectories are for, in the file's order."""
        return tuple(dict.fromkeys(trajectory.hand for trajectory in self.trajectories.values()))

    def resolve(
        self, parameters: Mapping[str, float] | None = None, joint_state: Mapping[str, float] | None = None
    ) -> ResolvedTemplate:
        """The template with numbers.

        :param parameters: those that differ from the defaults, in the file's units
        :param joint_state: joint → rad (prismatic: m); joints not named are at 0
        :raises ValueError: on an unknown parameter, or a value out of bounds
        :raises config.ConfigError: where the file's expressions have no value with these parameters
        """
        numbers = Numbers(self.document)
        names = self._names(numbers, self.values(parameters or {}))
        tree = Tree(numbers, names, self.objects, self.joints, self.materials)
        features = Features(numbers, names, self.features)
        try:
            posed = tree.at(joint_state or {})
            shapes = tuple(posed.shapes())
            trajectories = Trajectories(numbers, names, tree, features, self.trajectories).resolved(posed.state)
            return ResolvedTemplate(
                shapes=shapes,
                joints=posed.joints(),
                trajectories=trajectories,
                objects=posed.frames(),
                features=features.described(posed),
                syncs=synchronised(numbers, self.sync, trajectories),
                _frame=partial(features.frame, posed=posed),
            )
        except RecursionError as problem:
            raise self.document.error("objects", "nested too deeply; expected fewer parents of parents") from problem

    def _names(self, numbers: Numbers, values: Mapping[str, float]) -> Names:
        """Parameters and definitions."""
        names = dict(values)
        for name, text in self.file.definitions.items():
            names[name] = numbers.number(f"definitions.{name}", text, names)
        return names


def read(file: Path | str) -> Template:
    """Read and check a template's file; its name is the file's. Raises config.ConfigError."""
    file = Path(file)
    try:
        content = file.read_bytes()
    except OSError:
        config.read(file)  # says what is wrong
        raise
    template = _kept(file, content)
    return of(template.document, content) if any(s.kind == "mesh" for s in template.resolve().shapes) else template


@lru_cache(maxsize=64)
def _kept(file: Path, content: bytes) -> Template:
    """Of the same text the same template: reading YAML is what takes long."""
    try:
        return of(config.parse(content.decode(), file), content)
    except UnicodeDecodeError as problem:
        raise config.ConfigError(file, None, "", f"can't be read: {problem}") from problem


def of(document: config.Document, content: bytes) -> Template:
    """Check a template's document, parsed from `content`; its name is the file's. Raises config.ConfigError."""
    _bounded(document)
    whole = document.convert(TemplateFile)
    parts = {field: _each(document, field, getattr(whole, field), kind) for field, kind in PARTS.items()}
    template = Template(
        name=document.file.stem,
        title=whole.title,
        hash="",
        document=document,
        file=whole,
        **parts,
    )
    for name, parameter in template.parameters.items():
        field = f"parameters.{name}"
        for bound in ("default", "min", "max", "step"):
            value = getattr(parameter, bound)
            if value is not None and math.isnan(value):
                raise document.error(f"{field}.{bound}", f"got {value}; expected a number")
        if problem := template.problem(name, parameter.default):
            raise document.error(f"{field}.default", problem)
    _check_names(document, template)
    resolved = template.resolve()
    whole_content = hashlib.sha256(content)
    for mesh in sorted({shape.file for shape in resolved.shapes if shape.file is not None}):
        whole_content.update(mesh.read_bytes())
    return replace(template, hash=whole_content.hexdigest()[:16])


def _bounded(document: config.Document) -> None:
    """Refuse what would take long to read: aliases of aliases of aliases."""
    left, nodes = _MOST_NODES, [document.data]
    while nodes:
        node = nodes.pop()
        left -= 1
        if left < 0:
            raise document.error(
                "", f"more than {_MOST_NODES} fields, those of aliases counted each time; expected fewer"
            )
        if isinstance(node, dict):
            nodes.extend(node.values())
        elif isinstance(node, list):
            nodes.extend(node)


def _check_names(document: config.Document, template: Template) -> None:
    for where in ("parameters", "definitions"):
        for name in getattr(template.file, where):
            if not usable(name):
                raise document.error(f"{where}.{name}", f"{name!r} can't be used in expressions; expected another name")
    for where in ("objects", "joints", "features", "trajectories"):
        for name in getattr(template.file, where):
            if not name.isidentifier():
                raise document.error(f"{where}.{name}", f"{name!r}; expected a name of letters, digits and underscores")
    for name in template.file.definitions:
        if name in template.parameters:
            raise document.error(f"definitions.{name}", "is a parameter as well; expected a name of its own")
    for name in template.objects:
        if name in template.features:
            raise document.error(f"features.{name}", "is an object as well; expected a name of its own")
    for name, thing in template.objects.items():
        for axis, parameter in thing.editable.items():
            if parameter not in template.parameters:
                raise document.error(
                    f"objects.{name}.editable.{axis}",
                    f"got {parameter!r}; expected one of the parameters: {', '.join(template.parameters) or 'none'}",
                )


def _each(document: config.Document, field: str, parts: Mapping[str, Any], kind: type[Any]) -> dict[str, Any]:
    """Convert a mapping's values one by one, so that an error knows its key and line."""
    return {name: document.convert(kind, f"{field}.{name}") for name in parts}
