"""A robot's folder, read and checked: model, network, limbs, groups, arms, limits, gains, home postures.

Needs no kinematics library: the tablet reads it too. Every array has one row a joint, in the order of
`RobotDescription.joints`, which is the order of the limbs on the network.
"""

from __future__ import annotations

import dataclasses
import fnmatch
import os
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, overload

import msgspec
import numpy as np

from handrail import config, workspace
from handrail.robot import urdf
from handrail.robot.guarding import Guarding, HalfSpace

Positive = Annotated[float, msgspec.Meta(gt=0)]
NonNegative = Annotated[float, msgspec.Meta(ge=0)]


class Channel(msgspec.Struct, kw_only=True, forbid_unknown_fields=True, frozen=True):
    """One CAN bus. `interface`: `handrail` is the virtual hub, any other name is python-can's."""

    name: str
    interface: str
    bitrate: Annotated[int, msgspec.Meta(gt=0)]
    data_bitrate: Annotated[int, msgspec.Meta(gt=0)]
    channel: str = ""
    """of a real interface: python-can's name of the channel, e.g. PCAN_USBBUS1; default: `name`"""
    options: dict[str, str | int | float | bool] = {}
    """of a real interface: handed to `can.Bus` as they are, after what `hal.can.real_port` gives it"""


