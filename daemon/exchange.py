"""What the daemon's loop and its server exchange: the snapshot that leaves each cycle, the commands that enter.

Both are fixed numpy records in shared memory, so that the loop never decodes a message. The server turns messages into commands
(`encode_start`, `encode_command`) and snapshots into messages (`robot_state`, `action_event`, ...); the loop turns a command into
plain Python objects once (`decode`). Whoever carries them (daemon.ring) satisfies the three protocols at the end.

Every command has a serial number that the server counts up. The loop handles at most one command a cycle and writes a snapshot
that answers it (`answered`, `answer`), so the server may wait for the loop's word before it answers its caller.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from handrail.messages import (
    ActionEvent,
    ContactEnd,
    DivergenceEnd,
    EndCondition,
    ForceEnd,
    JointLimitEnd,
    JointTrajectory,
    PathForce,
    Pose,
    PoseErrorEnd,
    RobotState,
    StartAction,
    TimeEnd,
)
from handrail.robot.description import RobotDescription

SLOTS = 4
"""Actions that may run at the same time, on different joints."""
MAX_JOINTS = 64
MAX_ENDS = 16
MAX_HOLDS = 8
"""Owners that may hold simulated time at once."""
COMMAND_ROWS = ("position", "velocity", "torque", "stiffness", "damping")
"""Rows of the snapshot's `command`: rad, rad/s, N·m, N·m/rad, N·m·s/rad."""


class Flag(enum.IntFlag):
    """Bits of the snapshot's `flags`."""

    ENABLED = 1
    """every drive in operation enabled and a controller active on every joint"""
    STOPPED = 2
    """the operator stop is latched"""
    ENABLING = 4
    """on the way to operation enabled"""
    HELD = 8
    """simulated time is held"""


class ActionState(enum.IntEnum):
    EMPTY = 0
    RUNNING = 1
    PAUSED = 2
    ENDED = 3


class Outcome(enum.IntEnum):
    """Why an action ended. The lower-case name is ActionEvent.outcome, but for CONDITION: there the end condition's tag is."""

    NONE = 0
    DONE = 1
    CANCELLED = 2
    STOPPED = 3
    OWNER_LOST = 4
    REFUSED_BY_LIMITS = 5
    DRIVE_FAULT = 6
    DIVERGED = 7
    CONDITION = 8
    """`condition` is the index in StartAction.ends"""


class Kind(enum.IntEnum):
    """What a command asks for. Stop and ClearStop don't come this way: they go to the stop socket, which is read first."""

    ENABLE = 1
    DISABLE = 2
    START = 3
    CANCEL = 4
    """`action`; the outcome is `cancelled`"""
    PAUSE = 5
    RESUME = 6
    LOSE_OWNER = 7
    """cancel every running action of `owner`; the outcome is `owner_lost`"""
    HOLD_TIME = 8
    """`owner`, `value` s of wall time at most (lock-step only)"""
    RELEASE_TIME = 9


class Answer(enum.IntEnum):
    """The loop's word on a command. `explain` says it for people."""

    NONE = 0
    ACCEPTED = 1
    NOT_ENABLED = 2
    STOP_LATCHED = 3
    CLAIMED = 4
    """`answer_joint` is claimed by another running action"""
    START_OFF = 5
    """the first knot of `answer_joint` is `answer_value` rad from what the robot is commanded"""
    EXPIRED = 6
    NO_SUCH_ACTION = 7
    TOO_MANY = 8
    """all action slots, or all holds, are taken"""
    DRIVE_FAULT = 9
    """the drive of `answer_joint` does not reach operation enabled"""
    MALFORMED = 10


CONTROLLERS = ("", "hold", "joint_trajectory", "cartesian_impedance")
"""Names of the codes in the snapshot's `claims`; 0: nobody commands this joint."""

MOTION_TRAJECTORY, MOTION_CARTESIAN = 1, 2
_END_KINDS: tuple[type, ...] = (TimeEnd, PoseErrorEnd, ForceEnd, ContactEnd, JointLimitEnd, DivergenceEnd)

