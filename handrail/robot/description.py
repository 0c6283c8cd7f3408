"""A robot's folder, read and checked: model, network, limbs, groups, arms, limits, gains, home postures.

Needs no kinematics library: the tablet reads it too. Every array has one row a joint, in the order of
`RobotDescription.joints`, which is the order of the limbs on the network.
"""

from __future__ import annotations

import fnmatch
import os
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, overload

import msgspec
import numpy as np

from handrail import config, workspace
from handrail.robot import urdf

Positive = Annotated[float, msgspec.Meta(gt=0)]


class Channel(msgspec.Struct, kw_only=True, forbid_unknown_fields=True, frozen=True):
    """One CAN bus. `interface`: `handrail` is the virtual hub, any other name is python-can's."""

    name: str
    interface: str
    bitrate: Annotated[int, msgspec.Meta(gt=0)]
    data_bitrate: Annotated[int, msgspec.Meta(gt=0)]


class _LimbFile(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    name: str
    channel: str
    joints: Annotated[list[str], msgspec.Meta(min_length=1, max_length=7)]


class _Network(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    channels: Annotated[list[Channel], msgspec.Meta(min_length=1)]
    limbs: Annotated[list[_LimbFile], msgspec.Meta(min_length=1, max_length=8)]


class _ArmFile(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    groups: list[str]
    tool: str


class _Control(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    period: Positive
    watchdog_cycles: Annotated[int, msgspec.Meta(ge=1, le=255)]
    damping_ratio: Positive
    torque_rate: Positive
    stiffness: dict[str, Positive]
    quick_stop_damping: dict[str, Positive]


class _RobotFile(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    name: str
    model: urdf.Model
    network: _Network
    groups: dict[str, list[str]]
    arms: dict[str, _ArmFile]
    control: _Control
    allowed_collision_pairs: list[tuple[str, str]] = []
    home: dict[str, dict[str, float]]


@dataclass(frozen=True)
class Limb:
    """Up to seven drives on one bus segment; `index` is its number in the frames' identifiers."""

    name: str
    index: int
    channel: str
    joints: tuple[str, ...]


@dataclass(frozen=True)
class Arm:
    """A chain that carries a tool. `tip`: frame at the contact point, the tool pointing along its −z."""

    name: str
    joints: tuple[str, ...]
    tool: str
    tip: str


@dataclass(frozen=True)
class RobotDescription:
    """All that the processes share about one robot."""

    name: str
    folder: Path
    urdf: Path
    """assembled: absolute mesh paths, fixed joints not merged"""
    joints: tuple[str, ...]
    channels: tuple[Channel, ...]
    limbs: tuple[Limb, ...]
    groups: dict[str, tuple[str, ...]]
    arms: dict[str, Arm]
    lower: np.ndarray
    """rad (n,)"""
    upper: np.ndarray
    """rad (n,)"""
    velocity_limit: np.ndarray
    """rad/s (n,)"""
    torque_limit: np.ndarray
    """N·m (n,)"""
    torque_rate_limit: np.ndarray
    """N·m/s (n,)"""
    stiffness: np.ndarray
    """N·m/rad (n,), joint impedance in the drives"""
    damping_ratio: float
    quick_stop_damping: np.ndarray
    """N·m·s/rad (n,)"""
    home: dict[str, dict[str, float]]
    period_ns: int
    watchdog_cycles: int
    allowed_collision_pairs: tuple[tuple[str, str], ...]

    @overload
    def index(self, joints: str) -> int: ...
    @overload
    def index(self, joints: list[str] | tuple[str, ...]) -> np.ndarray: ...
    def index(self, joints: str | list[str] | tuple[str, ...]) -> int | np.ndarray:
        """The row of one joint, or the rows of several. Raises KeyError for a joint that the robot has not."""
        rows = {joint: row for row, joint in enumerate(self.joints)}
        if isinstance(joints, str):
            return rows[joints]
        return np.array([rows[joint] for joint in joints], dtype=np.intp)

    def home_position(self, name: str = "ready") -> np.ndarray:
        """A home posture as rad (n,). Raises KeyError when there is none of that name."""
        return np.array([self.home[name][joint] for joint in self.joints])


def find(name_or_folder: str | os.PathLike[str]) -> Path:
    """The robot's file. Raises config.ConfigError naming what there is."""
    given = Path(name_or_folder)
    folders = workspace.search_path("robots", "hal", "robots")
    candidates = [given / "robot.yaml", *(folder / given / "robot.yaml" for folder in folders)]
    for candidate in candidates:
        if candidate.is_file():
            return candidate
    known = sorted({file.parent.name for folder in folders for file in folder.glob("*/robot.yaml")})
    raise config.ConfigError(
        str(name_or_folder),
        None,
        "robot",
        f"no such robot; expected one of {', '.join(known)}, or a folder with robot.yaml",
    )


def load(name_or_folder: str | os.PathLike[str]) -> RobotDescription:
    """Read a robot by name or folder. Raises config.ConfigError with file, line, field and expectation."""
    document = config.read(find(name_or_folder))
    file = document.convert(_RobotFile)
    try:
        assembled = urdf.assemble(file.model)
    except (FileNotFoundError, ValueError) as problem:
        raise document.error("model", str(problem)) from problem
    channels = {channel.name for channel in file.network.channels}
    limbs = []
    for number, limb in enumerate(file.network.limbs):
        if limb.channel not in channels:
            raise document.error(
                f"network.limbs[{number}].channel",
                f"got {limb.channel!r}; expected one of {', '.join(sorted(channels))}",
            )
        limbs.append(Limb(limb.name, number, limb.channel, tuple(limb.joints)))
    joints = tuple(joint for limb in limbs for joint in limb.joints)
    limits = _limits(assembled)
    for carrier in limbs:
        for joint in carrier.joints:
            if joint not in limits:
                raise document.error(f"network.limbs[{carrier.index}].joints", f"no moving joint {joint!r} in the URDF")
    if len(set(joints)) != len(joints):
        double = next(joint for joint in joints if joints.count(joint) > 1)
        raise document.error("network.limbs", f"joint {double} is on two limbs")
    if missing := set(limits) - set(joints):
        raise document.error(
            "network.limbs", f"no limb carries {', '.join(sorted(missing))} (put it on one, or fix it)"
        )
    groups = {}
    for name, members in file.groups.items():
        if unknown := [joint for joint in members if joint not in joints]:
            raise document.error(f"groups.{name}", f"no joint {unknown[0]!r} on the network")
        groups[name] = tuple(members)
    lower, upper, velocity, torque = (np.array([limits[joint][column] for joint in joints]) for column in range(4))
    return RobotDescription(
        name=file.name,
        folder=document.file.parent,
        urdf=assembled,
        joints=joints,
        channels=tuple(file.network.channels),
        limbs=tuple(limbs),
        groups=groups,
        arms=_arms(document, file, groups),
        lower=lower,
        upper=upper,
        velocity_limit=velocity,
        torque_limit=torque,
        torque_rate_limit=torque * file.control.torque_rate,
        stiffness=_per_joint(document, "control.stiffness", file.control.stiffness, joints),
        damping_ratio=file.control.damping_ratio,
        quick_stop_damping=_per_joint(document, "control.quick_stop_damping", file.control.quick_stop_damping, joints),
        home=_home(document, file, joints, lower, upper),
        period_ns=round(file.control.period * 1e9),
        watchdog_cycles=file.control.watchdog_cycles,
        allowed_collision_pairs=tuple(file.allowed_collision_pairs),
    )


def _limits(assembled: Path) -> dict[str, tuple[float, float, float, float]]:
    """joint → lower, upper (rad), velocity (rad/s), effort (N·m), of every moving joint."""
    limits = {}
    for joint in ET.parse(assembled).getroot().findall("joint"):
        limit = joint.find("limit")
        if joint.get("type") in ("revolute", "prismatic") and limit is not None:
            values = [float(limit.get(key, "0")) for key in ("lower", "upper", "velocity", "effort")]
            limits[joint.get("name", "")] = (values[0], values[1], values[2], values[3])
    return limits


def _per_joint(document: config.Document, field: str, given: dict[str, float], joints: Sequence[str]) -> np.ndarray:
    values = []
    for pattern in given:
        if not fnmatch.filter(joints, pattern):
            raise document.error(f"{field}.{pattern}", "matches no joint of this robot")
    for joint in joints:
        matches = [value for pattern, value in given.items() if fnmatch.fnmatch(joint, pattern)]
        if len(matches) != 1:
            raise document.error(field, f"{joint} is given {len(matches)} times; expected once")
        values.append(matches[0])
    return np.array(values)


def _arms(document: config.Document, file: _RobotFile, groups: dict[str, tuple[str, ...]]) -> dict[str, Arm]:
    tools = {tool.name: tool for tool in file.model.tools}
    arms = {}
    for name, arm in file.arms.items():
        if unknown := [group for group in arm.groups if group not in groups]:
            raise document.error(
                f"arms.{name}.groups", f"no group {unknown[0]!r}; expected some of {', '.join(groups)}"
            )
        if arm.tool not in tools:
            raise document.error(f"arms.{name}.tool", f"got {arm.tool!r}; expected one of {', '.join(tools)}")
        chain = tuple(joint for group in arm.groups for joint in groups[group])
        arms[name] = Arm(name, chain, arm.tool, tools[arm.tool].tip_frame)
    return arms


def _home(
    document: config.Document, file: _RobotFile, joints: Sequence[str], lower: np.ndarray, upper: np.ndarray
) -> dict[str, dict[str, float]]:
    for posture, values in file.home.items():
        for row, joint in enumerate(joints):
            if joint not in values:
                raise document.error(f"home.{posture}", f"{joint} is missing; expected every joint")
            if not lower[row] <= values[joint] <= upper[row]:
                raise document.error(
                    f"home.{posture}.{joint}",
                    f"got {values[joint]:g} rad; expected {lower[row]:.4g} to {upper[row]:.4g}",
                )
        if unknown := set(values) - set(joints):
            raise document.error(f"home.{posture}.{sorted(unknown)[0]}", "no such joint on the network")
    return file.home
