"""A `robot.yaml` as it stands in the file (docs/robots.md); `handrail.robot.library` checks it against the model."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from handrail.robot import urdf
from handrail.robot.description import (
    AT_THE_TIP,
    USUAL_NOISE,
    Actuator,
    Camera,
    Channel,
    Palm,
    ParallelPair,
    Positive,
    SensorNoise,
)
from handrail.robot.guarding import Guarding


class LimbFile(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    name: str
    channel: str
    joints: Annotated[list[str], msgspec.Meta(min_length=1, max_length=7)]
    family: str = "limb_fd"
    answer: Literal["drives", "master"] = "drives"


class DeviceFile(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    name: str
    family: str
    channel: str
    link: str = ""
    joint: str = ""
    noise: SensorNoise = USUAL_NOISE


class NetworkFile(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    channels: Annotated[list[Channel], msgspec.Meta(min_length=1)]
    limbs: Annotated[list[LimbFile], msgspec.Meta(min_length=1, max_length=8)]
    devices: Annotated[list[DeviceFile], msgspec.Meta(max_length=32)] = []


class ArmFile(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    groups: list[str]
    tool: str
    tip: str = ""
    side: Literal["", "left", "right"] | None = None
    palm: Palm = AT_THE_TIP
    hand_poses: dict[str, dict[str, float]] = {}


class IntegralFile(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    rate: dict[str, Positive]
    limit: dict[str, Positive]
    push: dict[str, Positive]
    band: dict[str, Positive]
    friction: dict[str, Positive] | None = None
    backlash: dict[str, Positive] | None = None


class ControlFile(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    period: Positive
    watchdog_cycles: Annotated[int, msgspec.Meta(ge=1, le=255)]
    stop_after_misses: Annotated[int, msgspec.Meta(ge=0)] = 0
    damping_ratio: Positive
    torque_rate: Positive
    acceleration: Positive = 6.0
    jerk: Positive = 100.0
    stiffness: dict[str, Positive]
    quick_stop_damping: dict[str, Positive]
    integral: IntegralFile | None = None


class FootFile(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    link: str
    size: tuple[Positive, Positive]


class RobotFile(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    name: str
    model: urdf.Model
    network: NetworkFile
    groups: dict[str, list[str]]
    arms: dict[str, ArmFile]
    control: ControlFile
    allowed_collision_pairs: list[tuple[str, str]] = []
    guard: Guarding = Guarding()
    home: dict[str, dict[str, float]]
    base: Literal["fixed", "free"] = "fixed"
    support: Literal["gantry", "hoist", "none"] = "none"
    floor: float | None = None
    feet: dict[str, FootFile] = {}
    actuators: dict[str, Actuator] = {}
    parallel_pairs: list[ParallelPair] = []
    cameras: list[Camera] = []