_END = np.dtype([("kind", "u1"), ("has_axis", "u1"), ("frame", "i2"), ("value", "f8"), ("axis", "f8", 3)], align=True)

COMMAND = np.dtype(
    [
        ("serial", "u8"),
        ("kind", "u4"),
        ("owner", "u4"),  # number that the server gives each owner, from 1
        ("action", "u8"),  # CANCEL, PAUSE, RESUME: serial of the START meant
        ("value", "f8"),  # HOLD_TIME: limit s; START: hold_after_s
        ("expires_ns", "i8"),
        ("motion", "u4"),
        ("joint_count", "u4"),
        ("knot_count", "u4"),
        ("end_count", "u4"),
        ("joints", "i2", MAX_JOINTS),
        ("frame", "i4"),  # index into frame_names(); path force or Cartesian motion; -1: none
        ("gain", "f8"),
        ("limit", "f8"),
        ("goal", "f8", 7),  # position m, quaternion x y z w
        ("duration", "f8"),
        ("stiffness", "f8", 2),
        ("ends", _END, MAX_ENDS),
        ("payload_length", "u8"),  # float64s that follow
    ],
    align=True,
)
"""A command's header; a trajectory's knots follow as float64: times (k), positions (k·m), velocities (k·m)."""


def snapshot_dtype(joints: int, channels: int) -> np.dtype:
    """The record that the loop writes in every cycle, for a robot of `joints` joints on `channels` buses."""
    n = joints
    action = np.dtype(
        [
            ("serial", "u8"),  # of the START; 0: never used
            ("owner", "u4"),
            ("state", "u1"),
            ("outcome", "u1"),
            ("condition", "i2"),
            ("joint", "i2"),  # the joint that it was about, -1: none
            ("value", "f8"),  # the number that tripped: s, m, N or rad
            ("cycle", "i8"),  # of the last change of state
            ("time_ns", "i8"),
            ("path_force", "f8"),  # N
            ("progress", "f8"),  # s along the path
            ("position", "f8", n),  # rad, measured in the cycle of the last change of state
            ("command", "f8", n),  # rad, what was written in that cycle
        ],
        align=True,
    )
    return np.dtype(
        [
            ("cycle", "i8"),
            ("time_ns", "i8"),  # robot's clock
            ("position", "f8", n),
            ("velocity", "f8", n),
            ("torque", "f8", n),
            ("command", "f8", (len(COMMAND_ROWS), n)),
            ("mode", "u1", n),
            ("claims", "u1", n),  # index into CONTROLLERS
            ("external_force", "f8", 3),
            ("status", "u2", n),  # CiA 402 statusword
            ("error", "u1", n),
            ("temperature", "f4", n),
            ("age", "i4", n),  # cycles since the drive's last valid reply
            ("flags", "u4"),
            ("stop_reason", "S256"),  # UTF-8
            ("holds", "u4", MAX_HOLDS),  # owners that hold simulated time, 0: none
            ("answered", "u8"),  # serial of the last command handled
            ("answer", "u1"),
            ("answer_joint", "i2"),
            ("answer_value", "f8"),
            ("actions", action, SLOTS),
            ("misses", "i8"),  # periods skipped
            ("stale_replies", "i8"),
            ("crc_errors", "i8"),
            ("limited", "i8"),  # cycles in which the final limits changed a command
            ("work_ns", "i8"),  # of the cycle before this one
            ("late_ns", "i8"),
            ("frames_sent", "i8", channels),
            ("frames_received", "i8", channels),
            ("busy_ns", "i8", channels),  # bus time in use since the start, both directions
        ],
        align=True,
    )


def frame_names(description: RobotDescription) -> tuple[str, ...]:
    """Frames that a command may name: the URDF's links in the file's order, then the arms' tools and tips that are no links.

    Loop and server make the same table, so an index says it all and the server needs no pinocchio.
    """
    names = [link.attrib["name"] for link in ElementTree.parse(description.urdf).getroot().iter("link")]
    for arm in description.arms.values():
        names += [frame for frame in (arm.tool, arm.tip) if frame not in names]
    return tuple(names)


