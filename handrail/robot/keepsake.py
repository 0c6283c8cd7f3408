"""A robot's description in one piece, which loads alike wherever and whenever it is put into a folder again."""

from __future__ import annotations

import copy
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from handrail.robot import library as robots
from handrail.robot.description import RobotDescription

_YAML, _URDF = "robot.yaml", "robot.urdf"


def keepsake(description: RobotDescription) -> dict[str, str]:
    """File name → content: robot.yaml with all that it extends laid in, and the assembled URDF, without its meshes."""
    data: dict[str, Any] = copy.deepcopy(robots.read(description.folder / _YAML).data)
    data["model"] = {"file": _URDF}
    for name, arm in description.arms.items():
        # Else a tool of the model's tells where it touches, and that is in the URDF now.
        data["arms"][name]["tip"] = arm.tip
    # JSON is YAML, and tells every float exactly.
    return {_YAML: json.dumps(data, indent=1), _URDF: description.urdf.read_text(encoding="utf-8")}


def restore(files: Mapping[str, str], folder: Path) -> RobotDescription:
    """The description that these files are, put into `folder`. Raises config.ConfigError, KeyError where one is missing."""
    for name in (_YAML, _URDF):
        (folder / name).write_text(files[name], encoding="utf-8")
    return robots.load(folder)
