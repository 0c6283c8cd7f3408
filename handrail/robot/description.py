"""What a robot is: model, network, limbs, groups, arms, limits, gains, home postures.

Needs no kinematics library: the tablet reads it too. Every array has one row a joint, in the order of
`RobotDescription.joints`, which is the order of the limbs on the network. `handrail.robot.library` reads it from a robot's folder.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, overload

import msgspec
import numpy as np

from handrail.robot.guarding import Guarding

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


AT_THE_TIP = Palm()


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
    palm: Palm = AT_THE_TIP
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