# ------------------------------------------------------------------------------------------------------ server to loop


def encode_command(kind: Kind, serial: int, *, owner: int = 0, action: int = 0, value: float = 0.0) -> np.ndarray:
    """Header of a command without payload. COMMAND, shape ()."""
    header = np.zeros((), COMMAND)
    header["serial"], header["kind"], header["owner"] = serial, kind, owner
    header["action"], header["value"], header["frame"] = action, value, -1
    return header


def encode_start(
    message: StartAction,
    serial: int,
    owner: int,
    joint_index: Mapping[str, int],
    frame_index: Mapping[str, int],
) -> tuple[np.ndarray, NDArray[np.float64]]:
    """(header, payload) of a StartAction that the server has checked already.

    `joint_index`: position in RobotDescription.joints; `frame_index`: position in `frame_names`. Raises KeyError on a name that
    isn't there, ValueError where the message has more joints or end conditions than a command holds.
    """
    header = encode_command(Kind.START, serial, owner=owner, value=message.hold_after_s)
    motion = message.motion
    if len(motion.joints) > MAX_JOINTS:
        raise ValueError(f"motion.joints: {len(motion.joints)}; expected at most {MAX_JOINTS}")
    if len(message.ends) > MAX_ENDS:
        raise ValueError(f"ends: {len(message.ends)}; expected at most {MAX_ENDS}")
    header["expires_ns"] = message.expires_ns
    header["joint_count"] = len(motion.joints)
    header["joints"][: len(motion.joints)] = [joint_index[name] for name in motion.joints]
    header["end_count"] = len(message.ends)
    for row, end in zip(header["ends"], message.ends, strict=False):
        _encode_end(row, end, frame_index)
    payload = np.zeros(0)
    if isinstance(motion, JointTrajectory):
        header["motion"], header["knot_count"] = MOTION_TRAJECTORY, len(motion.times)
        if motion.path_force is not None:
            header["frame"] = frame_index[motion.path_force.frame]
            header["gain"], header["limit"] = motion.path_force.gain, motion.path_force.limit
        knots = (motion.times, motion.positions, motion.velocities)
        payload = np.concatenate([np.asarray(part, float).ravel() for part in knots])
    else:
        header["motion"], header["frame"] = MOTION_CARTESIAN, frame_index[motion.frame]
        header["goal"][:3], header["goal"][3:] = motion.goal_in_world.position, motion.goal_in_world.orientation
        header["duration"], header["stiffness"] = motion.duration, motion.stiffness
    header["payload_length"] = len(payload)
    return header, payload


def _encode_end(row: np.void, end: EndCondition, frame_index: Mapping[str, int]) -> None:
    row["kind"], row["frame"] = _END_KINDS.index(type(end)), -1
    if isinstance(end, PoseErrorEnd | ForceEnd | ContactEnd):
        row["frame"] = frame_index[end.frame]
    if isinstance(end, PoseErrorEnd | ForceEnd) and end.axis is not None:
        row["has_axis"], row["axis"] = 1, end.axis
    if isinstance(end, TimeEnd):
        row["value"] = end.after
    elif isinstance(end, PoseErrorEnd):
        row["value"] = end.position
    elif isinstance(end, ForceEnd):
        row["value"] = end.limit
    elif isinstance(end, ContactEnd):
        row["value"] = end.threshold
    elif isinstance(end, JointLimitEnd):
        row["value"] = end.margin
    else:
        row["value"] = end.error


@dataclass(frozen=True)
class TrajectoryMotion:
    """Knots to follow; k knots, m joints."""

    joints: NDArray[np.int64]
    """(m,) indices into RobotDescription.joints"""
    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    velocities: NDArray[np.float64]
    path_force: PathForce | None = None


@dataclass(frozen=True)
class CartesianMotion:
    """A straight line of one frame to a goal."""

    joints: NDArray[np.int64]
    frame: str
    goal_in_world: Pose
    duration: float
    stiffness: tuple[float, float]


