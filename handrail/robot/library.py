"""The robots that there are: their folders found, read and checked."""

from __future__ import annotations

import fnmatch
import os
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from handrail import config, workspace
from handrail.robot import urdf
from handrail.robot.description import (
    Actuator,
    Arm,
    Camera,
    Device,
    Foot,
    IntegralGains,
    Limb,
    Mimic,
    ParallelPair,
    RobotDescription,
)
from handrail.robot.guarding import Guarding, HalfSpace
from handrail.robot.robot_file import IntegralFile, RobotFile

_NOISY = {"imu": ("angular_velocity", "linear_acceleration"), "force_torque": ("force", "torque")}
"""family → what its sensors measure with noise"""


def _folders() -> list[Path]:
    return workspace.search_path("robots", "hal", "robots")


def files() -> dict[str, Path]:
    """Name → file of the robots that there are; the user's own come before those that are built in."""
    return {file.parent.name: file for folder in reversed(_folders()) for file in folder.glob("*/robot.yaml")}


def find(name_or_folder: str | os.PathLike[str]) -> Path:
    """The robot's file. Raises config.ConfigError naming what there is."""
    given = Path(name_or_folder)
    candidates = [given / "robot.yaml", *(folder / given / "robot.yaml" for folder in _folders())]
    for candidate in candidates:
        if candidate.is_file():
            return candidate
    raise config.ConfigError(
        str(name_or_folder),
        None,
        "robot",
        f"no such robot; expected one of {', '.join(sorted(files()))}, or a folder with robot.yaml",
    )


def read(file: Path, extending: tuple[Path, ...] = ()) -> config.Document:
    """A robot's file, laid over the one that it `extends`, if it does."""
    document = config.read(file)
    if "extends" not in document.data:
        return document
    name = document.data["extends"]
    if not isinstance(name, str):
        raise document.error("extends", f"got {name!r}; expected a robot's name")
    try:
        base = find(name)
    except config.ConfigError as unknown:
        raise document.error("extends", unknown.problem) from unknown
    if base in (*extending, file):
        raise document.error("extends", f"{name} extends this robot; expected no circle")
    merged = document.over(read(base, (*extending, file)))
    del merged.data["extends"]
    return merged


def load(name_or_folder: str | os.PathLike[str]) -> RobotDescription:
    """Read a robot by name or folder. Raises config.ConfigError with file, line, field and expectation."""
    document = read(find(name_or_folder))
    file = document.convert(RobotFile)
    try:
        assembled = urdf.assemble(file.model, document.file.parent)
        allowed = urdf.allowed_pairs(file.model, document.file.parent)
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
        limbs.append(Limb(limb.name, number, limb.channel, tuple(limb.joints), limb.family, limb.answer))
    joints = tuple(joint for limb in limbs for joint in limb.joints)
    tree = ET.parse(assembled).getroot()
    limits, mimics = _limits(tree), _mimics(tree)
    devices = _devices(document, file, tree, channels, mimics)
    endless = {each.get("name", "") for each in tree.findall("joint") if each.get("type") == "continuous"}
    undriven = set(mimics) | {device.joint for device in devices}
    for carrier in limbs:
        for joint in carrier.joints:
            if joint in endless:
                raise document.error(
                    f"network.limbs[{carrier.index}].joints",
                    f"{joint} turns without end, and no drive's frame carries that; expected a joint with limits",
                )
            if joint not in limits:
                raise document.error(f"network.limbs[{carrier.index}].joints", f"no moving joint {joint!r} in the URDF")
            if joint in undriven:
                raise document.error(
                    f"network.limbs[{carrier.index}].joints", f"{joint} has no drive of its own: a gripper moves it"
                )
    if len(set(joints)) != len(joints):
        double = next(joint for joint in joints if joints.count(joint) > 1)
        raise document.error("network.limbs", f"joint {double} is on two limbs")
    if missing := set(limits) - set(joints) - undriven:
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
        arms=_arms(document, file, groups, tree),
        lower=lower,
        upper=upper,
        velocity_limit=velocity,
        torque_limit=torque,
        torque_rate_limit=torque * file.control.torque_rate,
        acceleration_limit=velocity * file.control.acceleration,
        jerk_limit=velocity * file.control.jerk,
        stiffness=_per_joint(document, "control.stiffness", file.control.stiffness, joints),
        damping_ratio=file.control.damping_ratio,
        quick_stop_damping=_per_joint(document, "control.quick_stop_damping", file.control.quick_stop_damping, joints),
        integral=_integral(document, file.control.integral, joints),
        home=_home(document, file, joints, lower, upper),
        period_ns=round(file.control.period * 1e9),
        watchdog_cycles=file.control.watchdog_cycles,
        stop_after_misses=file.control.stop_after_misses,
        allowed_collision_pairs=(*file.allowed_collision_pairs, *allowed),
        guard=_guard(document, file.guard, tree),
        base=file.base,
        support=file.support,
        floor=file.floor,
        feet=_feet(document, file, tree),
        devices=devices,
        mimics=mimics,
        device_limits={device.joint: limits[device.joint] for device in devices if device.joint},
        actuators=_actuators(document, file.actuators, joints),
        parallel_pairs=_parallel_pairs(document, file.parallel_pairs, joints),
        cameras=_cameras(document, file.cameras, tree),
    )


