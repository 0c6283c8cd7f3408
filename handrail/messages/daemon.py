"""Calls to the daemon about robot, drives, controllers, safety and devices, and their answers."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from handrail.messages.base import Message, Name, NonNegative, Positive, travels


@travels(priority=1, remote=True)
class GetRobot(Message):
    """Which robot is this?"""


class RobotInfo(Message):
    """Answer to GetRobot."""

    name: str
    joints: list[str]
    lower: list[float]
    upper: list[float]
    """rad"""
    velocity_limit: list[float]
    torque_limit: list[float]
    groups: dict[str, list[str]]
    tools: dict[str, str]
    """arm → tool frame"""
    tips: dict[str, str]
    """arm → frame at its tool's contact point"""
    arms: dict[str, list[str]]
    """arm → its joints, from the base on"""
    home: dict[str, dict[str, float]]
    """posture name → joint → rad"""
    period_ns: int


@travels(priority=1, remote=True)
class GetStatus(Message):
    """The daemon's present status."""


@travels(priority=1)
class GetTiming(Message):
    """How long the loop's cycles work and how late they start. Refused while no loop runs."""

    reset: bool = False
    """count anew from here on"""


@travels(priority=1)
class GetBase(Message):
    """Where the base is, and which feet hold. Refused while no loop runs."""


class TimeDistribution(msgspec.Struct, kw_only=True):
    """How often a time was how long."""

    counts: list[int]
    """one a bin of LoopTiming.edges_us, from below the first edge to above the last"""
    p50_us: float
    p90_us: float
    p99_us: float
    """at most: the upper edge of the bin in which it lies, an eighth more than its lower edge or less"""
    max_us: float


class LoopTiming(Message):
    """Answer to GetTiming: counted since the loop's start, or the last reset."""

    clock: Literal["wall", "lockstep"]
    period_us: float
    cycles: int
    misses: int
    """periods skipped because a cycle overran"""
    longest_run: int
    """most periods that were skipped without a punctual cycle in between"""
    overrun_policy: str
    """in words"""
    edges_us: list[float]
    work: TimeDistribution
    """from the cycle's start (lock-step: from the drives' answer) until its frames were sent"""
    late: TimeDistribution
    """from the cycle's deadline to its start; empty in lock-step"""


@travels(priority=1)
class GetHardware(Message):
    """Every drive and device of the robot, as it stands now."""


class HardwareComponent(msgspec.Struct, kw_only=True):
    """A drive or a device."""

    name: str
    """joint or device"""
    family: str
    channel: str
    bus_state: str
    """of the daemon's own node on that channel, as in BusStatistics"""
    life: str
    """ros2_control's word: active, inactive, unconfigured (does not answer) or unknown (no loop runs)"""
    state: str = ""
    """of drives and grippers: CiA 402 state, e.g. operation_enabled"""
    error: int = 0
    temperature: float | None = None
    """°C, where it is measured"""
    age: int | None = None
    """cycles since its last answer"""
    firmware_version: int | None = None
    protocol_version: int | None = None
    """what it says of itself; None: nothing (yet)"""
    problem: str = ""
    """in words; empty: nothing"""


class HardwareStatus(Message):
    """Answer to GetHardware: drives in the order of RobotInfo.joints, then devices."""

    components: list[HardwareComponent]


@travels(priority=1)
class GetControllers(Message):
    """Which controllers are loaded or active, and which could be loaded."""


class ControllerInfo(msgspec.Struct, kw_only=True):
    """A controller that was loaded by name, or that the daemon runs by itself (`hold`, and those of actions)."""

    name: str
    kind: str
    state: str
    """ros2_control's word: unconfigured, inactive or active; `loading` on the way from one to the next"""
    joints: list[str]
    """that it claims, or will"""
    interfaces: list[str]
    """what it claims of them: position, velocity, torque, stiffness, damping"""
    onto: str = ""
    """the controller whose references it commands instead of the robot; empty: the robot"""
    references: list[str] = []
    """what others may command of it"""
    fallback: list[str] = []
    """which controllers take over when it fails; what they leave over is held"""
    parameters: dict[str, Any] = {}
    error: str = ""
    """why it could not be loaded or configured, or failed since, with the traceback"""
    since_ns: int = 0
    """robot's clock, when it came to this state; 0: not known, of what the daemon runs by itself"""
    why: str = ""
    """inactive: what took it out of service, and what to do; empty: it has not been active since it was made"""


class ControllerList(Message):
    """Answer to GetControllers."""

    controllers: list[ControllerInfo]
    kinds: list[str]
    """what may be loaded: built in, and the files of the workspace's folder `controllers`"""
    lost: dict[str, str] = {}
    """what could not be loaded lately, and why"""
    time_ns: int = 0
    """robot's clock, now"""


@travels(priority=1)
class LoadController(Message):
    """Load a controller by name, so that it can be switched on later. It is imported, made and tried beside the loop, which goes
    on: the answer comes at once, a ControllerEvent when it is there, or why it is not (GetControllers tells, too).
    """

    name: Name
    """by which it is called from then on"""
    kind: Name
    """one of ControllerList.kinds"""
    joints: list[Name]
    """that it will claim"""
    parameters: dict[str, Any] = {}
    """what its kind takes"""
    onto: str = ""
    """a loaded controller with references, which it will command instead of the robot"""
    fallback: list[Name] = []
    """loaded controllers that take over in the cycle in which it fails; what they leave over is held"""
    configure: bool = True
    """False: it stays unconfigured until ConfigureController"""