@dataclass(frozen=True)
class Command:
    """A command as the loop handles it."""

    serial: int
    kind: Kind
    owner: int = 0
    action: int = 0
    value: float = 0.0
    expires_ns: int = 0
    motion: TrajectoryMotion | CartesianMotion | None = None
    ends: tuple[EndCondition, ...] = ()


def decode(header: np.ndarray, payload: NDArray[np.float64], frames: Sequence[str]) -> Command:
    """A command from its header (COMMAND, shape () or (1,)) and payload; owns its arrays.

    `frames`: `frame_names(description)`. Raises ValueError where header and payload don't fit each other.
    """
    header = header.reshape(())
    kind = Kind(int(header["kind"]))
    motion: TrajectoryMotion | CartesianMotion | None = None
    ends: tuple[EndCondition, ...] = ()
    if kind is Kind.START:
        m, k = int(header["joint_count"]), int(header["knot_count"])
        if not 0 < m <= MAX_JOINTS or int(header["end_count"]) > MAX_ENDS:
            raise ValueError(f"command {int(header['serial'])}: {m} joints, {int(header['end_count'])} end conditions")
        joints = header["joints"][:m].astype(np.int64)
        frame = int(header["frame"])
        if int(header["motion"]) == MOTION_TRAJECTORY:
            if k < 1 or len(payload) != k * (1 + 2 * m):
                raise ValueError(f"command {int(header['serial'])}: {len(payload)} numbers for {k} knots of {m} joints")
            own = np.array(payload, float)
            force = None
            if frame >= 0:
                force = PathForce(frame=frames[frame], gain=float(header["gain"]), limit=float(header["limit"]))
            positions, velocities = own[k : k + k * m].reshape(k, m), own[k + k * m :].reshape(k, m)
            motion = TrajectoryMotion(joints, own[:k], positions, velocities, force)
        else:
            goal = [float(x) for x in header["goal"]]
            pose = Pose(position=(goal[0], goal[1], goal[2]), orientation=(goal[3], goal[4], goal[5], goal[6]))
            stiffness = (float(header["stiffness"][0]), float(header["stiffness"][1]))
            motion = CartesianMotion(joints, frames[frame], pose, float(header["duration"]), stiffness)
        ends = tuple(_decode_end(row, frames) for row in header["ends"][: int(header["end_count"])])
    return Command(
        serial=int(header["serial"]),
        kind=kind,
        owner=int(header["owner"]),
        action=int(header["action"]),
        value=float(header["value"]),
        expires_ns=int(header["expires_ns"]),
        motion=motion,
        ends=ends,
    )


def _decode_end(row: np.void, frames: Sequence[str]) -> EndCondition:
    value, frame = float(row["value"]), frames[int(row["frame"])] if row["frame"] >= 0 else ""
    axis = (float(row["axis"][0]), float(row["axis"][1]), float(row["axis"][2]))
    kind = _END_KINDS[int(row["kind"])]
    if kind is TimeEnd:
        return TimeEnd(after=value)
    if kind is PoseErrorEnd:
        return PoseErrorEnd(frame=frame, position=value, axis=axis if row["has_axis"] else None)
    if kind is ForceEnd:
        return ForceEnd(frame=frame, axis=axis, limit=value)
    if kind is ContactEnd:
        return ContactEnd(frame=frame, threshold=value)
    if kind is JointLimitEnd:
        return JointLimitEnd(margin=value)
    return DivergenceEnd(error=value)


# ------------------------------------------------------------------------------------------------------ loop to server


def robot_state(snapshot: np.ndarray) -> RobotState:
    """The snapshot (shape ()) as the message that clients see."""
    force = snapshot["external_force"]
    return RobotState(
        time_ns=int(snapshot["time_ns"]),
        cycle=int(snapshot["cycle"]),
        position=snapshot["position"].tolist(),
        velocity=snapshot["velocity"].tolist(),
        torque=snapshot["torque"].tolist(),
        command=snapshot["command"][0].tolist(),
        external_force=(float(force[0]), float(force[1]), float(force[2])),
    )


