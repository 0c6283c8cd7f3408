"""Behaviours as YAML files: steps as in messages.Step, with joints and frame said once for all of them, or left to the arm.

They are found by name in the workspace's folder `behaviours`, then among those of rtc_programs.
"""

from __future__ import annotations

import fnmatch
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Protocol

import msgspec
from msgspec import Meta

from handrail import config, workspace
from handrail.messages import Name, StartBehaviour, Step

_FRAMED = ("pose_error", "force", "contact", "stall", "travel")
"""types of end conditions that are about a frame"""
_OF_GRIPPERS = ("gripper_holds", "gripper_at")


class Robot(Protocol):
    """What of a robot a behaviour must know: its messages.RobotInfo and its RobotDescription have it."""

    @property
    def name(self) -> str: ...
    @property
    def joints(self) -> Sequence[str]: ...
    @property
    def groups(self) -> Mapping[str, Sequence[str]]: ...


@dataclass(frozen=True)
class Part:
    """What a behaviour moves that says no frame and no joints itself: an arm, from its base to its tool's tip."""

    frame: str
    joints: tuple[str, ...]


SOME_ARM = Part("tip", ("*",))
"""to read a file with where no arm is known yet"""


class _File(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    steps: Annotated[list[Step], Meta(min_length=1, max_length=16)]
    joints: list[Name] = []
    """of every motion that names none: joints, groups of the robot, globs; whole-body motions without any move all of them"""
    frame: str = ""
    """of every motion and end condition that names none"""
    gripper: str = ""
    """of every order and end condition that is about a gripper and names none"""
    most_steps: Annotated[int, Meta(ge=1, le=10_000)] = 100


class BehaviourFile:
    """A behaviour that was read from a file."""

    hoped = "done"
    """the outcome that who rehearses it takes for granted"""

    def __init__(self, file: Path | str, part: Part | None = None):
        """`part`: stands for the frame and the joints that the file leaves open. Raises ConfigError with file, line, field and
        expectation.
        """
        self._document = config.read(file)
        data = self._document.data
        said = dict(data)
        if part is not None:
            said = {"frame": part.frame, "joints": list(part.joints)} | said
        steps = data.get("steps")
        for step in steps if isinstance(steps, list) else []:
            if isinstance(step, dict):
                _fill(step, said)
        try:
            self._file = self._document.convert(_File)
        except config.ConfigError as problem:
            if part is None and not {"frame", "joints"} & set(data) and problem.field.endswith((".frame", ".joints")):
                expected = "expected a frame and joints in the file, or an arm to do it (--arm)"
                raise config.ConfigError(
                    problem.file, problem.line, problem.field, f"{problem.problem}; {expected}"
                ) from None
            raise

    @property
    def steps(self) -> list[Step]:
        """As the file has them: groups and globs may stand for joints."""
        return self._file.steps

    def call(self, action: str, owner: str, robot: Robot) -> StartBehaviour:
        """The call that runs it on this robot. Raises ConfigError for joints that the robot has not."""
        steps = []
        for number, step in enumerate(self._file.steps):
            joints = list(self._joints(step.motion.joints, f"steps[{number}].motion.joints", robot))
            motion = msgspec.structs.replace(step.motion, joints=joints)
            steps.append(msgspec.structs.replace(step, motion=motion))
        return StartBehaviour(id=action, owner=owner, steps=steps, most_steps=self._file.most_steps)

    def _joints(self, names: list[str], field: str, robot: Robot) -> Iterator[str]:
        try:
            yield from named(names, robot)
        except ValueError as problem:
            raise self._document.error(field, str(problem)) from problem

    def expected(self, step: str, outcome: str) -> bool:
        """Whether the file says that the behaviour may end so: after `done`, or where a step leads to `end`."""
        leads = next((one.then for one in self._file.steps if one.name == step), {})
        return outcome == "done" or leads.get(outcome) == "end"


def named(names: Sequence[str], robot: Robot) -> Iterator[str]:
    """The joints that names of joints, of groups, and globs stand for. Raises ValueError for one that the robot has not."""
    for name in names:
        found = robot.groups.get(name) or fnmatch.filter(robot.joints, name)
        if not found:
            known = ", ".join([*robot.groups, robot.joints[0], "..."])
            raise ValueError(f"{name} is none of {robot.name}'s; expected of {known}, or a glob")
        yield from found


def with_frames(ends: list[Any], frame: str) -> list[Any]:
    """End conditions, as a file has them, with the frame of those that are about one and name none."""
    return [{"frame": frame, **end} if _about_frame(end) else end for end in ends]


def _about_frame(end: Any) -> bool:
    return isinstance(end, dict) and end.get("type") in _FRAMED


def files() -> dict[str, Path]:
    """Every behaviour's name and file."""
    return workspace.files(workspace.search_path("behaviours", "rtc_programs", "behaviours"))


def find(name_or_file: str | Path) -> Path:
    """Where a behaviour is, by its name or as a file. Raises ConfigError with the names that there are."""
    if str(name_or_file).endswith((".yaml", ".yml")):
        return Path(name_or_file)
    known = files()
    if str(name_or_file) not in known:
        expected = f"{', '.join(sorted(known))}, or a YAML file"
        raise config.ConfigError(name_or_file, None, "behaviour", f"no such behaviour; expected one of {expected}")
    return known[str(name_or_file)]


def _fill(step: dict[str, Any], file: dict[str, Any]) -> None:
    motion, ends = step.get("motion"), step.get("ends")
    if isinstance(motion, dict):
        if isinstance(compound := motion.get("compound"), dict):
            motion["compound"] = json.dumps(compound)  # as the message has it: a name, or its text
        if "joints" in file:
            motion.setdefault("joints", file["joints"])
        if "frame" in file and motion.get("type") not in ("joint_trajectory", "joint_target"):
            motion.setdefault("frame", file["frame"])
    order = step.get("gripper")
    if isinstance(order, dict) and "gripper" in file:
        order.setdefault("gripper", file["gripper"])
    for end in ends if isinstance(ends, list) else []:
        if isinstance(end, dict) and "gripper" in file and end.get("type") in _OF_GRIPPERS:
            end.setdefault("gripper", file["gripper"])
        if "frame" in file and _about_frame(end):
            end.setdefault("frame", file["frame"])
