"""A release is checked whole, for the robot that it would run on, before anything of it counts."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from affordance_templates import template_file
from engines.programs import library
from handrail import config, workspace
from handrail.behaviour_file import BehaviourFile, Part
from handrail.config import ConfigError
from handrail.robot.description import RobotDescription
from handrail.topics import refuse

NODES = "nodes/"
"""begins the name of a bundle that is no program but a node by itself"""


def check(folder: Path, programs: Collection[str], description: RobotDescription) -> None:
    """Refuse what this robot can't run: the first program, node, template, behaviour or scene that is unsound is named.

    :param folder: made like a workspace; what is not in it is found where it is now
    :param programs: that must be there
    """
    with workspace.pinned(folder):
        for name in (each for each in programs if not each.startswith(NODES)):
            try:
                program = library.named(name)
            except ConfigError as problem:
                raise refuse("the program can't be deployed", "program", name, _short(problem, folder)) from problem
            wants = [each for each, resource in program.resources.items() if resource.kind == "arm"]
            if wants and not description.arms:
                raise refuse(f"{name} needs an arm", f"resources.{wants[0]}", description.name, "a robot with arms")
        for file in sorted(folder.rglob("*")):
            if file.is_file():
                _check_file(file, file.relative_to(folder).parts[0], folder, description)


def _check_file(file: Path, kind: str, folder: Path, description: RobotDescription) -> None:
    path = file.relative_to(folder).as_posix()
    try:
        if file.suffix == ".py":
            compile(file.read_bytes(), path, "exec")
        elif file.suffix in (".yaml", ".yml"):
            if kind == "affordance_templates":
                template_file.read(file)
            elif kind == "behaviours":
                _check_behaviour(file, description)
            else:
                config.read(file)
    except (ConfigError, SyntaxError, ValueError) as problem:
        raise refuse("a file of the bundle is unsound", "files", path, _short(problem, folder)) from problem


def _check_behaviour(file: Path, description: RobotDescription) -> None:
    arm = next(iter(description.arms.values()), None)
    BehaviourFile(file, Part(arm.tip, tuple(arm.joints)) if arm else None).call("check", "check", description)


def _short(problem: Exception, folder: Path) -> str:
    """Where it is in the bundle, and not on this machine's disk."""
    return str(problem).replace(f"{folder}/", "")