@travels(priority=1)
class ConfigureController(Message):
    """Make a loaded controller anew, which is not active, beside the loop; it is inactive then. Answered as LoadController is."""

    name: Name
    parameters: dict[str, Any] | None = None
    """None: as before"""


@travels(priority=1)
class SwitchControllers(Message):
    """Start and end loaded controllers, all of them in one cycle or, refused, none. What is left over is held, without a jump."""

    activate: list[Name] = []
    deactivate: list[Name] = []
    owner: str = ""
    """who asks; counts only where somebody has taken a part that one of these moves"""
    lease: int = 0
    """epoch of `owner`'s newest lease; counts only where somebody has taken a part that this moves (TakeLease)"""
    sequence: int = 0
    """likewise: number of the command, higher than of all before it under that lease"""


@travels(priority=1)
class UnloadController(Message):
    """Forget a loaded controller that is not active, and that no active one falls back to or rests on."""

    name: Name


@travels(priority=2, remote=True)
class ControllerEvent(Message):
    """A controller was loaded, made or lost, or something else than a switch deactivated it; switches are told in
    DaemonStatus.controllers."""

    name: str
    state: Literal["loading", "unconfigured", "inactive", "finalized"]
    """that it is in now; finalized: it could not be loaded, and is forgotten"""
    time_ns: int
    cycle: int
    detail: str = ""
    """what it raised, with the traceback, or what deactivated it; empty: all is well"""


@travels(priority=1, remote=True)
class GetSafety(Message):
    """Which safety rule holds the robot now, and which have tripped. Refused while no loop runs."""


class SafetyRule(msgspec.Struct, kw_only=True):
    """A safety rule that has tripped since the loop's start (docs/safety.md has all of them)."""

    rule: str
    """e.g. operator_stop, drive_fault, torque_rate"""
    holds: bool
    """it holds the robot now, or cuts its set-points in this cycle"""
    times: int
    """how often it has tripped; a limit that cuts in many cycles on end does so once"""
    last_time_ns: int
    """robot's clock"""
    joint: str = ""
    detail: str = ""
    """of the last time, in words"""
    does: str
    recover: str


class SafetyReport(Message):
    """Answer to GetSafety."""

    robot: str
    time_ns: int
    """robot's clock, now"""
    state: Literal["stopped", "enabled", "enabling", "inactive"]
    rules: list[SafetyRule]
    """the strongest first"""


@travels(priority=1, remote=True)
class Enable(Message):
    """Take every drive to operation enabled and hold where it is. Refused while the stop is latched."""


@travels(priority=1, remote=True)
class Disable(Message):
    """Take every drive out of operation (brakes close)."""


@travels(priority=0, remote=True)
class Stop(Message):
    """Operator stop: every drive quick-stops within two cycles; latches until ClearStop."""

    reason: Annotated[str, Meta(max_length=200)] = ""


@travels(priority=1, remote=True)
class ClearStop(Message):
    """Unlatch the operator stop. Nothing moves: Enable follows deliberately."""


@travels(priority=1, remote=True)
class CommandGripper(Message):
    """Send a gripper to a position; it goes on closing or opening until it is there, or stands against something.

    Refused where the robot is not enabled, the gripper does not answer, or a value is beyond its limits.
    """

    gripper: Name
    position: float
    """rad or m, of the driven joint"""
    velocity: NonNegative = 0.0
    """rad/s or m/s, at most; 0: its limit"""
    effort: NonNegative = 0.0
    """N·m or N, at most; 0: its limit"""
    owner: str = ""
    """who asks; counts only where somebody has taken the gripper's part. Over the link: the key's name, or that and more behind a
    slash (`anna/tablet`); left out, the name"""
    lease: int = 0
    """epoch of `owner`'s newest lease; counts only where somebody has taken a part that this moves (TakeLease)"""
    sequence: int = 0
    """likewise: number of the command, higher than of all before it under that lease"""
    by: Annotated[str, Meta(max_length=128)] = ""
    """whose key it came with, as the link's gate says it; empty: from the robot's own machine"""


@travels(priority=1, remote=True)
class SwitchRelay(Message):
    """Open or close the relay of a power supply; it stays so until it is switched again.

    Open, the drives have no power: they fault, and their brakes close. Closed again they stay where they are until Enable. Refused
    where the supply does not answer, and where it should open while the robot is enabled, or about to be.
    """

    power: Name
    closed: bool
    force: bool = False
    """open it though the robot is enabled"""


@travels(priority=1)
class TareSensor(Message):
    """Let a force-torque sensor forget its offset, until the loop ends: what it tells beyond the weight of what it carries.

    Answered with Tared. Refused where the robot is not enabled, a joint moves, the sensor does not answer, or the joints feel more
    than 5 N or 1 N·m on what the sensor carries; and where 0.4 s of the robot's clock don't go by in 1.5 s: call again.
    """

    sensor: Name


class Tared(Message):
    """The answer to TareSensor."""

    sensor: Name
    offset: float
    """N that it told too much, or from another side"""


@travels(priority=1)
class HoldTime(Message):
    """Lock-step only: hold simulated time for `owner`, at most `limit_s` of wall time. Under the wall clock nothing happens."""

    owner: Name
    limit_s: Positive


@travels(priority=1)
class ReleaseTime(Message):
    """End `owner`'s hold."""

    owner: Name
