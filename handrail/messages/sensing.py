"""What the robot's devices and cameras measure."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from handrail.messages.base import Message, Name, Positive, travels


class ImuState(msgspec.Struct, kw_only=True):
    """An inertial measurement unit, in the frame of its link."""

    name: str
    age: int
    """cycles since its last frame"""
    orientation: tuple[float, float, float, float]
    """quaternion (x, y, z, w) of the link in the world"""
    angular_velocity: tuple[float, float, float]
    """rad/s"""
    linear_acceleration: tuple[float, float, float]
    """m/s², with gravity: +9.81 upwards at rest (REP 145)"""


class ForceTorqueState(msgspec.Struct, kw_only=True):
    """A force-torque sensor, in the frame of its link: what acts on the robot beyond it."""

    name: str
    age: int
    force: tuple[float, float, float]
    """N"""
    torque: tuple[float, float, float]
    """N·m"""


class GripperState(msgspec.Struct, kw_only=True):
    """An under-actuated gripper: one drive; its other joints mimic it."""

    name: str
    age: int
    joint: str
    position: float
    """rad or m, of the driven joint"""
    velocity: float
    effort: float
    """N·m or N"""
    temperature: float
    """°C"""
    state: str
    """CiA 402 state, e.g. operation_enabled"""
    holding: bool
    """it stands still at its effort limit, short of where it was sent: something is in it"""


class PowerState(msgspec.Struct, kw_only=True):
    """The robot's power: battery and relay."""

    name: str
    age: int
    voltage: float
    """V"""
    current: float
    """A"""
    charge: float
    """0..1"""
    temperature: float
    """°C"""
    relay: bool
    """closed: the drives have power"""


class DeviceValues(msgspec.Struct, kw_only=True):
    """A device of any other family: the columns that its description names."""

    name: str
    age: int
    family: str
    columns: list[str]
    values: list[float]
    """one a column, in the units that the family's description states"""


@travels(priority=4, reliable=False, superseded_by=("type",), remote=True)
class DeviceStates(Message):
    """Every node of the network that is no joint, at one cycle."""

    time_ns: int
    imus: list[ImuState] = []
    force_torques: list[ForceTorqueState] = []
    grippers: list[GripperState] = []
    powers: list[PowerState] = []
    others: list[DeviceValues] = []


@travels(priority=6, reliable=False, superseded_by=("camera",), remote=True)
class PointCloud(Message):
    """What a depth camera sees, as points in the world. Compressed already: `points` is zstd of little-endian int16 (n, 3)."""

    camera: Name
    time_ns: int
    """when the picture was taken"""
    resolution: Positive
    """m for 1 in `points`"""
    origin: tuple[float, float, float]
    """m, world frame: what (0, 0, 0) in `points` stands for"""
    count: Annotated[int, Meta(ge=0, le=2_000_000)]
    """points"""
    points: bytes
    colours: bytes = b""
    """zstd of uint8 (n, 3) red, green, blue; empty where the camera has none"""
