"""Commands: written by the server from messages that it has checked, read once by the loop."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from daemon.exchange.records import COMMAND, MAX_ENDS, MAX_JOINTS, Kind
from handrail.messages import (
    CompliantMotion,
    ContactEnd,
    DivergenceEnd,
    EndCondition,
    ForceEnd,
    GripperAtEnd,
    GripperHoldsEnd,
    JointLimitEnd,
    JointStream,
    JointTarget,
    JointTrajectory,
    PathForce,
    Pose,
    PoseErrorEnd,
    StallEnd,
    StartAction,
    StartBehaviour,
    Step,
    StreamJoints,
    StreamPose,
    TaskAxis,
    TimeEnd,
    TorqueLimitEnd,
    TravelEnd,
    WholeBody,
)

MOTION_TRAJECTORY, MOTION_CARTESIAN, MOTION_COMPLIANT, MOTION_PREPARED, MOTION_STREAM, MOTION_TARGET = range(1, 7)
TASK_AXES: tuple[TaskAxis, ...] = ("x", "y", "z", "rx", "ry", "rz")
COMPLIANCE_ROWS = ("on", "force", "stiffness", "damping", "speed", "reach")
DITHER_ROWS = ("amplitude", "frequency")
_LINEAR, _ANGULAR = {"damping": 100.0, "speed": 0.03, "reach": 0.1}, {"damping": 2.0, "speed": 0.2, "reach": 0.5}
"""what a compliant axis has where its message says 0"""
_OF_DEVICES = (Kind.DEVICE, Kind.RELAY, Kind.TARE)
_OF_CONTROLLERS = (Kind.LOAD, Kind.CONFIGURE, Kind.SWITCH, Kind.UNLOAD)
_OF_GRIPPERS = GripperHoldsEnd | GripperAtEnd
_NOBODYS: Mapping[str, int] = {}
_NOTHING: Mapping[int, int] = {}
_END_VALUES: dict[type, str] = {
    TimeEnd: "after",
    PoseErrorEnd: "position",
    ForceEnd: "limit",
    ContactEnd: "threshold",
    JointLimitEnd: "margin",
    DivergenceEnd: "error",
    TorqueLimitEnd: "share",
    StallEnd: "distance",
    TravelEnd: "distance",
    GripperHoldsEnd: "",
    GripperAtEnd: "position",
}
"""end condition → the field of it that is the record's `value`, if any"""
_END_KINDS = tuple(_END_VALUES)


def encode_command(kind: Kind, serial: int, *, owner: int = 0, action: int = 0, value: float = 0.0) -> np.ndarray:
    """Header of a command without payload. COMMAND, shape ()."""
    header = np.zeros((), COMMAND)
    header["serial"], header["kind"], header["owner"] = serial, kind, owner
    header["action"], header["value"], header["frame"] = action, value, -1
    return header


def encode_device(serial: int, device: int, values: Sequence[float], kind: Kind = Kind.DEVICE) -> np.ndarray:
    """Header of a command for one device: its row in RobotDescription.devices, and hal.device's commanded columns (or what
    else its kind says)."""
    header = encode_command(kind, serial)
    header["device"] = device
    header["device_values"][: len(values)] = values
    return header


