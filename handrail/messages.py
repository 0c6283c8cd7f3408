"""Every message that crosses a process, as typed structs in MessagePack.

SI units, radians, integer nanoseconds of the robot's clock. A pose is position and quaternion (x, y, z, w); a name says its
frame. Each type states in ``spec`` how it travels: its priority (0 first), whether it is reliable or latest-value, and which
field makes a newer message supersede an older one. Any MessagePack reader can read them: a struct is a map with its type's
name under ``type``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal, TypeVar

import msgspec
from msgspec import Meta

Name = Annotated[str, Meta(min_length=1, max_length=128)]
Positive = Annotated[float, Meta(gt=0)]
NonNegative = Annotated[float, Meta(ge=0)]
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Spec:
    """How a message travels."""

    priority: int = 5
    """0 is first: stop 0, commands 1, prompts and run states 2, robot state 4, logs 7."""
    reliable: bool = True
    """False: latest value only; an older one still unsent is dropped."""
    superseded_by: tuple[str, ...] = ()
    """A newer message of this type with the same values in these fields replaces this one (latest-value streams)."""
    remote: bool = False
    """True: may enter or leave through the link."""


_SPECS: dict[type, Spec] = {}
_M = TypeVar("_M", bound=type)


def _travels(
    *, priority: int, reliable: bool = True, superseded_by: tuple[str, ...] = (), remote: bool = False
) -> Callable[[_M], _M]:
    def note(kind: _M) -> _M:
        _SPECS[kind] = Spec(priority, reliable, superseded_by, remote)
        return kind

    return note


def spec(kind: type) -> Spec:
    """How messages of this type travel."""
    return _SPECS[kind]


class Message(msgspec.Struct, tag_field="type", tag=True, kw_only=True, forbid_unknown_fields=True):
    """Base of all messages."""

    Reply: ClassVar[Any] = None
    """For calls: the type of the answer (None: an empty answer)."""


# --------------------------------------------------------------------------------------------------------------- geometry


class Pose(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """position m, orientation unit quaternion (x, y, z, w)."""

    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    orientation: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)


# ------------------------------------------------------------------------------------------------------ daemon: state out


class Foot(msgspec.Struct, kw_only=True):
    """One foot, as it is felt."""

    name: str
    holds: bool
    """it bears more than a small share of the robot's weight"""
    force: tuple[float, float, float]
    """N, world axes, that the ground exerts on it"""


@_travels(priority=4, reliable=False, superseded_by=("type",))
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


@_travels(priority=4, reliable=False, superseded_by=("type",), remote=True)
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


@_travels(priority=3, reliable=False, superseded_by=("type",), remote=True)
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
    """id of the running action"""
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


@_travels(priority=4, reliable=False, superseded_by=("type",), remote=True)
class DeviceStates(Message):
    """Every node of the network that is no joint, at one cycle."""

    time_ns: int
    imus: list[ImuState] = []
    force_torques: list[ForceTorqueState] = []
    grippers: list[GripperState] = []
    powers: list[PowerState] = []
    others: list[DeviceValues] = []


@_travels(priority=6, reliable=False, superseded_by=("camera",), remote=True)
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


@_travels(priority=2, remote=True)
class ActionEvent(Message):
    """A change in an action's life. `ended` carries the outcome and the robot in the cycle that ended it."""

    id: str
    state: Literal["running", "paused", "ended"]
    time_ns: int
    cycle: int
    step: str = ""
    """of a behaviour: the step that it is in, or was in when it ended"""
    outcome: str = ""
    """ended: `done` (trajectory finished), the name of the end condition that tripped, `cancelled`, `stopped`, `owner_lost`,
    `refused_by_limits`, `drive_fault`, `diverged`, `stale_state`, `controller_error` (a ControllerEvent has the traceback),
    `infeasible` (constraints exclude each other: `detail` names the one that blocks); of a behaviour, of its last step, or
    `step_refused`, `too_many_steps`"""
    detail: str = ""
    """what came about where; running, of a behaviour: how the step before ended"""
    position: list[float] = []
    """rad, measured in that cycle"""
    command: list[float] = []
    """rad, commanded in that cycle"""
    path_force: float = 0.0
    """N, the path-force integrator's last value"""
    speed: float = 1.0
    """share of the planned speed that it runs at, or comes to: its own times the robot's (SetSpeed)"""


# --------------------------------------------------------------------------------------------------- daemon: calls to it


@_travels(priority=1, remote=True)
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


@_travels(priority=1, remote=True)
class GetStatus(Message):
    """The daemon's present status."""


@_travels(priority=1)
class GetTiming(Message):
    """How long the loop's cycles work and how late they start. Refused while no loop runs."""

    reset: bool = False
    """count anew from here on"""


@_travels(priority=1)
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


@_travels(priority=1)
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


@_travels(priority=1)
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


@_travels(priority=1)
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


@_travels(priority=1)
class ConfigureController(Message):
    """Make a loaded controller anew, which is not active, beside the loop; it is inactive then. Answered as LoadController is."""

    name: Name
    parameters: dict[str, Any] | None = None
    """None: as before"""


@_travels(priority=1)
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


@_travels(priority=1)
class UnloadController(Message):
    """Forget a loaded controller that is not active, and that no active one falls back to or rests on."""

    name: Name


@_travels(priority=2, remote=True)
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


@_travels(priority=1, remote=True)
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


@_travels(priority=1, remote=True)
class Enable(Message):
    """Take every drive to operation enabled and hold where it is. Refused while the stop is latched."""


@_travels(priority=1, remote=True)
class Disable(Message):
    """Take every drive out of operation (brakes close)."""


@_travels(priority=0, remote=True)
class Stop(Message):
    """Operator stop: every drive quick-stops within two cycles; latches until ClearStop."""

    reason: Annotated[str, Meta(max_length=200)] = ""


@_travels(priority=1, remote=True)
class ClearStop(Message):
    """Unlatch the operator stop. Nothing moves: Enable follows deliberately."""


@_travels(priority=1, remote=True)
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
    """who asks; counts only where somebody has taken the gripper's part"""
    lease: int = 0
    """epoch of `owner`'s newest lease; counts only where somebody has taken a part that this moves (TakeLease)"""
    sequence: int = 0
    """likewise: number of the command, higher than of all before it under that lease"""