def _mimics(tree: ET.Element) -> dict[str, Mimic]:
    mimics = {}
    for joint in tree.findall("joint"):
        mimic = joint.find("mimic")
        if mimic is not None:
            mimics[joint.get("name", "")] = Mimic(
                mimic.get("joint", ""), float(mimic.get("multiplier", "1")), float(mimic.get("offset", "0"))
            )
    return mimics


def _devices(
    document: config.Document, file: RobotFile, tree: ET.Element, channels: set[str], mimics: dict[str, Mimic]
) -> tuple[Device, ...]:
    links = {link.get("name", "") for link in tree.findall("link")}
    moving = _limits(tree)
    devices: list[Device] = []
    for number, device in enumerate(file.network.devices):
        field = f"network.devices[{number}]"
        if device.channel not in channels:
            raise document.error(
                f"{field}.channel", f"got {device.channel!r}; expected one of {', '.join(sorted(channels))}"
            )
        if device.name in {other.name for other in devices}:
            raise document.error(f"{field}.name", f"got {device.name!r} a second time; expected a name of its own")
        if device.link and device.link not in links:
            raise document.error(f"{field}.link", f"no link {device.link!r} in the URDF")
        if device.joint and (device.joint not in moving or device.joint in mimics):
            raise document.error(f"{field}.joint", f"no moving joint {device.joint!r} that mimics no other in the URDF")
        own = {f"{quantity}{end}" for quantity in _NOISY.get(device.family, ()) for end in ("", "_bias")}
        for quantity, value in msgspec.structs.asdict(device.noise).items():
            if value is not None and quantity not in own:
                known = ", ".join(sorted(own)) or "none"
                raise document.error(
                    f"{field}.noise.{quantity}", f"{device.family} has no such noise; expected {known}"
                )
        index = sum(other.family == device.family for other in devices)
        devices.append(
            Device(device.name, device.family, index, device.channel, device.link, device.joint, device.noise)
        )
    return tuple(devices)


def _feet(document: config.Document, file: RobotFile, tree: ET.Element) -> tuple[Foot, ...]:
    links = {link.get("name", "") for link in tree.findall("link")}
    for name, foot in file.feet.items():
        if file.base == "fixed":
            raise document.error(f"feet.{name}", "the base is fixed; expected feet of a robot with base: free alone")
        if foot.link not in links:
            raise document.error(f"feet.{name}.link", f"no link {foot.link!r} in the URDF")
    return tuple(Foot(name, foot.link, foot.size) for name, foot in file.feet.items())


def _actuators(document: config.Document, given: dict[str, Actuator], joints: Sequence[str]) -> tuple[Actuator, ...]:
    for pattern in given:
        if not fnmatch.filter(joints, pattern):
            raise document.error(f"actuators.{pattern}", "matches no joint of this robot")
    found = []
    for joint in joints:
        matches = [actuator for pattern, actuator in given.items() if fnmatch.fnmatch(joint, pattern)]
        if len(matches) > 1:
            raise document.error("actuators", f"{joint} is given {len(matches)} times; expected at most once")
        found.append(matches[0] if matches else Actuator())
    return tuple(found)


def _parallel_pairs(
    document: config.Document, given: Sequence[ParallelPair], joints: Sequence[str]
) -> tuple[ParallelPair, ...]:
    for number, pair in enumerate(given):
        for field in ("pitch", "roll"):
            if getattr(pair, field) not in joints:
                raise document.error(
                    f"parallel_pairs[{number}].{field}", f"no joint {getattr(pair, field)!r} on the network"
                )
    return tuple(given)


