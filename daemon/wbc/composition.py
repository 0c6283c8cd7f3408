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

from collections.abc import Sequence
from pathlib import Path

import msgspec

from daemon.wbc.constraints import AnyConstraint, Constraint
from daemon.wbc.hierarchy import WholeBody
from daemon.wbc.model import WholeBodyModel
from daemon.wbc.parameters import WbcError
from daemon.wbc.tasks import AnyTask, Task
from handrail import config


class CompoundTask(msgspec.Struct, forbid_unknown_fields=True):
    """Levels of tasks, highest first, under a set of constraints. Made in Python like this, or read by `load`."""

    name: str = ""
    constraints: list[AnyConstraint] = []
    levels: list[list[AnyTask]] = []

    def on(self, model: WholeBodyModel) -> WholeBody:
        """For a robot, from where its model stands now. Raises WbcError."""
        levels: Sequence[Sequence[Task]] = self.levels
        constraints: Sequence[Constraint] = self.constraints
        return WholeBody(model, levels, constraints)

    def below(self, other: CompoundTask) -> CompoundTask:
        """Another compound task's levels first, then these; the constraints of both."""
        return CompoundTask(other.name, [*other.constraints, *self.constraints], [*other.levels, *self.levels])


class _File(CompoundTask, forbid_unknown_fields=True):
    extends: str = ""


def load(file: Path | str) -> CompoundTask:
    """Read a compound task. Raises config.ConfigError with file and line."""
    return _load(Path(file), ())


def load_on(file: Path | str, model: WholeBodyModel) -> WholeBody:
    """Read one for a robot. Raises config.ConfigError with file and line, for names that the robot has not, too."""
    document = config.read(file)
    compound = load(file)
    try:
        return compound.on(model)
    except WbcError as error:
        raise document.error(error.field, error.problem) from error


def _load(file: Path, above: tuple[Path, ...]) -> CompoundTask:
    document = config.read(file)
    read = document.convert(_File)
    if not read.extends:
        return CompoundTask(read.name or file.stem, read.constraints, read.levels)
    base = (file.parent / read.extends).resolve()
    if base in (*above, file.resolve()):
        raise document.error("extends", f"{read.extends} extends this file; expected no circle")
    if not base.is_file():
        raise document.error("extends", f"no such file: {base}")
    return _load(base, (*above, file.resolve())).below(
        CompoundTask(read.name or file.stem, read.constraints, read.levels)
    )