class _LimbFile(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    name: str
    channel: str
    joints: Annotated[list[str], msgspec.Meta(min_length=1, max_length=7)]
    family: str = "limb_fd"
    answer: Literal["drives", "master"] = "drives"


class SensorNoise(msgspec.Struct, kw_only=True, forbid_unknown_fields=True, frozen=True):
    """What a simulated sensor adds to the truth. Left out: what is usual for its family (hal.plant.sensor_noise)."""

    angular_velocity: NonNegative | None = None
    """imu: rad/s/√Hz, density of white noise"""
    angular_velocity_bias: NonNegative | None = None
    """imu: rad/s, from which a constant offset is drawn (σ)"""
    linear_acceleration: NonNegative | None = None
    """imu: m/s²/√Hz"""
    linear_acceleration_bias: NonNegative | None = None
    """imu: m/s²"""
    force: NonNegative | None = None
    """force_torque: N/√Hz"""
    force_bias: NonNegative | None = None
    """force_torque: N"""
    torque: NonNegative | None = None
    """force_torque: N·m/√Hz"""
    torque_bias: NonNegative | None = None
    """force_torque: N·m"""


USUAL_NOISE = SensorNoise()
_NOISY = {"imu": ("angular_velocity", "linear_acceleration"), "force_torque": ("force", "torque")}
"""family → what its sensors measure with noise"""


class _DeviceFile(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    name: str
    family: str
    channel: str
    link: str = ""
    joint: str = ""
    noise: SensorNoise = USUAL_NOISE


class _Network(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    channels: Annotated[list[Channel], msgspec.Meta(min_length=1)]
    limbs: Annotated[list[_LimbFile], msgspec.Meta(min_length=1, max_length=8)]
    devices: Annotated[list[_DeviceFile], msgspec.Meta(max_length=32)] = []


class Actuator(msgspec.Struct, kw_only=True, forbid_unknown_fields=True, frozen=True):
    """What is known of one joint's actuator; what is left out follows from its rated torque (hal.plant.actuator)."""

    spring_stiffness: Positive | None = None
    """N·m/rad, at the joint"""
    rotor_inertia: Positive | None = None
    """kg·m², behind the gear"""
    rotor_damping: Positive | None = None
    """N·m·s/rad, behind the gear"""
    gear_ratio: Positive | None = None
    torque_constant: Positive | None = None
    """N·m/A, of the motor"""
    current_limit: Positive | None = None
    """A"""
    friction: NonNegative = 0.0
    """N·m, Coulomb friction at the joint, after the spring"""
    backlash: NonNegative = 0.0
    """rad, of the gear, seen at the joint"""
    encoder_bits: Annotated[int, msgspec.Meta(ge=8, le=32)] = 19
    """a turn of the joint"""
    encoder_noise: NonNegative = 0.0
    """rad, standard deviation"""
    encoder_offset: float = 0.0
    """rad by which the uncalibrated encoder reads too much"""
    servo: Literal["joint", "motor"] = "joint"
    """where the angle is measured that the drive's own loops close on: by the encoder at the joint, or at the motor, before gear
    and backlash, less what the spring is wound up by. What the drive reports to the host is the encoder's either way."""
    motor_offset: float = 0.0
    """rad by which the angle measured at the motor, seen at the joint, is too much: its calibration's error"""


class ParallelPair(msgspec.Struct, kw_only=True, forbid_unknown_fields=True, frozen=True):
    """Two linear actuators side by side that together move pitch and roll (Radford et al. 2015, §2.2: ankles, waist, wrists).

    Each rod runs from a universal joint on the fixed side to a ball joint on the moving side. Positions are m, in a frame at
    the crossing of the two axes, x forward, y left, z up, with both joints at zero.
    """

    name: str
    pitch: str
    """joint about y"""
    roll: str
    """joint about x"""
    fixed_ends: tuple[tuple[float, float, float], tuple[float, float, float]]
    """m, of the left and the right rod"""
    moving_ends: tuple[tuple[float, float, float], tuple[float, float, float]]
    """m, of the left and the right rod"""


class Camera(msgspec.Struct, kw_only=True, forbid_unknown_fields=True, frozen=True):
    """A depth camera, looking along its link's +x with z up (REP 103's body axes) unless `optical`, then +z with y down."""

    name: str
    link: str
    optical: bool = False
    width: Annotated[int, msgspec.Meta(ge=16, le=1280)] = 320
    height: Annotated[int, msgspec.Meta(ge=16, le=1024)] = 240
    rate: Positive = 2.0
    """Hz"""
    field_of_view: Annotated[float, msgspec.Meta(gt=0.1, lt=3.0)] = 1.02
    """rad, across the width"""
    near: Positive = 0.1
    """m"""
    far: Positive = 4.0
    """m"""


class Palm(msgspec.Struct, kw_only=True, forbid_unknown_fields=True, frozen=True):
    """Where the hand that templates mean is in an arm's tip frame: it points along its −z, its fingers close along its y."""

    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """m"""
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """rad"""


_AT_THE_TIP = Palm()


class _ArmFile(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    groups: list[str]
    tool: str
    tip: str = ""
    side: Literal["", "left", "right"] | None = None
    palm: Palm = _AT_THE_TIP
    hand_poses: dict[str, dict[str, float]] = {}


class _Integral(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    rate: dict[str, Positive]
    limit: dict[str, Positive]
    push: dict[str, Positive]
    band: dict[str, Positive]
    friction: dict[str, Positive] | None = None
    backlash: dict[str, Positive] | None = None


class _Control(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    period: Positive
    watchdog_cycles: Annotated[int, msgspec.Meta(ge=1, le=255)]
    stop_after_misses: Annotated[int, msgspec.Meta(ge=0)] = 0
    damping_ratio: Positive
    torque_rate: Positive
    acceleration: Positive = 6.0
    jerk: Positive = 100.0
    stiffness: dict[str, Positive]
    quick_stop_damping: dict[str, Positive]
    integral: _Integral | None = None


class _FootFile(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    link: str
    size: tuple[Positive, Positive]


class _RobotFile(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    name: str
    model: urdf.Model
    network: _Network
    groups: dict[str, list[str]]
    arms: dict[str, _ArmFile]
    control: _Control
    allowed_collision_pairs: list[tuple[str, str]] = []
    guard: Guarding = Guarding()
    home: dict[str, dict[str, float]]
    base: Literal["fixed", "free"] = "fixed"
    support: Literal["gantry", "hoist", "none"] = "none"
    floor: float | None = None
    feet: dict[str, _FootFile] = {}
    actuators: dict[str, Actuator] = {}
    parallel_pairs: list[ParallelPair] = []
    cameras: list[Camera] = []


@dataclass(frozen=True)
class Limb:
    """Up to seven drives on one bus segment; `index` is its number in the frames' identifiers."""

    name: str
    index: int
    channel: str
    joints: tuple[str, ...]
    family: str = "limb_fd"
    """drive family: a folder of hal/drives"""
    answer: Literal["drives", "master"] = "drives"
    """who answers a command: each drive with a frame of its own, or the limb's master for all its axes in one"""


@dataclass(frozen=True)
class Device:
    """A node of the network that is no joint: its `index` counts the devices of its family, as their identifiers do."""

    name: str
    family: str
    """imu, force_torque, gripper, power, or any other folder of hal/drives that describes devices"""
    index: int
    channel: str
    link: str
    """imu, force_torque: the URDF link whose frame it measures in"""
    joint: str
    """gripper: the joint that its one drive moves; others mimic it"""
    noise: SensorNoise = USUAL_NOISE
    """imu, force_torque: what the simulated one adds to the truth"""


@dataclass(frozen=True)
class Foot:
    """What a robot with a free base stands on. `link`: its frame is in the middle of the flat sole, z up, x forwards."""

    name: str
    link: str
    size: tuple[float, float]
    """m, length and width of the sole"""


@dataclass(frozen=True)
class Mimic:
    """A joint without a drive: its position is multiplier × the position of `joint` + offset (URDF's <mimic>)."""

    joint: str
    multiplier: float
    offset: float
    """rad or m"""


@dataclass(frozen=True)
class Arm:
    """A chain that carries a tool. `tip`: frame at the contact point, the tool pointing along its −z."""

    name: str
    joints: tuple[str, ...]
    tool: str
    tip: str
    side: Literal["", "left", "right"] = ""
    """of the body; empty: of neither"""
    palm: Palm = _AT_THE_TIP
    hand_poses: Mapping[str, Mapping[str, float]] = dataclasses.field(default_factory=dict)
    """name → joint that a gripper drives → rad or m"""


@dataclass(frozen=True)
class IntegralGains:
    """The integral on the joint encoders' error around the drives' own loops (daemon.controllers.outer_integral), arrays (n,)."""

    rate: np.ndarray
    """1/s"""
    limit: np.ndarray
    """rad by which it may move a drive's set-point"""
    push: np.ndarray
    """N·m, spring torque beyond gravity above which it takes a joint to lean on something, and pushes no harder"""
    band: np.ndarray
    """rad, error that it leaves alone"""
    friction: np.ndarray | float = 0.0
    """N·m, Coulomb friction as far as it is known, which is fed forward; 0: it is not"""
    backlash: np.ndarray | float = 0.0
    """rad, of the gear, as far as it is known, which is fed forward; 0: it is not"""


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
    acceleration_limit: np.ndarray
    """rad/s² (n,), for references on their way: plans, and what an operator changes in mid-motion"""
    jerk_limit: np.ndarray
    """rad/s³ (n,), likewise"""
    stiffness: np.ndarray
    """N·m/rad (n,), joint impedance in the drives"""
    damping_ratio: float
    quick_stop_damping: np.ndarray
    """N·m·s/rad (n,)"""
    integral: IntegralGains | None
    """none: off"""
    home: dict[str, dict[str, float]]
    period_ns: int
    watchdog_cycles: int
    stop_after_misses: int
    """periods that the loop may miss in a row, on the wall clock, before it stops the robot; 0: any number"""
    allowed_collision_pairs: tuple[tuple[str, str], ...]
    guard: Guarding
    base: Literal["fixed", "free"]
    support: Literal["gantry", "hoist", "none"]
    """what holds a free base in the plant; a gantry lets it neither move nor turn"""
    floor: float | None
    """m, height of the plant's floor below the base's frame at the start; none: there is no floor"""
    feet: tuple[Foot, ...]
    devices: tuple[Device, ...]
    """in the order of robot.yaml"""
    mimics: dict[str, Mimic]
    """joint → what it follows"""
    device_limits: dict[str, tuple[float, float, float, float]]
    """joint moved by a gripper → lower, upper (rad or m), velocity (/s), effort (N·m or N)"""
    actuators: tuple[Actuator, ...]
    """one a joint"""
    parallel_pairs: tuple[ParallelPair, ...]
    cameras: tuple[Camera, ...]

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

    @property
    def limb_of_joint(self) -> np.ndarray:
        """(n,) the row in `limbs` that carries each joint."""
        rows = {joint: row for row, limb in enumerate(self.limbs) for joint in limb.joints}
        return np.array([rows[joint] for joint in self.joints], dtype=np.intp)

    def home_position(self, name: str = "ready") -> np.ndarray:
        """A home posture as rad (n,). Raises KeyError when there is none of that name."""
        return np.array([self.home[name][joint] for joint in self.joints])


def _folders() -> list[Path]:
    return workspace.search_path("robots", "hal", "robots")


def library() -> dict[str, Path]:
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
        f"no such robot; expected one of {', '.join(sorted(library()))}, or a folder with robot.yaml",
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
    file = document.convert(_RobotFile)
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
    document: config.Document, file: _RobotFile, tree: ET.Element, channels: set[str], mimics: dict[str, Mimic]
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


def _feet(document: config.Document, file: _RobotFile, tree: ET.Element) -> tuple[Foot, ...]:
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


def _integral(document: config.Document, given: _Integral | None, joints: Sequence[str]) -> IntegralGains | None:
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
    document: config.Document, file: _RobotFile, groups: dict[str, tuple[str, ...]], tree: ET.Element
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