@_travels(priority=1, remote=True)
class SwitchRelay(Message):
    """Open or close the relay of a power supply; it stays so until it is switched again.

    Open, the drives have no power: they fault, and their brakes close. Closed again they stay where they are until Enable. Refused
    where the supply does not answer, and where it should open while the robot is enabled, or about to be.
    """

    power: Name
    closed: bool
    force: bool = False
    """open it though the robot is enabled"""


@_travels(priority=1)
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


@_travels(priority=1)
class CheckIn(Message):
    """I am alive. Actions whose owner does not check in for 1 s, of the wall's time and of the robot's, are ended safely."""

    owner: Name


@_travels(priority=1)
class TakeLease(Message):
    """From now on, `owner` alone may command a part of the body (docs/safety.md, Leases). It must check in, as for an action.

    Refused where a joint of it is another owner's, unless it is taken over: then his actions on it are ended.
    """

    owner: Name
    part: Name
    """body, a group of the robot, or a gripper"""
    take_over: bool = False


class Lease(Message):
    """Answer to TakeLease: what the owner's commands must say from now on."""

    part: str
    owner: str
    epoch: int
    sequence: int
    """of the owner's last command; the next one's is higher"""


@_travels(priority=1)
class ReturnLease(Message):
    """The part is free again. What runs on it goes on."""

    owner: Name
    part: Name
    epoch: int


@_travels(priority=1, remote=True)
class BindKeepalive(Message):
    """From now on `owner` must answer challenges (KeepAlive) within `timeout_s`, at best at a third of it; or the robot holds what
    he commands, settles, and is damped to a stop (docs/safety.md). Bound anew, the timeout is another one.
    """

    owner: Name
    timeout_s: Annotated[float, Meta(ge=0.1, le=60.0)]
    """s of the robot's clock"""


class Challenge(Message):
    """Answer to BindKeepalive, GetChallenge and KeepAlive: what the next KeepAlive answers."""

    challenge: str


@_travels(priority=1, remote=True)
class GetChallenge(Message):
    """A new challenge for one who has lost his, as by a restart of the daemon's server. It keeps nothing alive."""

    owner: Name


@_travels(priority=1, remote=True)
class KeepAlive(Message):
    """I am there. Refused, and not counted, where the answer is wrong; final where the robot was damped meanwhile."""

    owner: Name
    answer: Annotated[str, Meta(max_length=200)]
    """handrail.keepalive.answer of the last challenge"""


@_travels(priority=1, remote=True)
class ReleaseKeepalive(Message):
    """`owner` need not answer any more."""

    owner: Name


@_travels(priority=1)
class HoldTime(Message):
    """Lock-step only: hold simulated time for `owner`, at most `limit_s` of wall time. Under the wall clock nothing happens."""

    owner: Name
    limit_s: Positive


@_travels(priority=1)
class ReleaseTime(Message):
    """End `owner`'s hold."""

    owner: Name