def encode_controllers(
    kind: Kind, serial: int, *, come: int = 0, go: int = 0, roster: int = 0, text: bytes = b""
) -> tuple[np.ndarray, NDArray[np.float64]]:
    """(header, payload) of a command about loaded controllers: bit masks of slots, and JSON, padded with spaces."""
    header = encode_command(kind, serial, action=roster)
    header["controllers"] = come, go
    payload = np.frombuffer(text.ljust(-(-len(text) // 8) * 8), np.float64)
    header["payload_length"] = len(payload)
    return header, payload


def encode_start(
    message: StartAction,
    serial: int,
    owner: int,
    joint_index: Mapping[str, int],
    frame_index: Mapping[str, int],
    prepared: int = 0,
    device_index: Mapping[str, int] = _NOBODYS,
) -> tuple[np.ndarray, NDArray[np.float64]]:
    """(header, payload) of a StartAction that the server has checked already.

    `joint_index`: position in RobotDescription.joints; `frame_index`: position in `frame_names`; `prepared`: serial of the PREPARE
    that made a whole-body motion's controller; `device_index`: row in RobotDescription.devices. Raises KeyError on a name that
    isn't there, ValueError where the message has more joints or end conditions than a command holds.
    """
    header = encode_command(Kind.START, serial, owner=owner, value=message.hold_after_s)
    motion = message.motion
    joints = motion.joints or (list(joint_index) if isinstance(motion, WholeBody) else [])
    if len(joints) > MAX_JOINTS:
        raise ValueError(f"motion.joints: {len(joints)}; expected at most {MAX_JOINTS}")
    if len(message.ends) > MAX_ENDS:
        raise ValueError(f"ends: {len(message.ends)}; expected at most {MAX_ENDS}")
    header["expires_ns"] = message.expires_ns
    header["joint_count"] = len(joints)
    header["joints"][: len(joints)] = [joint_index[name] for name in joints]
    header["end_count"] = len(message.ends)
    for row, end in zip(header["ends"], message.ends, strict=False):
        _encode_end(row, end, device_index if isinstance(end, _OF_GRIPPERS) else frame_index)
    payload = np.zeros(0)
    if isinstance(motion, JointTrajectory):
        header["motion"], header["knot_count"] = MOTION_TRAJECTORY, len(motion.times)
        if motion.path_force is not None:
            header["frame"] = frame_index[motion.path_force.frame]
            header["gain"], header["limit"] = motion.path_force.gain, motion.path_force.limit
        knots = (motion.times, motion.positions, motion.velocities)
        payload = np.concatenate([np.asarray(part, float).ravel() for part in knots])
    elif isinstance(motion, WholeBody):
        header["motion"], header["action"] = MOTION_PREPARED, prepared
    elif isinstance(motion, JointStream):
        header["motion"], payload = MOTION_STREAM, np.array([motion.bridge, motion.expiry, motion.speed])
    elif isinstance(motion, JointTarget):
        header["motion"], payload = MOTION_TARGET, np.array([motion.speed, *motion.positions])
    else:
        header["motion"], header["frame"] = MOTION_CARTESIAN, frame_index[motion.frame]
        if motion.goal_in_world is not None:
            header["goal"][:3], header["goal"][3:] = motion.goal_in_world.position, motion.goal_in_world.orientation
        header["duration"], header["stiffness"] = motion.duration, motion.stiffness
    if isinstance(motion, CompliantMotion):
        header["motion"], payload = MOTION_COMPLIANT, _encode_task(motion)
    header["payload_length"] = len(payload)
    return header, payload


def encode_behaviour(
    message: StartBehaviour,
    serial: int,
    owner: int,
    joint_index: Mapping[str, int],
    frame_index: Mapping[str, int],
    device_index: Mapping[str, int] = _NOBODYS,
    orders: Mapping[int, tuple[float, float, float]] | None = None,
    prepared: Mapping[int, int] = _NOTHING,
) -> tuple[np.ndarray, NDArray[np.float64]]:
    """(header, payload) of a StartBehaviour that the server has checked already; see `encode_start`.

    `orders`: row of each step that moves a gripper → position, velocity, effort, none of them left out; `prepared`: row of each
    whole-body step → serial of the PREPARE that made its controller.
    """
    header = encode_command(Kind.BEHAVIOUR, serial, owner=owner, value=message.hold_after_s)
    header["expires_ns"], header["most_steps"] = message.expires_ns, message.most_steps
    header["step_count"] = len(message.steps)
    parts = []
    for number, step in enumerate(message.steps):
        action = StartAction(id=message.id, owner=message.owner, motion=step.motion, ends=step.ends)
        made = prepared.get(number, 0)
        own, payload = encode_start(action, serial, owner, joint_index, frame_index, made, device_index)
        own["device"] = -1
        if step.gripper is not None:
            own["device"] = device_index[step.gripper.gripper]
            own["device_values"][:3] = (orders or {})[number]
        own["then"][: 1 + len(step.ends)] = followers(message.steps, number)
        parts += [np.frombuffer(own.tobytes(), np.float64), payload]
    payload = np.concatenate(parts)
    header["payload_length"] = len(payload)
    return header, payload


def followers(steps: Sequence[Step], number: int) -> list[int]:
    """Row of the step that follows one of `steps` after `done`, and after each of its `ends`; −1: none."""
    rows = {step.name: row for row, step in enumerate(steps)} | {"end": -1}
    step = steps[number]
    after_done = rows[step.then["done"]] if "done" in step.then else (number + 1 if number + 1 < len(steps) else -1)
    after_ends = [
        rows[step.then.get(f"ends[{i}]", step.then.get(str(end.__struct_config__.tag), "end"))]
        for i, end in enumerate(step.ends)
    ]
    return [after_done, *after_ends]


def _encode_task(motion: CompliantMotion) -> NDArray[np.float64]:
    """What of a compliant motion is not in the header: has a goal, shift (3), axes (4), turn with the frame, compliance, dither."""
    compliance, dither = np.zeros((len(COMPLIANCE_ROWS), 6)), np.zeros((len(DITHER_ROWS), 6))
    for axis in motion.compliance:
        column = TASK_AXES.index(axis.axis)
        usual = _LINEAR if column < 3 else _ANGULAR
        given = [getattr(axis, name) or usual.get(name, 0.0) for name in COMPLIANCE_ROWS[1:]]
        compliance[:, column] = [1.0, *given]
    for swing in motion.dither:
        dither[:, TASK_AXES.index(swing.axis)] = swing.amplitude, swing.frequency
    head = [motion.goal_in_world is not None, *motion.shift, *motion.axes, motion.axes_in == "frame"]
    return np.concatenate([np.array(head, float), compliance.ravel(), dither.ravel()])


def encode_prepare(motion: WholeBody, serial: int) -> tuple[np.ndarray, NDArray[np.float64]]:
    """(header, payload) that ask for the controller of a motion that the server has checked."""
    payload = _packed(msgspec.msgpack.encode(motion))
    header = encode_command(Kind.PREPARE, serial)
    header["payload_length"] = len(payload)
    return header, payload


def encode_stream(message: StreamPose, serial: int, action: int) -> tuple[np.ndarray, NDArray[np.float64]]:
    """(header, payload) of a streamed reference of the START with serial `action`."""
    none = (np.nan,) * 4
    numbers = np.array([*(message.position or none[:3]), *(message.orientation or none), *message.velocity])
    payload = np.concatenate((numbers, _packed(message.task.encode())))
    header = encode_command(Kind.STREAM, serial, action=action)
    header["payload_length"] = len(payload)
    return header, payload


def encode_joints(message: StreamJoints, serial: int, action: int) -> tuple[np.ndarray, NDArray[np.float64]]:
    """(header, payload) of a sample for the START with serial `action`."""
    header = encode_command(Kind.STREAM_JOINTS, serial, action=action, value=float(message.sequence))
    payload = np.array([*message.positions, *(message.velocities or [0.0] * len(message.positions))], float)
    header["expires_ns"], header["payload_length"] = message.expires_ns, len(payload)
    return header, payload


def _packed(text: bytes) -> NDArray[np.float64]:
    """Bytes as float64: how many, then they."""
    return np.concatenate(([len(text)], np.frombuffer(text.ljust(-(-len(text) // 8) * 8, b"\0"), np.float64)))


def _unpacked(payload: NDArray[np.float64]) -> bytes:
    if not len(payload) or not 0 <= payload[0] <= 8 * (len(payload) - 1):
        raise ValueError("a payload that is shorter than it says")
    return payload[1:].tobytes()[: int(payload[0])]


def _encode_end(row: np.void, end: EndCondition, index: Mapping[str, int]) -> None:
    """`index`: of frames, or of devices where the condition is about one."""
    row["kind"], row["frame"] = _END_KINDS.index(type(end)), -1
    if value := _END_VALUES[type(end)]:
        row["value"] = getattr(end, value)
    if isinstance(end, _OF_GRIPPERS):
        row["frame"] = index[end.gripper]
    if isinstance(end, PoseErrorEnd | ForceEnd | ContactEnd | StallEnd | TravelEnd):
        row["frame"] = index[end.frame]
    if isinstance(end, PoseErrorEnd | ForceEnd | TravelEnd) and end.axis is not None:
        row["has_axis"], row["axis"] = 1, end.axis
    if isinstance(end, StallEnd):
        row["within"] = end.within
    if isinstance(end, GripperAtEnd):
        row["within"] = end.tolerance


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
class PreparedMotion:
    """One whose controller was made beforehand."""

    joints: NDArray[np.int64]
    prepared: int
    """serial of the PREPARE"""
    controller: Any = None
    """daemon.controllers.base.MotionController, once somebody has fetched it"""


@dataclass(frozen=True)
class StreamMotion:
    """What a client streams."""

    joints: NDArray[np.int64]
    bridge: float
    """s for which the newest sample goes on"""
    expiry: float
    """s without a sample after which it ends"""
    speed: float
    """rad/s"""


@dataclass(frozen=True)
class TargetMotion:
    """Where joints go, point to point."""

    joints: NDArray[np.int64]
    speed: float
    """share of the velocity limits"""
    positions: NDArray[np.float64]
    """(m,) rad"""


@dataclass(frozen=True)
class JointSample:
    """Where joints are to be, in the order of their motion."""

    sequence: int
    position: NDArray[np.float64]
    """(m,) rad"""
    velocity: NDArray[np.float64]
    """(m,) rad/s"""


@dataclass(frozen=True)
class StreamedReference:
    """Where a task's frame is to be; none: as sent before."""

    task: str
    position: NDArray[np.float64] | None
    """(3,) m"""
    orientation: NDArray[np.float64] | None
    """(4,) x y z w"""
    velocity: NDArray[np.float64]
    """(6,) m/s, rad/s"""


@dataclass(frozen=True)
class TaskFrameMotion:
    """A path of one frame, with compliance and dither on axes of a task frame (messages.CompliantMotion, nothing left out)."""

    joints: NDArray[np.int64]
    frame: str
    goal_in_world: Pose | None
    shift: NDArray[np.float64]
    """(3,) m along the axes"""
    axes: NDArray[np.float64]
    """(4,) unit quaternion x y z w"""
    turns_with_frame: bool
    duration: float
    stiffness: tuple[float, float]
    compliance: NDArray[np.float64]
    """(COMPLIANCE_ROWS, 6)"""
    dither: NDArray[np.float64]
    """(DITHER_ROWS, 6)"""


MotionCommand = TrajectoryMotion | CartesianMotion | TaskFrameMotion | PreparedMotion | StreamMotion | TargetMotion


@dataclass(frozen=True)
class StepCommand:
    """A step of a behaviour."""

    motion: MotionCommand
    ends: tuple[EndCondition, ...]
    then: tuple[int, ...]
    """row of the step that follows `done`, and each of `ends`; −1: none"""
    gripper: int = -1
    """row of the device that it sends somewhere; −1: none"""
    order: NDArray[np.float64] | None = None
    """hal.device's commanded columns"""


@dataclass(frozen=True)
class Command:
    """A command as the loop handles it."""

    serial: int
    kind: Kind
    owner: int = 0
    action: int = 0
    value: float = 0.0
    expires_ns: int = 0
    motion: MotionCommand | None = None
    ends: tuple[EndCondition, ...] = ()
    steps: tuple[StepCommand, ...] = ()
    """BEHAVIOUR; `motion` and `ends` are then the first one's"""
    most_steps: int = 0
    reference: StreamedReference | None = None
    sample: JointSample | None = None
    device: int = -1
    device_values: NDArray[np.float64] | None = None
    """hal.device's commanded columns, or what Kind.RELAY says"""
    come: int = 0
    """loaded controllers that start, a bit mask of slots; and those that end, or are meant"""
    go: int = 0
    text: bytes = b""
    """JSON that the loop does not read"""


def decode(
    header: np.ndarray, payload: NDArray[np.float64], frames: Sequence[str], devices: Sequence[str] = ()
) -> Command:
    """A command from its header (COMMAND, shape () or (1,)) and payload; owns its arrays.

    `frames`: `frame_names(description)`; `devices`: their names. Raises ValueError where header and payload don't fit each other.
    """
    header = header.reshape(())
    kind = Kind(int(header["kind"]))
    motion: MotionCommand | None = None
    ends: tuple[EndCondition, ...] = ()
    steps: tuple[StepCommand, ...] = ()
    if kind is Kind.BEHAVIOUR:
        steps = tuple(_decode_steps(header, payload, frames, devices))
        motion, ends = steps[0].motion, steps[0].ends
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
        elif int(header["motion"]) == MOTION_PREPARED:
            motion = PreparedMotion(joints, int(header["action"]))
        elif int(header["motion"]) == MOTION_STREAM:
            if len(payload) != 3 or not (np.isfinite(payload) & (payload > 0.0)).all():
                raise ValueError(f"command {int(header['serial'])}: no bridge, expiry and speed of a stream")
            motion = StreamMotion(joints, *np.array(payload, float).tolist())
        elif int(header["motion"]) == MOTION_TARGET:
            own = np.array(payload, float)
            if len(own) != 1 + m or not np.isfinite(own).all() or not 0.0 < own[0] <= 1.0:
                raise ValueError(f"command {int(header['serial'])}: no speed and target of {m} joints")
            motion = TargetMotion(joints, float(own[0]), own[1:])
        else:
            goal = [float(x) for x in header["goal"]]
            pose = Pose(position=(goal[0], goal[1], goal[2]), orientation=(goal[3], goal[4], goal[5], goal[6]))
            stiffness = (float(header["stiffness"][0]), float(header["stiffness"][1]))
            if int(header["motion"]) == MOTION_COMPLIANT:
                motion = _decode_task(joints, frames[frame], pose, float(header["duration"]), stiffness, payload)
            else:
                motion = CartesianMotion(joints, frames[frame], pose, float(header["duration"]), stiffness)
        ends = tuple(_decode_end(row, frames, devices) for row in header["ends"][: int(header["end_count"])])
    return Command(
        serial=int(header["serial"]),
        kind=kind,
        owner=int(header["owner"]),
        action=int(header["action"]),
        value=float(header["value"]),
        expires_ns=int(header["expires_ns"]),
        motion=motion,
        ends=ends,
        steps=steps,
        most_steps=int(header["most_steps"]),
        reference=_decode_stream(payload) if kind is Kind.STREAM else None,
        sample=_decode_sample(header, payload) if kind is Kind.STREAM_JOINTS else None,
        device=int(header["device"]) if kind in _OF_DEVICES else -1,
        device_values=header["device_values"].copy() if kind in _OF_DEVICES else None,
        come=int(header["controllers"][0]),
        go=int(header["controllers"][1]),
        text=_text(kind, payload),
    )


def _decode_steps(
    header: np.ndarray, payload: NDArray[np.float64], frames: Sequence[str], devices: Sequence[str]
) -> Iterator[StepCommand]:
    size, at, count = COMMAND.itemsize // 8, 0, int(header["step_count"])
    if count < 1:
        raise ValueError("a behaviour without steps")
    for _ in range(count):
        if len(payload) < at + size:
            raise ValueError(f"command {int(header['serial'])}: {len(payload)} numbers for {count} steps")
        own = np.frombuffer(payload[at : at + size].tobytes(), COMMAND).reshape(())
        at += size
        length = int(own["payload_length"])
        step = decode(own, payload[at : at + length], frames, devices)
        at += length
        then = tuple(own["then"][: 1 + len(step.ends)].tolist())
        if step.kind is not Kind.START or step.motion is None or not all(-1 <= row < count for row in then):
            raise ValueError(f"command {int(header['serial'])}: a step that is none")
        yield StepCommand(step.motion, step.ends, then, int(own["device"]), own["device_values"].copy())


def _decode_task(
    joints: NDArray[np.int64],
    frame: str,
    goal: Pose,
    duration: float,
    stiffness: tuple[float, float],
    payload: NDArray[np.float64],
) -> TaskFrameMotion:
    own = np.array(payload, float)
    rows = (len(COMPLIANCE_ROWS), len(DITHER_ROWS))
    if len(own) != 9 + 6 * sum(rows):
        raise ValueError(f"{len(own)} numbers for a compliant motion; expected {9 + 6 * sum(rows)}")
    tables = own[9:].reshape(sum(rows), 6)
    return TaskFrameMotion(
        joints=joints,
        frame=frame,
        goal_in_world=goal if own[0] else None,
        shift=own[1:4],
        axes=own[4:8],
        turns_with_frame=bool(own[8]),
        duration=duration,
        stiffness=stiffness,
        compliance=tables[: rows[0]],
        dither=tables[rows[0] :],
    )


def _text(kind: Kind, payload: NDArray[np.float64]) -> bytes:
    if kind is Kind.PREPARE and len(payload):
        return _unpacked(payload)
    return payload.tobytes() if kind in _OF_CONTROLLERS else b""


def _decode_stream(payload: NDArray[np.float64]) -> StreamedReference:
    position, orientation, velocity = np.split(np.array(payload[:13], float), (3, 7))
    if len(velocity) != 6:
        raise ValueError(f"{len(payload)} numbers for a pose and its velocity")
    return StreamedReference(
        _unpacked(payload[13:]).decode(),
        None if np.isnan(position).all() else position,
        None if np.isnan(orientation).all() else orientation,
        velocity,
    )


def _decode_sample(header: np.ndarray, payload: NDArray[np.float64]) -> JointSample:
    numbers = np.array(payload, float)
    if len(numbers) % 2 or not np.isfinite(numbers).all() or not 0.0 < float(header["value"]) < 2.0**53:
        raise ValueError(
            f"command {int(header['serial'])}: {len(numbers)} numbers, or what is none, for joints' references"
        )
    position, velocity = np.split(numbers, 2)
    return JointSample(int(header["value"]), position, velocity)


def _decode_end(row: np.void, frames: Sequence[str], devices: Sequence[str]) -> EndCondition:
    kind = _END_KINDS[int(row["kind"])]
    fields: dict[str, Any] = {_END_VALUES[kind]: float(row["value"])} if _END_VALUES[kind] else {}
    if kind is GripperHoldsEnd or kind is GripperAtEnd:
        if not 0 <= row["frame"] < len(devices):
            raise ValueError(f"an end condition about device {int(row['frame'])} of {len(devices)}")
        fields["gripper"] = devices[int(row["frame"])]
    elif row["frame"] >= 0:
        fields["frame"] = frames[int(row["frame"])]
    if row["has_axis"]:
        fields["axis"] = tuple(row["axis"].tolist())
    if kind is StallEnd:
        fields["within"] = float(row["within"])
    if kind is GripperAtEnd:
        fields["tolerance"] = float(row["within"])
    end: EndCondition = kind(**fields)
    return end
