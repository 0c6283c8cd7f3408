"""Where compound tasks (docs/wbc.md) are found by name: the user's, the robot's, Handrail's."""

from __future__ import annotations

from pathlib import Path

from handrail.workspace import files, search_path

_FOLDER = "compound_tasks"


def folders(robot: Path) -> list[Path]:
    """For the robot whose folder this is; where two have one of the same name, the first counts."""
    *own, built_in = search_path(_FOLDER, "daemon", _FOLDER)
    return [*own, robot / _FOLDER, built_in]


def everywhere() -> dict[str, Path]:
    """Every name that some robot knows, and a file of it."""
    robots = [robot for place in search_path("robots", "hal", "robots") for robot in sorted(place.glob("*/"))]
    return files([*search_path(_FOLDER, "daemon", _FOLDER), *(robot / _FOLDER for robot in robots)])
