"""Templates edited: what was not edited stays as it was, comments and order included; what is saved was checked.

A draft is the file's text, parsed so that it can be written again. Edits are of single fields; nothing reaches the disk before the
whole file reads and resolves.
"""

from __future__ import annotations

import io
import os
import re
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from affordance_templates import kept_lines, template_file
from affordance_templates.instance import Instance
from affordance_templates.placement import Array, inverse, of_message, placed, rotation_of, rpy_of
from affordance_templates.template_file import Template
from handrail import config
from handrail.robot.description import Arm

_DIGITS = 5
"""after the point of what is recorded: 0.01 mm, 0.6 mdeg"""


class Draft:
    """A template's file being edited. Every edit raises ValueError naming the field where it can't be made."""

    def __init__(self, text: str, file: Path):
        """`file`: what errors call it, and where meshes are looked for. Raises config.ConfigError."""
        self.file = file
        config.parse(text, file)  # says what is wrong with a text that is no YAML
        self._original = text
        self._data = _yaml().load(text.replace("\r\n", "\n"))
        self._indents = kept_lines.indents(self._data)
        self._before = self._dumped()

    @classmethod
    def of(cls, template: Template) -> Draft:
        """A draft that begins as a template's file."""
        file = template.document.file
        return cls(file.read_bytes().decode("utf-8"), file)  # read_text would take the ends of lines for \n

    @property
    def text(self) -> str:
        """The file's text as it would be saved: lines that no edit concerns stay as they were, whatever their layout."""
        after = self._dumped()
        text = kept_lines.merged(self._original, self._before, after)
        try:
            same = config.parse(text, self.file).data == config.parse(after, self.file).data
        except config.ConfigError:
            same = False
        return text if same else after  # a file of several indentations may not take new lines of one

    def _dumped(self) -> str:
        stream = io.StringIO()
        _yaml(*self._indents).dump(self._data, stream)
        return stream.getvalue()

    def checked(self) -> Template:
        """The template that it is now. Raises config.ConfigError."""
        return self._read(self.text)

    def _read(self, text: str) -> Template:
        return template_file.of(config.parse(text, self.file), text.encode())

    def save(self, file: Path | None = None, *, over: bool = True) -> Template:
        """Check and write, whole: a crash leaves the old file or the new one. Raises ConfigError, FileExistsError, OSError."""
        self.file = file or self.file
        text = self.text
        template = self._read(text)
        self.file.parent.mkdir(parents=True, exist_ok=True)
        if not over and self.file.exists():
            raise FileExistsError(f"{self.file}: is there already; expected a new name")
        beside = self.file.with_suffix(".new")
        beside.write_bytes(text.encode("utf-8"))
        os.replace(beside, self.file)
        return template

    # ----------------------------------------------------------------------------------------------------------- editing

    def set(self, field: str, value: Any) -> None:
        """Give a field that is there, or a new one of a mapping that is there, a value: `parameters.radius.default`."""
        parent, key = self._parent(field)
        if isinstance(parent, CommentedSeq):
            parent[int(key)] = _kept(value)
        else:
            parent[key] = _kept(value)

    def remove(self, field: str) -> None:
        """Take a field, or one of a list's, away."""
        parent, key = self._parent(field)
        if isinstance(parent, CommentedMap) and key not in parent:
            raise ValueError(f"{field}: not there; expected one of {', '.join(parent)}")
        del parent[int(key) if isinstance(parent, CommentedSeq) else key]

    def add_waypoint(self, trajectory: str, waypoint: Mapping[str, Any], at: int | None = None) -> None:
        """Put a waypoint into a trajectory before number `at` (None: at its end); a trajectory that is not there begins."""
        trajectories = self._data.setdefault("trajectories", CommentedMap())
        if not isinstance(trajectories, CommentedMap):
            raise ValueError(f"trajectories: got {trajectories!r}; expected a mapping")
        if trajectory not in trajectories:
            trajectories[trajectory] = CommentedMap(waypoints=CommentedSeq())
        waypoints = self._at(f"trajectories.{trajectory}.waypoints")
        number = len(waypoints) if at is None else at
        if not 0 <= number <= len(waypoints):
            raise ValueError(f"at: got {at}; expected 0 to {len(waypoints)}")
        row = _kept(dict(waypoint))
        row.fa.set_flow_style()
        waypoints.insert(number, row)

    def move_waypoint(self, trajectory: str, start: int, end: int) -> None:
        """Put the waypoint of number `start` where `end` is; those between move up."""
        waypoints = self._at(f"trajectories.{trajectory}.waypoints")
        for name, number in (("start", start), ("end", end)):
            if not 0 <= number < len(waypoints):
                raise ValueError(f"{name}: got {number}; expected 0 to {len(waypoints) - 1}")
        waypoints.insert(end, waypoints.pop(start))

    def set_defaults(self, values: Mapping[str, float]) -> None:
        """Make values of parameters their defaults; those that are already are left as they are written."""
        parameters = self._at("parameters") if values else {}
        for name, value in values.items():
            if name not in parameters:
                raise ValueError(f"parameters.{name}: not there; expected one of {', '.join(parameters)}")
            if float(parameters[name]["default"]) != value:
                parameters[name]["default"] = int(value) if value == int(value) else value

    def _at(self, field: str) -> Any:
        node: Any = self._data
        for part in _parts(field):
            try:
                node = node[int(part)] if isinstance(node, list) else node[part]
            except (KeyError, IndexError, ValueError, TypeError):
                known = ", ".join(map(str, node)) if isinstance(node, dict) else "nothing below it"
                raise ValueError(f"{field}: no {part!r} there; expected one of {known}") from None
        return node

    def _parent(self, field: str) -> tuple[Any, str]:
        *above, key = _parts(field)
        parent = self._at(".".join(above))
        if isinstance(parent, CommentedSeq) and not (key.isdigit() and int(key) < len(parent)):
            raise ValueError(f"{field}: got {key}; expected 0 to {len(parent) - 1}")
        if not isinstance(parent, CommentedMap | CommentedSeq):
            raise ValueError(f"{field}: {'.'.join(above)} is a single value; expected a mapping or a list")
        return parent, key