class PathForce(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """Integrates a force along the commanded path's tangent from the tool's lag behind it, and applies it by Jᵀ.

    F ← clip(F + gain · t̂·(x_d − x) · dt, 0, limit), with x, x_d the measured and commanded position of `frame` and t̂ the
    commanded path's unit tangent (the last one where the path stands still).
    """

    frame: Name
    gain: NonNegative = 1500.0
    """N/(m·s)"""
    limit: NonNegative = 60.0
    """N"""


class TimeEnd(msgspec.Struct, tag="time", kw_only=True, forbid_unknown_fields=True):
    """Ends `after` s of the action's own running time: pauses do not count, and at half the speed half of it does."""

    after: Positive


class PoseErrorEnd(msgspec.Struct, tag="pose_error", kw_only=True, forbid_unknown_fields=True):
    """Ends when `frame` is further than `position` m (along `axis` in the world frame, if given) from where it is commanded."""

    frame: Name
    position: Positive
    axis: tuple[float, float, float] | None = None


class ForceEnd(msgspec.Struct, tag="force", kw_only=True, forbid_unknown_fields=True):
    """Ends when the external force on `frame` along `axis` (world), felt or estimated, exceeds `limit` N in size."""

    frame: Name
    axis: tuple[float, float, float]
    limit: Positive


class ContactEnd(msgspec.Struct, tag="contact", kw_only=True, forbid_unknown_fields=True):
    """Ends when the size of the external force on `frame`, felt or estimated, exceeds `threshold` N."""

    frame: Name
    threshold: Positive


class JointLimitEnd(msgspec.Struct, tag="joint_limit", kw_only=True, forbid_unknown_fields=True):
    """Ends when a claimed joint is measured within `margin` rad of a position limit."""

    margin: NonNegative


class DivergenceEnd(msgspec.Struct, tag="divergence", kw_only=True, forbid_unknown_fields=True):
    """Ends when a claimed joint is further than `error` rad from its command."""

    error: Positive


class TorqueLimitEnd(msgspec.Struct, tag="torque_limit", kw_only=True, forbid_unknown_fields=True):
    """Ends when a claimed joint's spring bears more than `share` of the joint's torque limit."""

    share: Annotated[float, Meta(gt=0, le=1)]


class StallEnd(msgspec.Struct, tag="stall", kw_only=True, forbid_unknown_fields=True):
    """Ends when `frame` is measured to have moved less than `distance` m in `within` s of the action's own running time."""

    frame: Name
    distance: Positive
    within: Positive


class TravelEnd(msgspec.Struct, tag="travel", kw_only=True, forbid_unknown_fields=True):
    """Ends when `frame` is measured `distance` m from where it was at the action's start, along `axis` (world) if given."""

    frame: Name
    distance: Positive
    axis: tuple[float, float, float] | None = None


class GripperHoldsEnd(msgspec.Struct, tag="gripper_holds", kw_only=True, forbid_unknown_fields=True):
    """Ends when a gripper stands still at its effort limit, short of where it was sent: something is in it."""

    gripper: Name


class GripperAtEnd(msgspec.Struct, tag="gripper_at", kw_only=True, forbid_unknown_fields=True):
    """Ends when a gripper is measured within `tolerance` of `position`: open, closed on nothing, or as wide as it shall be."""

    gripper: Name
    position: float
    """rad or m, of the driven joint"""
    tolerance: Positive
    """likewise"""


EndCondition = (
    TimeEnd
    | PoseErrorEnd
    | ForceEnd
    | ContactEnd
    | JointLimitEnd
    | DivergenceEnd
    | TorqueLimitEnd
    | StallEnd
    | TravelEnd
    | GripperHoldsEnd
    | GripperAtEnd
)


class JointTrajectory(msgspec.Struct, tag="joint_trajectory", kw_only=True, forbid_unknown_fields=True):
    """Follow knots by cubic Hermite interpolation under joint impedance in the drives, gravity and feed-forward from the host."""

    joints: list[Name]
    times: list[float]
    """s from the action's start, strictly increasing, first 0"""
    positions: list[list[float]]
    """rad, knots × joints"""
    velocities: list[list[float]]
    """rad/s, knots × joints"""
    path_force: PathForce | None = None


class CartesianImpedance(msgspec.Struct, tag="cartesian_impedance", kw_only=True, forbid_unknown_fields=True):
    """Move `frame` in a straight line to `goal_in_world` in `duration` s under Cartesian impedance on `joints`."""

    frame: Name
    joints: list[Name]
    goal_in_world: Pose
    duration: Positive
    stiffness: tuple[float, float] = (600.0, 6.0)
    """N/m, N·m/rad"""


TaskAxis = Literal["x", "y", "z", "rx", "ry", "rz"]
"""along, or about, an axis of a task frame"""


class Compliance(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """Lets one axis of a task frame give way: e, how far it is off the path there, follows the wrench w that the frame feels.

    damping · ė = force + w − stiffness · e, with |ė| ≤ speed and |e| ≤ reach. So without stiffness the frame goes on, no faster
    than `speed`, until it exerts `force`; without `force` it is a spring and a damper, or a damper alone.
    """

    axis: TaskAxis
    force: float = 0.0
    """N or N·m that the frame exerts on what it touches"""
    stiffness: NonNegative = 0.0
    """N/m or N·m/rad, less than the motion's own; 0: no spring"""
    damping: NonNegative = 0.0
    """N·s/m or N·m·s/rad; 0: 100 or 2"""
    speed: NonNegative = 0.0
    """m/s or rad/s at most; 0: 0.03 or 0.2"""
    reach: NonNegative = 0.0
    """m or rad at most; 0: 0.1 or 0.5"""


class Dither(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """Swings about the path along one axis of a task frame."""

    axis: TaskAxis
    amplitude: Positive
    """m or rad, commanded"""
    frequency: Positive
    """Hz"""


class CompliantMotion(msgspec.Struct, tag="compliant_motion", kw_only=True, forbid_unknown_fields=True):
    """Move `frame` along a straight path, and let it give way, press or swing on chosen axes of a task frame.

    The path leads from where the frame is commanded to `goal_in_world`, or by `shift`, or nowhere. Done after `duration`.
    """

    frame: Name
    joints: list[Name]
    duration: Positive
    """s"""
    goal_in_world: Pose | None = None
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """m along the task frame's axes, as they are at the start; only without `goal_in_world`"""
    axes: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    """unit quaternion (x, y, z, w): the task frame's axes in the world, or in the frame. Its origin is the frame's"""
    axes_in: Literal["world", "frame"] = "world"
    compliance: list[Compliance] = []
    dither: list[Dither] = []
    stiffness: tuple[float, float] = (600.0, 20.0)
    """N/m, N·m/rad, about the path, displaced by compliance and dither"""


NOT_READY = "not ready"
"""the refused value of a StartAction whose controller is still being made: call again"""


class FixedPose(msgspec.Struct, tag="fixed", kw_only=True, forbid_unknown_fields=True):
    """A task's frame is brought to `pose` and stays there: gone to at `speed` and `turn` at most, not jumped to."""

    task: Name
    pose: Pose | None = None
    """in the frame that the task is relative to; none: where it is at the start, and `shift`"""
    shift: Vector = (0.0, 0.0, 0.0)
    """m, on the axes of the frame that the task is relative to; only without `pose`"""
    speed: Positive = 0.25
    """m/s"""
    turn: Positive = 1.0
    """rad/s"""


class FrameLine(msgspec.Struct, tag="line", kw_only=True, forbid_unknown_fields=True):
    """A task's frame goes in a straight line to `goal`, minimum-jerk in `duration` s, from where it is at the start."""

    task: Name
    duration: Positive
    goal: Pose | None = None
    """in the frame that the task is relative to; none: where it is at the start, and `shift`"""
    shift: Vector = (0.0, 0.0, 0.0)
    """m, on the axes of the frame that the task is relative to; only without `goal`"""


class PostureKnots(msgspec.Struct, tag="knots", kw_only=True, forbid_unknown_fields=True):
    """A JPos goes through knots, by cubic Hermite interpolation; joints that are not named stay where they are commanded."""

    task: Name
    joints: list[Name]
    times: list[float]
    """s from the action's start, strictly increasing, first 0"""
    positions: list[list[float]]
    """rad, knots × joints"""
    velocities: list[list[float]]
    """rad/s, knots × joints"""


class PoseStream(msgspec.Struct, tag="stream", kw_only=True, forbid_unknown_fields=True):
    """A task's frame follows what StreamPose brings, and stands when nothing has come for `stale` s."""

    task: Name
    stale: Positive = 0.1
    """s"""
    speed: Positive = 0.5
    """m/s: a pose that is far off is gone to no faster"""
    turn: Positive = 1.5
    """rad/s"""


Reference = FixedPose | FrameLine | PostureKnots | PoseStream


class WholeBody(msgspec.Struct, tag="whole_body", kw_only=True, forbid_unknown_fields=True):
    """Run a compound task on `joints`: torques of whole-body control, and an impedance about where they lead.

    Other actions may move the other joints meanwhile; else they are held. What these do is reckoned with, and left to them.

    References that neither compound nor `references` give are where the robot is commanded to be at the start. Ends by itself
    after `duration` s, or with its longest trajectory, and otherwise by an end condition or a cancellation.
    """

    compound: Annotated[str, Meta(min_length=1)]
    """name of a compound task (docs/wbc.md), or its YAML text"""
    joints: list[Name] = []
    """that it moves; none: all of the robot's"""
    frame: str = ""
    """of the tasks and constraints that are about a frame and name none"""
    references: list[Reference] = []
    """at most one a task"""
    duration: NonNegative = 0.0
    """s; 0: as long as the longest trajectory among the references, without one for ever"""
    stiffness: Annotated[float, Meta(ge=0, le=1)] = 0.5
    """of the drives about the desired positions, as a share of the robot's own: what the model does not know (a push, a wrong
    mass) moves light joints far where both are low"""
    damping: Annotated[float, Meta(ge=0, le=1)] = 1.0


class JointTarget(msgspec.Struct, tag="joint_target", kw_only=True, forbid_unknown_fields=True):
    """Go to `positions`, as fast as the limits of acceleration and jerk and `speed` allow, and end there (`done`).

    From a stand in a straight line, all joints arriving together. StreamJoints replaces the target on the way (its velocities
    count for nothing); nobody looks ahead for what stands in the way but the daemon's guard.
    """

    joints: list[Name]
    positions: list[float]
    """rad"""
    speed: Annotated[float, Meta(gt=0, le=1)] = 0.3
    """share of the velocity limits"""


JointsMotion = JointTrajectory | CartesianImpedance | CompliantMotion | JointTarget
"""those that say which joints they move"""


class JointStream(msgspec.Struct, tag="joint_stream", kw_only=True, forbid_unknown_fields=True):
    """Follow what StreamJoints brings, from where the joints are commanded to be; ends with `stream_lost`, or as every motion may.

    Between two samples it goes on at the velocity that was sent, for at most `bridge` s; then it comes to a stand within 0.1 s and
    is held, which an ActionEvent tells (`paused`, with the reason), until the next sample comes or `expiry` is over.
    """

    joints: list[Name]
    bridge: Positive = 0.05
    """s without a sample that are bridged"""
    expiry: Positive = 1.0
    """s without a sample after which it ends"""
    speed: Positive = 0.5
    """rad/s: a sample that is elsewhere than the joints are commanded to be is gone to no faster"""


Motion = JointsMotion | WholeBody | JointStream


@_travels(priority=1, remote=False)
class StartAction(Message):
    """Run a motion with end conditions that the loop checks in every cycle. Ends in a hold at the last command.

    Refused (with field, value, expectation) when: not enabled, stopped, joints claimed by another running action, first knot
    further than 0.02 rad from what the robot is commanded, a knot beyond limits, non-finite numbers, expired.
    """

    id: Name
    owner: Name
    motion: Motion
    ends: list[EndCondition] = []
    expires_ns: int = 0
    """robot clock; 0: never"""
    hold_after_s: NonNegative = 0.0
    """lock-step: in the cycle that ends the action, hold simulated time for `owner`, at most this long (wall time)"""
    lease: int = 0
    """epoch of `owner`'s newest lease; counts only where somebody has taken a part that this moves (TakeLease)"""
    sequence: int = 0
    """likewise: number of the command, higher than of all before it under that lease"""


class GripperOrder(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """Where a step sends a gripper, as CommandGripper does."""

    gripper: Name
    position: float
    """rad or m, of the driven joint"""
    velocity: NonNegative = 0.0
    """rad/s or m/s, at most; 0: its limit"""
    effort: NonNegative = 0.0
    """N·m or N, at most; 0: its limit"""


class Step(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """One action of a behaviour."""

    name: Name
    motion: JointsMotion
    gripper: GripperOrder | None = None
    """sent off in the cycle in which the step begins; it follows that until its next order, whatever becomes of the behaviour, so
    that what it holds is not let go"""
    ends: list[EndCondition] = []
    then: dict[str, Name] = {}
    """how it ended → the step that follows, or `end`. How: `done`, an end condition's type (`contact`), or one by its number
    (`ends[1]`). Left out: after `done` the next one follows, after anything else the behaviour ends"""


@_travels(priority=1, remote=False)
class StartBehaviour(Message):
    """Run actions in a chain, the first step first; one follows another in the cycle that ends it, without a round trip.

    To everybody it is one action: cancelled, paused and resumed by its `id`, with an ActionEvent at every step. Each step moves the
    same joints. Refused as StartAction is, with `steps[i]` before the field; what a step's end is not told to lead to, an
    operator's stop or cancellation say, ends the behaviour. A joint trajectory has to start within 0.02 rad of what the robot is
    commanded when its turn comes: else the behaviour ends with `step_refused`.
    """

    id: Name
    owner: Name
    steps: Annotated[list[Step], Meta(min_length=1, max_length=16)]
    most_steps: Annotated[int, Meta(ge=1, le=10_000)] = 100
    """that it may take; then it ends with `too_many_steps`"""
    expires_ns: int = 0
    """robot clock; 0: never"""
    hold_after_s: NonNegative = 0.0
    """as of StartAction, when the behaviour ends"""
    lease: int = 0
    sequence: int = 0
    """as of StartAction"""


@_travels(priority=1, remote=False)
class StreamPose(Message):
    """Where a streamed reference of a running whole-body action is to be, in the frame that its task is relative to.

    What is not given stays as it was sent last. Between two of these it goes on at `velocity`. Refused when no such action runs,
    or nothing of it is streamed under this name.
    """

    id: Name
    """the action's"""
    task: Name
    position: tuple[float, float, float] | None = None
    """m"""
    orientation: tuple[float, float, float, float] | None = None
    """x y z w"""
    velocity: tuple[float, float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    """m/s, rad/s: linear, angular"""


@_travels(priority=1, remote=False)
class StreamJoints(Message):
    """A sample of where the joints of a running JointStream are to be, or the next target of a JointTarget that is on its way.

    One to two hundred a second are a good rate of a stream.

    Answered as soon as it is on its way: the loop drops one that comes after a newer one, or after it expired. Counts as its
    owner's CheckIn. Refused when no such action runs, and when a number is not finite, beyond a limit, or missing.
    """

    id: Name
    """the action's"""
    sequence: Annotated[int, Meta(ge=1, lt=1 << 53)]
    """goes up by one with every sample"""
    positions: list[float]
    """rad, in the order of the motion's joints"""
    velocities: list[float] = []
    """rad/s; empty: 0"""
    expires_ns: int = 0
    """robot clock; 0: never"""


@_travels(priority=1)
class CancelAction(Message):
    """End an action: slow down along its path, then hold."""

    id: Name


@_travels(priority=1)
class PauseAction(Message):
    """Stop moving along the path, jerk-limited, and hold there."""

    id: Name


@_travels(priority=1)
class ResumeAction(Message):
    """Go on along the path."""

    id: Name


@_travels(priority=1, remote=True)
class SetSpeed(Message):
    """Run a motion, or all of them, at a share of the planned speed, from now on: in mid-motion, too, within the joints' limits.

    The path stays the same; what runs along it runs slower, the action's own time with it (TimeEnd, StallEnd, dither). Of a
    JointStream whoever streams says how fast it is. Refused when no such action runs.
    """

    share: Annotated[float, Meta(ge=0.1, le=1.0)]
    """of the speed as planned; an action runs at its own share times the robot's"""
    id: Annotated[str, Meta(max_length=128)] = ""
    """the action; empty: every one that there is and will be, until it is set anew"""


GetRobot.Reply = RobotInfo
GetStatus.Reply = DaemonStatus
GetTiming.Reply = LoopTiming
GetBase.Reply = Base
GetHardware.Reply = HardwareStatus
GetSafety.Reply = SafetyReport
TareSensor.Reply = Tared
TakeLease.Reply = Lease
BindKeepalive.Reply = GetChallenge.Reply = KeepAlive.Reply = Challenge
GetControllers.Reply = ControllerList

DaemonCall = (
    GetRobot
    | GetStatus
    | GetTiming
    | GetBase
    | GetHardware
    | GetSafety
    | GetControllers
    | LoadController
    | ConfigureController
    | SwitchControllers
    | UnloadController
    | Enable
    | Disable
    | Stop
    | ClearStop
    | CheckIn
    | TakeLease
    | BindKeepalive
    | GetChallenge
    | KeepAlive
    | ReleaseKeepalive
    | ReturnLease
    | HoldTime
    | ReleaseTime
    | StartAction
    | StartBehaviour
    | CancelAction
    | PauseAction
    | ResumeAction
    | SetSpeed
    | StreamPose
    | StreamJoints
    | CommandGripper
    | SwitchRelay
    | TareSensor
)
DaemonEvent = RobotState | DaemonStatus | ActionEvent | DeviceStates | ControllerEvent
SensorEvent = PointCloud
"""what a camera's process publishes (topic `sensors.events`)"""

# ------------------------------------------------------------------------------------------------- engine: templates, plans


@_travels(priority=2, reliable=False, superseded_by=("name",), remote=True)
class InstanceState(Message):
    """A template placed in the world, as it stands now."""

    name: str
    template: str
    """library name"""
    template_hash: str
    version: int
    """goes up with every edit of pose or parameters; plans made from an older one are stale"""
    pose_in_world: Pose
    parameters: dict[str, float]
    joint_state: dict[str, float]
    """joint → rad, as believed from the tool's motion; not an edit"""
    removed: bool = False


@_travels(priority=1, remote=True)
class PlaceInstance(Message):
    """Put a template into the world."""

    name: Name
    template: Name
    pose_in_world: Pose
    parameters: dict[str, float] = {}


@_travels(priority=1, remote=True)
class MoveInstance(Message):
    """Give an instance a new pose; plans made from it become stale."""

    name: Name
    pose_in_world: Pose


@_travels(priority=1, remote=True)
class SetParameters(Message):
    """Change an instance's parameters; plans made from it become stale."""

    name: Name
    parameters: dict[str, float]


@_travels(priority=1, remote=True)
class RemoveInstance(Message):
    """Take an instance away."""

    name: Name


@_travels(priority=1, remote=True)
class GetInstances(Message):
    """All instances."""


class Instances(Message):
    """Answer to GetInstances."""

    instances: list[InstanceState]


class PlanSegment(msgspec.Struct, kw_only=True):
    """One stretch of a plan, executed by itself."""

    name: str
    times: list[float]
    positions: list[list[float]]
    """rad, knots × PlanPreview.joints; straight lines between them are the motion within 5 mrad"""


class PlanWorst(msgspec.Struct, kw_only=True):
    """The worst of a measure on the way to a waypoint."""

    value: float
    time: float
    """s from the plan's start"""
    about: str = ""
    """the joint, or the two bodies, that it is about"""


class PlanWaypoint(msgspec.Struct, kw_only=True):
    """How well a segment's end meets what was asked for, and what the way to it keeps at its worst. None: was not measured."""

    name: str
    """of its segment; or `key frame` and its number, where one is passed on the way"""
    time: float
    """s from the plan's start, when it is reached"""
    residual: float | None = None
    """m, from the tool's tip to its goal"""
    tilt: float | None = None
    """rad, between the tool and its wanted axis"""
    clearance: PlanWorst | None = None
    """m, and between which bodies; none: nothing can be near"""
    limit_margin: PlanWorst | None = None
    """rad, and which joint is so near its limit"""
    torque_share: PlanWorst | None = None
    """of its limit, by inverse dynamics with the expected contact force, and which joint works so hard"""


class PlanSeries(msgspec.Struct, kw_only=True):
    """A measure along a plan."""

    times: list[float]
    """s from the plan's start"""
    values: list[float]
    names: list[str] = []
    """the joints or pairs of bodies that the values are about"""
    which: list[int] = []
    """row of `names` for each value; empty: about nothing in particular"""


class PlanOrigin(msgspec.Struct, kw_only=True):
    """What a plan was made from, beside the versions of its instances."""

    time_ns: int
    """robot's clock when it was begun"""
    asked: dict[str, float | str]
    """what was asked for: instance, trajectory, arm, arc and entry_shift rad; of a motion goals, in words, arm, clearance m;
    `after` and `edits`: ids of plans"""
    run: str = ""
    """id of the run that made it; empty: a client asked"""
    instances: list[InstanceState] = []
    """as they were"""
    joints: dict[str, float] = {}
    """rad, every joint of the robot as it was commanded: the plan moves some, and counts on the others to stay"""
    base_in_world: Pose = msgspec.field(default_factory=Pose)


StaleCause = Literal[
    "executed",
    "not_yet",
    "instance_removed",
    "instance_moved",
    "instance_parameters",
    "instance_changed",
    "start_left",
    "others_moved",
    "base_moved",
    "base_unknown",
]


@_travels(priority=3, reliable=False, superseded_by=("id",), remote=True)
class PlanPreview(Message):
    """What a client draws as a ghost, and whether the plan may still be executed: the summary of it.

    `origin`, `measures` and `tool` come only in the answer to GetPlan with `details`.
    """

    id: str
    label: str
    joints: list[str]
    segments: list[PlanSegment]
    made_from: dict[str, int]
    """instance → version"""
    fresh: bool
    stale_because: str = ""
    """all causes, in words"""
    stale_causes: list[StaleCause] = []
    """the same for programs, in the words' order"""
    clearance: float = 0.0
    """m, the smallest along the plan"""
    limit_margin: float = 0.0
    """rad, the smallest distance to a joint limit"""
    duration: float = 0.0
    """s"""
    arm: str = ""
    waypoints: list[PlanWaypoint] = []
    """one a segment, and one a key frame that is passed on it"""
    key_times: list[float] = []
    """s from the plan's start, when a motion passes each of its key frames (EditPlan)"""
    origin: PlanOrigin | None = None
    measures: dict[str, PlanSeries] = {}
    """clearance m, residual m, tilt rad, limit_margin rad, torque_share"""
    tool: list[list[float]] = []
    """m, the tip of the arm's tool in the world, one row a knot of all segments one after the other"""


@_travels(priority=1, remote=True)
class GetPlan(Message):
    """A plan by its id."""

    id: Name
    details: bool = False
    """also what it was made from, what it keeps all along its way, and the tool's way: some 10 kB"""


@_travels(priority=1, remote=True)
class MakePlan(Message):
    """Plan a template's trajectory for an arm from where the robot is now. Answered when the plan is there or found infeasible."""

    instance: Name
    trajectory: Name
    arm: str = "right"
    """empty: the first for which there is a plan, in the order of RankChoices, and there the place around the joint"""
    arc: float | None = None
    """rad, place around the template's joint of the arc's centre (a Choice's); none: the planner's choice"""
    after: str = ""
    """id of a plan: from where it ends; empty: from where the robot is commanded now"""


@_travels(priority=1, remote=True)
class CancelPlanning(Message):
    """End all planning that calls are waiting for (plans, choices, checks of tasks). Programs go on."""


@_travels(priority=5, reliable=False, superseded_by=("what",), remote=True)
class PlanProgress(Message):
    """What a call that plans is doing."""

    what: str
    """the call, in a few words"""
    doing: str
    done: bool = False
    """it is answered"""


@_travels(priority=1, remote=True)
class RankChoices(Message):
    """Which arm, trajectory and place around the joint can do how much of a behaviour at an instance. The best comes first."""

    instance: Name
    trajectory: str = ""
    """empty: all of the template's"""
    arms: list[Name] = []
    """none: all"""
    after: str = ""
    """id of a plan: from where it ends; empty: from where the robot is commanded now"""


class Choice(msgspec.Struct, kw_only=True):
    """One way to do a behaviour."""

    trajectory: str
    arm: str
    arc: float | None
    """rad about the template's joint, the arc's centre; none: the trajectory has no arc"""
    share: float
    """of the tool's goals over the whole arc, at every depth, that are reached, strong enough, and clear; from 0 to 1"""
    cost: float
    """rad, the arm's way from where it is to where the behaviour begins"""
    lacks: str = ""
    """what most of the rest misses"""
    joints: dict[str, float] = {}
    """rad, the arm where the behaviour begins"""


class Choices(Message):
    """Answer to RankChoices."""

    choices: list[Choice]
    """by share, then by cost"""


# A goal of a motion: what must hold where it ends (or at a key frame, or along all of it). Lengths m, angles rad. It is said in the
# world, in a frame of the robot (`in_frame`), or in an instance's frame (`instance`) or that of a feature of it (`feature`): a
# joint's name (x along its axis; the frame goes with the joint), or TRAJECTORY.WAYPOINT (z against the tool's pointing direction,
# as a tool's tip has it).


class JointsGoal(msgspec.Struct, tag="joints", kw_only=True, forbid_unknown_fields=True):
    """Joints are at positions."""

    positions: dict[Name, float]
    """joint → rad"""
    tolerance: NonNegative = 0.0


class PostureGoal(msgspec.Struct, tag="posture", kw_only=True, forbid_unknown_fields=True):
    """All joints that may move are where one of the robot's postures has them."""

    name: Name


class RelationGoal(msgspec.Struct, tag="relation", kw_only=True, forbid_unknown_fields=True):
    """lower ≤ Σ coefficient · position ≤ upper: left as right is {left: 1, right: -1}, 0 to 0."""

    coefficients: dict[Name, float]
    lower: float = 0.0
    upper: float = 0.0


class FrameGoal(msgspec.Struct, tag="frame", kw_only=True, forbid_unknown_fields=True):
    """A frame of the robot is at a pose, within tolerances."""

    frame: str = ""
    """empty: the arm's tool tip"""
    pose: Pose
    in_frame: str = ""
    instance: str = ""
    feature: str = ""
    below: tuple[NonNegative, NonNegative, NonNegative] = (0.0, 0.0, 0.0)
    """m along the pose's x, y, z, that the frame may be below it; inf: as far as it likes"""
    above: tuple[NonNegative, NonNegative, NonNegative] = (0.0, 0.0, 0.0)
    angle: NonNegative = 0.0
    """that it may be turned by; π: any orientation"""
    about: Literal["", "x", "y", "z"] = ""
    """turning about this axis of the frame is free; `angle` is the cone that the axis stays in"""


class GazeGoal(msgspec.Struct, tag="gaze", kw_only=True, forbid_unknown_fields=True):
    """A point is within the cone about an axis of a frame: a camera sees it."""

    frame: Name
    target: tuple[float, float, float] = (0.0, 0.0, 0.0)
    in_frame: str = ""
    instance: str = ""
    feature: str = ""
    axis: tuple[float, float, float] = (1.0, 0.0, 0.0)
    """in `frame`"""
    cone: Positive
    """half-angle"""


Goal = JointsGoal | PostureGoal | RelationGoal | FrameGoal | GazeGoal


class KeyFrame(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """What must hold at one time on the way."""

    goals: Annotated[list[Goal], Meta(min_length=1, max_length=32)]


class Along(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    """A frame goes with a joint of an instance from where it is, as though it held it: a valve is turned, a door opened."""

    instance: Name
    joint: Name
    by: float
    """rad about the joint's axis, m along it"""
    frame: str = ""
    """empty: the arm's tool tip"""
    about: Literal["", "x", "y", "z"] = ""
    """turning about this axis of the frame is free"""
    touch: bool = True
    """the arm's tool may touch the instance"""


@_travels(priority=1, remote=True)
class PlanMotion(Message):
    """Plan a motion to goals that keeps clear of all instances and of the robot itself. Answered when the plan is there or found
    infeasible; which constraint is missed, and by how much, is told.
    """

    goals: Annotated[list[Goal], Meta(max_length=32)] = []
    """all of them, where the motion ends; at least one, or `along`"""
    along: Along | None = None
    """in place of goals and key frames"""
    arm: str = ""
    """whose joints move, and whose tip is meant by a frame that is not named; empty: the robot's only one, or `joints` say it"""
    joints: list[Name] = []
    """joints and groups that may move, in place of the arm's; the others stay where they are"""
    through: Annotated[list[KeyFrame], Meta(max_length=16)] = []
    """on the way, in this order"""
    keep: Annotated[list[Goal], Meta(max_length=32)] = []
    """along the whole way"""
    after: str = ""
    """id of a plan: from where it ends; empty: from where the robot is commanded now"""
    clearance: NonNegative = 0.01
    """m, from every instance and of the robot from itself"""
    ignore: list[Name] = []
    """instances that need not be kept clear of"""
    seen: bool = False
    """whether to keep clear of what cameras see as well, but for points on the robot and on instances; refused where none sees"""
    duration: NonNegative = 0.0
    """s, at least"""
    label: str = ""


@_travels(priority=1, remote=True)
class EditPlan(Message):
    """Plan a motion anew, with what an operator dragged its ghost to as one key frame more, or in place of one that it has.

    The new plan keeps the edit, and so do plans that are edits of it. It begins where the robot is now, or where the plan before it
    ends. Refused for a stroke at a template, which has no key frames.
    """

    id: Name
    goals: Annotated[list[Goal], Meta(min_length=1, max_length=32)]
    """what must hold there"""
    time: NonNegative = 0.0
    """s from the plan's start: where a new key frame goes among those that there are"""
    frame: Annotated[int, Meta(ge=-1)] = -1
    """number of the key frame to change, from 0; as many as there are: the motion's end; -1: none, it is a new one"""


@_travels(priority=1, remote=True)
class ExecutePlan(Message):
    """Run a plan's segments (all, or those named). Refused when it is stale, with the reason."""

    id: Name
    segments: list[Name] = []


# ------------------------------------------------------------------------------------------------------- engine: programs


@_travels(priority=1, remote=True)
class ListLibrary(Message):
    """What programs and templates are there?"""


class LibraryEntry(msgspec.Struct, kw_only=True):
    name: str
    kind: Literal["program", "template"]
    title: str = ""
    hash: str = ""
    problem: str = ""
    """why it can't be used, with file and line"""


class Library(Message):
    """Answer to ListLibrary."""

    entries: list[LibraryEntry]


@_travels(priority=1, remote=True)
class Deploy(Message):
    """Check a program whole, bind its resources and make it ready to run."""

    program: Name
    bindings: dict[str, str]
    """resource → robot part or instance, e.g. arm → right, valve → wheel_1"""
    parameters: dict[str, Any] = {}


class Deployment(Message):
    """Answer to Deploy."""

    id: str
    program: str
    hash: str
    """of the content that will run"""


@_travels(priority=1, remote=True)
class CheckTask(Message):
    """Rehearse a deployed program from where the robot is, without moving it: every motion planned and verified end to end.

    Answered when it has ended, or with the first motion that is infeasible. Where its motions end is where the program looks first
    when it runs.
    """

    deployment: Name


class TaskStep(msgspec.Struct, kw_only=True):
    """One activity of a rehearsal that plans a motion, or could not be done."""

    state: str
    activity: str
    what: str = ""
    """the plan, or the behaviour"""
    clearance: float | None = None
    """m"""
    limit_margin: float | None = None
    """rad"""
    duration: float | None = None
    """s"""
    unknown: bool = False
    """what it does is found out by doing it: it was taken to go well, and was not verified"""
    problem: str = ""
    """why it can't be done, with what is missed and by how much"""


class TaskCheck(Message):
    """Answer to CheckTask."""

    program: str
    hash: str
    feasible: bool
    first_infeasible: str
    """id of the state, empty: none"""
    outcome: str
    """of the program, if everything goes as planned"""
    detail: str
    steps: list[TaskStep]


@_travels(priority=1, remote=True)
class Run(Message):
    """Start a deployed program."""

    deployment: Name


@_travels(priority=1, remote=True)
class PauseRun(Message):
    """Pause the running program: the motion really stops."""


@_travels(priority=1, remote=True)
class ResumeRun(Message):
    """Go on."""


@_travels(priority=1, remote=True)
class StopRun(Message):
    """End the running program: cancel its motion, leave the robot holding."""


@_travels(priority=1, remote=True)
class StepRun(Message):
    """Let a paused program go on until the next activity is about to begin."""


@_travels(priority=1, remote=True)
class SetBreakpoints(Message):
    """Pause the program before these states do what they do. Replaces those that there were; counts for the next runs too."""

    states: list[Name]


@_travels(priority=1, remote=True)
class TakeTransition(Message):
    """Leave an active state by a way out of the operator's choice, whatever its guard says; what it does is cancelled."""

    state: Name
    way: Annotated[int, Meta(ge=0)] | None = None
    """index of the state's transition in the program's file; None: skip, by the first way that it has for being done"""


@_travels(priority=1, remote=True)
class RunFrom(Message):
    """Run the last program anew from a state, with its variables as they stand. A run under way is stopped before."""

    state: Name
    paused: bool = False
    """True: wait before the state's activity until the run is resumed or stepped"""


@_travels(priority=1, remote=True)
class SetRunParameters(Message):
    """Change parameters of the running program: each counts from when it is used next."""

    parameters: dict[str, Any]


@_travels(priority=1, remote=True)
class SetAutonomy(Message):
    """How much programs do without asking, from now on: transitions that name this level or one above it are asked about."""

    level: Literal["low", "high", "full"]


@_travels(priority=1, remote=True)
class GetRunHistory(Message):
    """What the last run went through."""


class StateVisit(msgspec.Struct, kw_only=True):
    """One stay in a state."""

    state: str
    entered_ns: int
    """by the robot's clock"""
    left_ns: int = 0
    """0: it is active"""
    event: str = ""
    """what ended it; empty: a guard alone"""


class RunHistory(Message):
    """Answer to GetRunHistory."""

    run: str
    visits: list[StateVisit]
    """in the order in which the states were entered, the last 2000"""


@_travels(priority=2, remote=True)
class RunState(Message):
    """A program's run, at every change."""

    run: str
    deployment: str
    program: str
    hash: str
    status: Literal["ready", "running", "paused", "succeeded", "failed", "stopped"]
    active: list[str]
    """ids of the active states, outermost first"""
    data: dict[str, Any] = {}
    """the program's variables as they stand, then its parameters; no name is both"""
    waiting: list[str] = []
    """active states that have not begun what they do, because the run is paused"""
    breakpoints: list[str] = []
    """states before whose activity the run pauses"""
    autonomy: str = "full"
    """transitions that name this level or one above it are asked about"""
    detail: str = ""
    """why it failed, stopped, or paused by itself"""
    time_ns: int = 0


@_travels(priority=2, remote=True)
class Prompt(Message):
    """A question to the operator."""

    id: str
    run: str
    text: str
    options: list[str]
    plan: str = ""
    """id of the plan that it is about"""
    severity: Literal["info", "confirm", "warning"] = "confirm"
    details: dict[str, float] = {}
    """the numbers that matter, each name with its unit, e.g. clearance_m"""


@_travels(priority=2, remote=True)
class PromptClosed(Message):
    """A prompt is no longer open."""

    id: str
    answer: str = ""
    by: str = ""


@_travels(priority=1, remote=True)
class AnswerPrompt(Message):
    """Answer a prompt. A late answer is told that it was already answered."""

    id: Name
    answer: Name
    by: Name = "operator"


@_travels(priority=1, remote=True)
class GetEngine(Message):
    """Everything a late client needs: instances, fresh and stale plans, the run, open prompts."""


class EngineSnapshot(Message):
    """Answer to GetEngine."""

    instances: list[InstanceState]
    plans: list[PlanPreview]
    run: RunState | None
    prompts: list[Prompt]


@_travels(priority=6, remote=True)
class LogLine(Message):
    """One line for people."""

    source: str
    level: Literal["info", "warning", "error"]
    text: str
    time_ns: int = 0


PlaceInstance.Reply = InstanceState
MoveInstance.Reply = InstanceState
SetParameters.Reply = InstanceState
GetInstances.Reply = Instances
GetPlan.Reply = PlanPreview
MakePlan.Reply = PlanPreview
RankChoices.Reply = Choices
PlanMotion.Reply = PlanPreview
EditPlan.Reply = PlanPreview
ListLibrary.Reply = Library
Deploy.Reply = Deployment
CheckTask.Reply = TaskCheck
Run.Reply = RunState
RunFrom.Reply = RunState
TakeTransition.Reply = RunState
GetRunHistory.Reply = RunHistory
GetEngine.Reply = EngineSnapshot

EngineCall = (
    PlaceInstance
    | MoveInstance
    | SetParameters
    | RemoveInstance
    | GetInstances
    | GetPlan
    | MakePlan
    | CancelPlanning
    | RankChoices
    | PlanMotion
    | EditPlan
    | ExecutePlan
    | ListLibrary
    | Deploy
    | CheckTask
    | Run
    | PauseRun
    | ResumeRun
    | StopRun
    | StepRun
    | SetBreakpoints
    | TakeTransition
    | RunFrom
    | SetRunParameters
    | SetAutonomy
    | GetRunHistory
    | AnswerPrompt
    | GetEngine
)
EngineEvent = InstanceState | PlanPreview | PlanProgress | RunState | Prompt | PromptClosed | LogLine

# ------------------------------------------------------------------------------------------------------------ plant: truth


@_travels(priority=5, reliable=False, superseded_by=("type",))
class GroundTruth(Message):
    """What really happens in the plant. For tests, benchmarks, verdicts and simulated sensors; it never crosses the link."""

    time_ns: int
    joints: dict[str, float]
    """robot joint → rad"""
    hinges: dict[str, float]
    """scene object → its hinge's signed angle, rad"""
    poses_in_world: dict[str, Pose]
    """scene object → pose"""
    contact_force: dict[str, float]
    """scene object → N, sum of normal forces between it and the robot, now"""
    peak_contact_force: dict[str, float]
    """scene object → N, the largest since the plant started"""
    base_in_world: Pose = msgspec.field(default_factory=Pose)
    """of the robot's root link; a free one may move"""


# ------------------------------------------------------------------------------------------------------------- answers


class Ok(Message):
    """A call was carried out and has nothing to say."""


class Refused(Message):
    """A call was not carried out; nothing has changed."""

    message: str
    field: str = ""
    value: str = ""
    expected: str = ""


Answer = (
    Ok
    | Refused
    | RobotInfo
    | DaemonStatus
    | LoopTiming
    | Base
    | HardwareStatus
    | SafetyReport
    | Lease
    | Challenge
    | Tared
    | ControllerList
    | InstanceState
    | Instances
    | PlanPreview
    | Choices
    | Library
    | Deployment
    | TaskCheck
    | RunState
    | RunHistory
    | EngineSnapshot
)