def _cameras(document: config.Document, given: Sequence[Camera], tree: ET.Element) -> tuple[Camera, ...]:
    links = {link.get("name", "") for link in tree.findall("link")}
    for number, camera in enumerate(given):
        if camera.link not in links:
            raise document.error(f"cameras[{number}].link", f"no link {camera.link!r} in the URDF")
        if camera.name in {other.name for other in given[:number]}:
            raise document.error(f"cameras[{number}].name", f"got {camera.name!r} twice; expected a name of its own")
        if camera.near >= camera.far:
            raise document.error(
                f"cameras[{number}].near", f"got {camera.near:g} m; expected less than far, {camera.far:g}"
            )
    return tuple(given)


def _guard(document: config.Document, guard: Guarding, tree: ET.Element) -> Guarding:
    links = [link.get("name", "") for link in tree.findall("link")]
    for number, region in enumerate(guard.regions):
        field = f"guard.regions[{number}]"
        if region.frame not in links:
            raise document.error(f"{field}.frame", f"no link {region.frame!r} in the URDF")
        if region.name in {other.name for other in guard.regions[:number]}:
            raise document.error(f"{field}.name", f"got {region.name!r} twice; expected a name of its own")
        for pattern in region.links:
            if not fnmatch.filter(links, pattern):
                raise document.error(f"{field}.links", f"{pattern!r} matches no link of the URDF")
        if isinstance(region, HalfSpace) and not any(region.normal):
            raise document.error(f"{field}.normal", "got no direction; expected a vector to the side that is free")
    return guard


def _limits(tree: ET.Element) -> dict[str, tuple[float, float, float, float]]:
    """joint → lower, upper (rad), velocity (rad/s), effort (N·m), of every moving joint."""
    limits = {}
    for joint in tree.findall("joint"):
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


def _integral(document: config.Document, given: IntegralFile | None, joints: Sequence[str]) -> IntegralGains | None:
    if given is None:
        return None
    if given.backlash is not None and given.friction is None:
        raise document.error(
            "control.integral.backlash", "is given without friction; expected both: one is judged by the other"
        )
    fields = {name: values for name, values in msgspec.structs.asdict(given).items() if values is not None}
    return IntegralGains(
        **{name: _per_joint(document, f"control.integral.{name}", values, joints) for name, values in fields.items()}
    )


def _arms(
    document: config.Document, file: RobotFile, groups: dict[str, tuple[str, ...]], tree: ET.Element
) -> dict[str, Arm]:
    tools = {tool.name: tool for tool in file.model.tools}
    links = {link.get("name", "") for link in tree.findall("link")}
    limits = _limits(tree)
    driven = {device.joint: limits[device.joint] for device in file.network.devices if device.joint in limits}
    arms = {}
    for name, arm in file.arms.items():
        if unknown := [group for group in arm.groups if group not in groups]:
            raise document.error(
                f"arms.{name}.groups", f"no group {unknown[0]!r}; expected some of {', '.join(groups)}"
            )
        if arm.tool not in links:
            raise document.error(
                f"arms.{name}.tool",
                f"got {arm.tool!r}; expected a link of the URDF or one of model.tools ({', '.join(tools) or 'none'})",
            )
        if not arm.tip and arm.tool not in tools:
            raise document.error(
                f"arms.{name}.tip", f"expected the frame where {arm.tool} touches: it is no model tool"
            )
        if arm.tip and arm.tip not in links:
            raise document.error(f"arms.{name}.tip", f"no link {arm.tip!r} in the URDF")
        chain = tuple(joint for group in arm.groups for joint in groups[group])
        side: Literal["", "left", "right"] = "left" if name == "left" else "right" if name == "right" else ""
        _check_hand_poses(document, f"arms.{name}.hand_poses", arm.hand_poses, driven)
        arms[name] = Arm(
            name,
            chain,
            arm.tool,
            arm.tip or tools[arm.tool].tip_frame,
            side if arm.side is None else arm.side,
            arm.palm,
            arm.hand_poses,
        )
    return arms


def _check_hand_poses(
    document: config.Document,
    field: str,
    poses: dict[str, dict[str, float]],
    driven: dict[str, tuple[float, float, float, float]],
) -> None:
    for pose, positions in poses.items():
        for joint, position in positions.items():
            if joint not in driven:
                raise document.error(
                    f"{field}.{pose}.{joint}", f"no gripper moves it; expected one of {', '.join(driven) or 'none'}"
                )
            low, high = driven[joint][:2]
            if not low <= position <= high:
                raise document.error(f"{field}.{pose}.{joint}", f"got {position:g}; expected {low:.4g} to {high:.4g}")


def _home(
    document: config.Document, file: RobotFile, joints: Sequence[str], lower: np.ndarray, upper: np.ndarray
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
