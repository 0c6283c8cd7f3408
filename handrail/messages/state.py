"""What the daemon tells of the robot: its joints, its base, its drives, its own health."""

from __future__ import annotations

from typing import Literal

import msgspec

from handrail.messages.base import Message, Pose, travels


class Foot(msgspec.Struct, kw_only=True):
    """One foot, as it is felt."""

    name: str
    holds: bool
    """it bears more than a small share of the robot's weight"""
    force: tuple[float, float, float]
    """N, world axes, that the ground exerts on it"""


@travels(priority=4, reliable=False, superseded_by=("type",))
class Base(Message):
    """Where the robot's base is: its root link, in the world. Answer to GetBase, and part of RobotState where it is not fixed."""

    time_ns: int
    pose_in_world: Pose
    linear_velocity: tuple[float, float, float]
    """m/s, of its origin, in its own axes"""
    angular_velocity: tuple[float, float, float]
    """rad/s, likewise"""
    position_deviation: float
    """m, standard deviation of all three axes together"""
    orientation_deviation: float
    """rad, likewise"""
    source: Literal["fixed", "feet", "still", "inertial", "none"]
    """what tells: nothing has to, the base is fixed; feet that hold; that the robot hangs still; the inertial sensor alone, and
    errors grow; nothing, and the pose is the last that was known"""
    problem: str = ""
    """why there is none, in words"""
    since_ns: int = 0
    """robot's clock, since when source and problem are these"""
    feet: list[Foot] = []


@travels(priority=4, reliable=False, superseded_by=("type",), remote=True)
class RobotState(Message):
    """The robot at one cycle. Arrays have one row a joint, in the order of RobotInfo.joints."""

    time_ns: int
    cycle: int
    position: list[float]
    """rad, measured at the joint"""
    velocity: list[float]
    """rad/s"""
    torque: list[float]
    """N·m, the drive's spring"""
    command: list[float]
    """rad, what the drives were last commanded to hold or follow"""
    external_force: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """N, world frame, estimated at the tool of the active action (zero without one)"""
    base: Base | None = None
    """none: it is fixed, and its frame is the world's"""

    @property
    def base_in_world(self) -> Pose:
        """The base's pose, fixed or not."""
        return Pose() if self.base is None else self.base.pose_in_world


class DriveStatus(msgspec.Struct, kw_only=True):
    """One joint's drive."""

    joint: str
    state: str
    """CiA 402 state, e.g. operation_enabled"""
    error: int = 0
    temperature: float = 0.0
    """°C"""
    problem: str = ""
    """what is wrong with it, in words, with the channel where it does not answer; empty: nothing"""


class LoopStatistics(msgspec.Struct, kw_only=True):
    """Counted since the loop started."""

    cycles: int = 0
    misses: int = 0
    """periods skipped because a cycle overran (wall clock)"""
    stale_replies: int = 0
    """drive replies that came later than usual on their channel: usual is what its promptest drive has done for 50 cycles"""
    crc_errors: int = 0
    work_p50_us: float = 0.0
    work_p99_us: float = 0.0
    late_p50_us: float = 0.0
    late_p99_us: float = 0.0
    limited: int = 0
    """cycles in which the final limits changed a command"""


class BusStatistics(msgspec.Struct, kw_only=True):
    """One CAN bus, as the daemon sees it."""

    channel: str
    frames_sent: int = 0
    frames_received: int = 0
    load: float = 0.0
    """share of the bus's time in use, 0..1, over the last second of the robot's clock"""
    state: str = ""
    """of the daemon's own node there: error_active, error_passive, bus_off or cut, of SocketCAN also stopped or sleeping; empty
    where that is not known"""


class DeviceStatus(msgspec.Struct, kw_only=True):
    """One node of the network that is no joint."""

    name: str
    family: str
    problem: str = ""
    """what is wrong with it, in words; empty: nothing. It does not keep the robot from being enabled"""


class LeaseState(msgspec.Struct, kw_only=True):
    """Who may command a part of the body."""

    part: str
    """body, a group of the robot, or a gripper"""
    owner: str
    epoch: int
    """goes up with every lease that is given"""


@travels(priority=3, reliable=False, superseded_by=("type",), remote=True)
class DaemonStatus(Message):
    """What the daemon is doing; several times a second and at every change."""

    time_ns: int
    clock: Literal["wall", "lockstep"]
    enabled: bool
    """True when every drive is in operation enabled and a controller is active, those of `isolated` limbs aside"""
    stopped: bool
    """the operator stop is latched"""
    drives: list[DriveStatus]
    controllers: dict[str, list[str]]
    """active controller → joints that it claims"""
    loop: LoopStatistics
    buses: list[BusStatistics]
    stop_reason: str = ""
    action: str = ""
    """id of the running action, the first of them where there are several"""
    actions: list[str] = []
    """ids of all running actions"""
    speed: float = 1.0
    """share of the planned speed that every motion runs at (SetSpeed)"""
    holds: list[str] = []
    """who holds simulated time"""
    leases: list[LeaseState] = []
    """who has taken which part of the body; nobody: anybody may command it"""
    isolated: list[str] = []
    """limbs of an enabled robot that are out of it, since one of their drives failed: they are stopped, the rest is held and may be
    moved. Enable takes them back in"""
    devices: list[DeviceStatus] = []
    """those of the robot's network, in the order of its description"""
    processes: dict[str, str] = {}
    """process of the robot's service → `up`, `starting`, or what happened to it; empty where nobody supervises"""