def active_controllers(snapshot: np.ndarray, joints: Sequence[str]) -> dict[str, list[str]]:
    """Active controller → the joints that it claims."""
    claimed: dict[str, list[str]] = {}
    for joint, code in zip(joints, snapshot["claims"], strict=True):
        if code:
            claimed.setdefault(CONTROLLERS[code], []).append(joint)
    return claimed


def action_event(
    slot: np.ndarray | np.void, action_id: str, ends: Sequence[EndCondition], joints: Sequence[str]
) -> ActionEvent:
    """A slot of a snapshot as an event; `action_id` and `ends` are those of the StartAction with the slot's serial."""
    state = ActionState(int(slot["state"]))
    if state is not ActionState.ENDED:
        name: Literal["running", "paused"] = "paused" if state is ActionState.PAUSED else "running"
        return ActionEvent(id=action_id, state=name, time_ns=int(slot["time_ns"]), cycle=int(slot["cycle"]))
    outcome = Outcome(int(slot["outcome"]))
    text = outcome.name.lower()
    detail = ""
    if outcome is Outcome.CONDITION:
        end = ends[int(slot["condition"])]
        text = str(end.__struct_config__.tag)
        detail = f"ends[{int(slot['condition'])}]: {text} reached {float(slot['value']):.4g}"
    if slot["joint"] >= 0:
        detail = f"{detail} at {joints[int(slot['joint'])]}".strip()
    return ActionEvent(
        id=action_id,
        state="ended",
        outcome=text,
        detail=detail,
        time_ns=int(slot["time_ns"]),
        cycle=int(slot["cycle"]),
        position=slot["position"].tolist(),
        command=slot["command"].tolist(),
        path_force=float(slot["path_force"]),
    )


def explain(answer: Answer, joint: str, value: float) -> tuple[str, str, str, str]:
    """(message, field, value, expectation) of a command that the loop did not accept; `joint` is that of `answer_joint`, or ""."""
    told = {
        Answer.NOT_ENABLED: ("the robot is not enabled: call Enable first", "enabled", "false", "true"),
        Answer.STOP_LATCHED: ("the operator stop is latched: call ClearStop first", "stopped", "true", "false"),
        Answer.CLAIMED: (f"{joint} is claimed by another running action", "motion.joints", joint, "free joints"),
        Answer.START_OFF: (
            f"the trajectory does not start where the robot is commanded to be: plan again ({joint})",
            "motion.positions[0]",
            f"{value:.4f} rad off",
            "within 0.02 rad of the command",
        ),
        Answer.EXPIRED: ("the command came after it expired", "expires_ns", f"{value:.3f} s ago", "in the future"),
        Answer.NO_SUCH_ACTION: ("no such action is running", "id", "", "a running action"),
        Answer.TOO_MANY: ("too many at once: end one first", "count", "", "a free slot"),
        Answer.DRIVE_FAULT: (f"the drive of {joint} does not enable", "drive", joint, "a drive without fault"),
        Answer.MALFORMED: ("the loop could not read the command", "command", "", "a well-formed command"),
    }
    return told.get(answer, (f"the loop answered {answer.name.lower()}", "", "", ""))


# ------------------------------------------------------------------------------------------------------- who carries them


class StateWriter(Protocol):
    """The loop's end of the ring (daemon.ring.StateRingWriter)."""

    record: np.ndarray
    """snapshot_dtype, shape (): filled by the loop"""

    def publish(self) -> int:
        """Let readers see a copy of `record`; never blocks."""


class CommandReader(Protocol):
    """The loop's end of the mailbox (daemon.ring.MailboxReader)."""

    def take(self) -> tuple[np.ndarray, NDArray[np.float64]] | None:
        """(header COMMAND shape (1,), payload) of the oldest waiting command, valid until `done`; None when none waits."""

    def done(self) -> None:
        """Give the command taken last back."""
