"""Compound tasks and constraint sets from files: what a controller is told to do, by name.

```yaml
name: reach_and_look
extends: standing.yaml            # its constraints, and its levels after these
constraints:
  - {constraint: JointLimits, torque: 0.8}
levels:                           # highest first; tasks of one level share it by weight
  - - {task: SE3, name: hand, frame: tool_right_tip, stiffness: 200}
  - - {task: Gaze, frame: rgbd_depth_optical_frame, target_frame: tool_right_tip}
    - {task: COM, axes: [x, y], weight: 0.5}
  - - {task: JPos}
```
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, get_args

import msgspec

from daemon.wbc.constraints import AnyConstraint, Constraint
from daemon.wbc.hierarchy import WholeBody
from daemon.wbc.model import WholeBodyModel
from daemon.wbc.parameters import WbcError
from daemon.wbc.tasks import AnyTask, Task
from handrail import config, workspace

_NAME = re.compile(r"[\w.-]+")
_FRAMED = {
    str(kind.__struct_config__.tag)
    for kind in (*get_args(AnyTask), *get_args(AnyConstraint))
    if "frame" in kind.__struct_fields__
}


class CompoundTask(msgspec.Struct, forbid_unknown_fields=True):
    """Levels of tasks, highest first, under a set of constraints. Made in Python like this, or read by `load`."""

    name: str = ""
    constraints: list[AnyConstraint] = []
    levels: list[list[AnyTask]] = []

    def on(self, model: WholeBodyModel, led: Sequence[str] = ()) -> WholeBody:
        """For a robot, from where its model stands now; `led`: joints that others move. Raises WbcError."""
        levels: Sequence[Sequence[Task]] = self.levels
        constraints: Sequence[Constraint] = self.constraints
        return WholeBody(model, levels, constraints, led)

    def below(self, other: CompoundTask) -> CompoundTask:
        """Another compound task's levels first, then these; the constraints of both."""
        return CompoundTask(other.name, [*other.constraints, *self.constraints], [*other.levels, *self.levels])


class _File(CompoundTask, forbid_unknown_fields=True):
    extends: str = ""


def load(file: Path | str) -> CompoundTask:
    """Read a compound task. Raises config.ConfigError with file and line."""
    return _merged(config.read(file), ())


def load_on(file: Path | str, model: WholeBodyModel) -> WholeBody:
    """Read one for a robot. Raises config.ConfigError with file and line, for names that the robot has not, too."""
    document = config.read(file)
    return _on(document, _merged(document, ()), model)


def find(
    text: str,
    folders: Sequence[Path],
    model: Callable[[CompoundTask], WholeBodyModel],
    led: Sequence[str] = (),
    frame: str = "",
) -> CompoundTask:
    """The compound task of this name in `folders`, the first of which counts, or with this YAML text, which may extend one of
    them; `frame`: of what names none; `model`: that it would run on, on which it has been tried, with `led` moved by others.

    Raises config.ConfigError with file and line.
    """
    known = workspace.files(list(folders))
    if _NAME.fullmatch(text):
        if text not in known:
            raise config.ConfigError(
                text, None, "", f"no such compound task; expected one of {', '.join(known)}, or YAML"
            )
        document = config.read(known[text])
    else:
        document = config.parse(text, Path("compound"))
    compound = _merged(document, (), known, frame)
    _on(document, compound, model(compound), led)
    return compound


def _on(document: config.Document, compound: CompoundTask, model: WholeBodyModel, led: Sequence[str] = ()) -> WholeBody:
    try:
        return compound.on(model, led)
    except WbcError as error:
        raise document.error(error.field, error.problem) from error


def _merged(
    document: config.Document,
    above: tuple[Path, ...],
    known: Mapping[str, Path] = MappingProxyType({}),
    frame: str = "",
) -> CompoundTask:
    """With what it extends: a file beside it, or one of those `known` by name."""
    if frame:
        _fill(document.data, frame)
    read, file = document.convert(_File), document.file
    own = CompoundTask(read.name or file.stem, read.constraints, read.levels)
    if not read.extends:
        return own
    base = known.get(read.extends, (file.parent / read.extends).resolve())
    if base in (*above, file.resolve()):
        raise document.error("extends", f"{read.extends} extends this file; expected no circle")
    if not base.is_file():
        raise document.error("extends", f"no such file: {base}")
    return _merged(config.read(base), (*above, file.resolve()), known, frame).below(own)


def _fill(node: Any, frame: str) -> None:
    """Whatever is about a frame and names none is about this one."""
    if isinstance(node, dict) and node.get("task", node.get("constraint")) in _FRAMED:
        node.setdefault("frame", frame)
    elif isinstance(node, dict | list):
        for part in node.values() if isinstance(node, dict) else node:
            _fill(part, frame)