def recorded(
    instance: Instance, arm: Arm, tip_in_world: Array, *, name: str, frame: str = "", approach: str = "straight",
    hand_pose: str = "",
) -> dict[str, Any]:  # fmt: skip
    """A waypoint where an arm's tip is now, said in a `frame` of the instance (a feature or an object; empty: the template's).

    Raises ValueError for a frame that is not there.
    """
    palm = placed(np.array(arm.palm.position), rotation_of(np.array(arm.palm.rpy)))
    base = of_message(instance.pose_in_world) @ instance.resolve().frame(frame)
    pose = inverse(base) @ tip_in_world @ palm
    rpy = rpy_of(pose[:3, :3])
    waypoint: dict[str, Any] = {"name": name, "approach": approach}
    if frame:
        waypoint["frame"] = frame
    waypoint |= {"position": _rounded(pose[:3, 3]), "rpy": _rounded(rpy)}
    if hand_pose:
        waypoint["hand_pose"] = hand_pose
    return waypoint


def own_file(name: str) -> Path:
    """Where a template of one's own lies. Raises ValueError without a workspace, or for what is no name."""
    if not name.isidentifier():
        raise ValueError(f"{name}: not a name; expected letters, digits and _, beginning with a letter")
    own = os.environ.get("HANDRAIL_WORKSPACE")
    if not own:
        raise ValueError("HANDRAIL_WORKSPACE is not set; expected your workspace's folder, or --to FILE")
    return Path(own) / "affordance_templates" / f"{name}.yaml"


def saved_as(instance: Instance, file: Path) -> Template:
    """An instance as a template of its own: its parameters' values are the defaults, its meshes go with it.

    Raises config.ConfigError, FileExistsError, OSError.
    """
    draft = Draft.of(instance.template)
    draft.set_defaults(instance.parameters)
    source = instance.template.document.file.parent
    for mesh in {shape.file for shape in instance.resolve().shapes if shape.file is not None}:
        there = file.parent / mesh.relative_to(source)
        there.parent.mkdir(parents=True, exist_ok=True)
        if not there.exists():
            shutil.copyfile(mesh, there)
    return draft.save(file, over=False)


def with_meshes(text: str, file: Path, meshes: Mapping[str, Path]) -> Template:
    """A new template's file, and beside it those that it names (name → where they are now).

    Raises config.ConfigError, FileExistsError, OSError; then no file is left that was not there.
    """
    made = []
    try:
        for name, source in meshes.items():
            there = file.parent / name
            if there.exists() and there.read_bytes() != source.read_bytes():
                raise FileExistsError(f"{there}: is there already, and another mesh; expected a new name")
            if not there.exists():
                there.parent.mkdir(parents=True, exist_ok=True)
                made.append(there)
                shutil.copyfile(source, there)
        return Draft(text, file).save(over=False)
    except (config.ConfigError, OSError):
        for each in made:
            each.unlink(missing_ok=True)
        raise


def written(data: Mapping[str, Any]) -> str:
    """A new file's text; what holds no mapping is written on one line."""
    stream = io.StringIO()
    _yaml().dump(_kept(data), stream)
    return stream.getvalue()


def _yaml(mapping: int = 2, sequence: int = 4, dash: int = 2) -> YAML:
    yaml = YAML(typ="rt")
    yaml.width = 10_000  # lines are as long as they were
    yaml.preserve_quotes = True
    yaml.indent(mapping=mapping, sequence=sequence, offset=dash)
    return yaml


def _kept(value: Any) -> Any:
    """The same of ruamel's types; lists of plain values on one line."""
    if isinstance(value, Mapping):
        mapping = CommentedMap((key, _kept(each)) for key, each in value.items())
        if value and not any(isinstance(each, Mapping) or _nested(each) for each in value.values()):
            mapping.fa.set_flow_style()
        return mapping
    if isinstance(value, Sequence) and not isinstance(value, str):
        sequence = CommentedSeq(_kept(each) for each in value)
        if not _nested(value):
            sequence.fa.set_flow_style()
        return sequence
    return value


def _nested(value: Any) -> bool:
    """A list with mappings in it."""
    return isinstance(value, Sequence) and not isinstance(value, str) and any(isinstance(x, Mapping) for x in value)


def _parts(field: str) -> list[str]:
    return re.findall(r"[^.\[\]]+", field)


def _rounded(vector: Array) -> list[float]:
    return [round(float(part), _DIGITS) + 0.0 for part in vector]
