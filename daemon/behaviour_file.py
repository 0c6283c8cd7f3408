"""Behaviours as YAML files: steps as in messages.Step, with joints and frame said once for all of them."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from handrail import config
from handrail.messages import Name, RobotInfo, StartBehaviour, Step

_FRAMED = ("pose_error", "force", "contact", "stall", "travel")
"""types of end conditions that are about a frame"""


class _File(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    steps: Annotated[list[Step], Meta(min_length=1, max_length=16)]
    joints: list[Name] = []
    """of every motion that names none: joints, groups of the robot, globs"""
    frame: str = ""
    """of every motion and end condition that names none"""
    most_steps: Annotated[int, Meta(ge=1, le=10_000)] = 100


class BehaviourFile:
    """A behaviour that was read from a file."""

    def __init__(self, file: Path | str):
        """Raises ConfigError with file, line, field and expectation."""
        self._document = config.read(file)
        data = self._document.data
        steps = data.get("steps")
        for step in steps if isinstance(steps, list) else []:
            if isinstance(step, dict):
                _fill(step, data)
        self._file = self._document.convert(_File)

    @property
    def steps(self) -> list[Step]:
        """As the file has them: groups and globs may stand for joints."""
        return self._file.steps

    def call(self, action: str, owner: str, robot: RobotInfo) -> StartBehaviour:
        """The call that runs it on this robot. Raises ConfigError for joints that the robot has not."""
        steps = []
        for number, step in enumerate(self._file.steps):
            joints = list(self._joints(step.motion.joints, f"steps[{number}].motion.joints", robot))
            motion = msgspec.structs.replace(step.motion, joints=joints)
            steps.append(msgspec.structs.replace(step, motion=motion))
        return StartBehaviour(id=action, owner=owner, steps=steps, most_steps=self._file.most_steps)

    def _joints(self, names: list[str], field: str, robot: RobotInfo) -> Iterator[str]:
        for name in names:
            found = robot.groups.get(name) or fnmatch.filter(robot.joints, name)
            if not found:
                known = ", ".join([*robot.groups, robot.joints[0], "..."])
                raise self._document.error(field, f"{name} is none of {robot.name}'s; expected of {known}, or a glob")
            yield from found

    def expected(self, step: str, outcome: str) -> bool:
        """Whether the file says that the behaviour may end so: after `done`, or where a step leads to `end`."""
        leads = next((one.then for one in self._file.steps if one.name == step), {})
        return outcome == "done" or leads.get(outcome) == "end"


def _fill(step: dict[str, Any], file: dict[str, Any]) -> None:
    motion, ends = step.get("motion"), step.get("ends")
    if isinstance(motion, dict):
        if "joints" in file:
            motion.setdefault("joints", file["joints"])
        if "frame" in file and motion.get("type") != "joint_trajectory":
            motion.setdefault("frame", file["frame"])
    for end in ends if isinstance(ends, list) else []:
        if isinstance(end, dict) and "frame" in file and end.get("type") in _FRAMED:
            end.setdefault("frame", file["frame"])
