"""Recordings: everything that the robot says, as an MCAP file that Foxglove opens.

    python -m handrail.recorder --runtime DIR --out FILE.mcap

A process of its own that listens to the local topics. Joints, transforms and logs are written as Foxglove's well-known types, the
rest as our messages; all are JSON with schemas. Time in the file is the robot's clock, set off so that the recording begins at the
hour it was made; a message's own `time_ns` stays as it was. SIGTERM (or Ctrl-C) finishes the file.

| topic | schema | |
| --- | --- | --- |
| /joint_states, /joint_commands | foxglove.JointStates | measured rad, rad/s, N·m; commanded rad; every RobotState (100 Hz) |
| /tf | foxglove.FrameTransforms | links, tools, instances in base_link, or with a free base in world, 25 Hz |
| /base | handrail.Base | where a free base is; every RobotState |
| /camera/NAME | foxglove.PointCloud | what a depth camera sees, in the same frame, as it comes |
| /tool/ARM | foxglove.PoseInFrame | the tool's contact point, 25 Hz |
| /daemon_status, /action, /controller, /run_state, /instance, /plan, /prompt, /prompt_closed | handrail.* | as they come |
| /can/CHANNEL | handrail.BusStatistics | with each DaemonStatus |
| /device/NAME | handrail.ImuState, ForceTorqueState, GripperState, PowerState | each DeviceStates (25 Hz) |
| /log | foxglove.Log | as they come |

`handrail up --record` starts this with the control loop's tape in the same file, which `handrail replay` runs
(daemon.replay.recorder).
"""

from __future__ import annotations

import select
import signal
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import IO, Annotated, Any

import msgspec
import numpy as np
import typer
import zmq
from mcap.writer import CompressionType, Writer

from handrail import cloud, foxglove
from handrail.config import ConfigError
from handrail.messages import (
    ActionEvent,
    CodeChanged,
    ControllerEvent,
    DaemonEvent,
    DaemonStatus,
    DeviceStates,
    EngineEvent,
    EngineInfo,
    GetRobot,
    InstanceState,
    LinkEvent,
    LogLine,
    Mark,
    PlanPreview,
    PlanProgress,
    PointCloud,
    PortValue,
    Pose,
    Prompt,
    PromptClosed,
    Reach,
    RobotInfo,
    RobotState,
    RunState,
    SensorEvent,
)
from handrail.runtime import Runtime
from handrail.topics import Caller, RefusedError, Subscriber, Unreachable

TRANSFORM_PERIOD_NS = 40_000_000
BASE, WORLD = "base_link", "world"
"""frames in which poses are told: a fixed base's is the world's"""
_LOOK_MS = 100
"""wall time after which other ways than messages are looked at though nobody says anything"""
BATCH_S = 0.05
"""wall time in which messages gather: nobody waits for a recording, and being woken for each costs more than writing it"""

_AS_THEY_COME: dict[type, str] = {
    DaemonStatus: "/daemon_status",
    ActionEvent: "/action",
    ControllerEvent: "/controller",
    PlanProgress: "/plan_progress",
    RunState: "/run_state",
    InstanceState: "/instance",
    PlanPreview: "/plan",
    Prompt: "/prompt",
    PromptClosed: "/prompt_closed",
    CodeChanged: "/code_changed",
    EngineInfo: "/engine",
    PortValue: "/port",
    Reach: "/reach",
    Mark: "/mark",
}
_BACKWARDS_NS = 1_000_000_000


class FileClock:
    """The robot's clock, set off so that the recording begins at `start_ns` (ns since 1970)."""

    def __init__(self, start_ns: int):
        self._now = self._start = start_ns
        self._offset: int | None = None

    def stamp(self, time_ns: int) -> int:
        """Time in the file of something at `time_ns` of the robot's clock; 0 or less: now."""
        if time_ns <= 0:
            return self._now
        if self._offset is None or time_ns + self._offset < self._now - _BACKWARDS_NS:
            self._offset = self._now - time_ns  # the first time, or the robot's clock began anew
        stamp = time_ns + self._offset
        self._now = max(self._now, stamp)
        return stamp

    def stamp_late(self, time_ns: int) -> int:
        """The same for what comes a while after its time: never taken for a clock that began anew."""
        if self._offset is None:
            return self._now
        return min(time_ns + self._offset, self._now)

    def stamp_apart(self, time_ns: int) -> int:
        """The same for what comes by a way of its own, before or after what was said at that time."""
        return self.stamp(time_ns) if self._offset is None else max(time_ns + self._offset, self._start)


class Recording:
    """An MCAP file being written. `finish` it, or the file has no index."""

    def __init__(self, stream: IO[bytes], start_ns: int):
        self._writer = Writer(stream, compression=CompressionType.ZSTD)
        self._writer.start(profile="", library="handrail")
        self._encoder = msgspec.json.Encoder()
        self._schemas: dict[type, int] = {}
        self._channels: dict[str, int] = {}
        self._clock = FileClock(start_ns)
        self._robot: RobotInfo | None = None
        self._links: Links | None = None
        self._instances: dict[str, InstanceState] = {}
        self._next_transforms = 0
        self._world = BASE
        self.counts: dict[str, int] = {}
        """messages written, by topic"""

    def describe(self, robot: RobotInfo, links: Links | None) -> None:
        """What states mean from here on: joint names, and (with `links`) where the links are."""
        if self._robot is None:
            facts = {"name": robot.name, "joints": " ".join(robot.joints), "period_ns": str(robot.period_ns)}
            self._writer.add_metadata("robot", facts)
        self._robot, self._links = robot, links

    def take(self, message: Any) -> None:
        """Write a message in all the forms that the table above says."""
        match message:
            case RobotState():
                self._state(message)
            case LogLine():
                stamp = self._clock.stamp(message.time_ns)
                level = foxglove.LOG_LEVEL[message.level]
                self._write("/log", foxglove.Log(foxglove.time(stamp), level, message.text, message.source), stamp)
            case PointCloud():
                self._cloud(message)
            case DeviceStates():
                stamp = self._clock.stamp(message.time_ns)
                devices: list[Any] = [
                    *message.imus,
                    *message.force_torques,
                    *message.grippers,
                    *message.powers,
                    *message.others,
                ]
                for device in devices:
                    self._write(f"/device/{device.name}", device, stamp)
            case _:
                stamp = self._clock.stamp(getattr(message, "time_ns", 0))
                self._write(_AS_THEY_COME[type(message)], message, stamp, leave_out_none=True)
                if isinstance(message, DaemonStatus):
                    for bus in message.buses:
                        self._write(f"/can/{bus.channel}", bus, stamp)
                elif isinstance(message, InstanceState):
                    self._instances[message.name] = message
                    if message.removed:
                        del self._instances[message.name]

    def write_packed(self, topic: str, kind: str, definition: str, data: bytes, time_ns: int) -> None:
        """Write a ROS 1 message (handrail.ros1_schema) of the schema `kind`, which is always `definition`, as it is in memory."""
        channel = self._channels.get(topic)
        if channel is None:
            schema = self._writer.register_schema(kind, "ros1msg", definition.encode())
            channel = self._channels[topic] = self._writer.register_channel(topic, "ros1", schema)
        self._add(topic, channel, data, self._clock.stamp_apart(time_ns))

    def write_plain(self, topic: str, message: Any, time_ns: int) -> None:
        """Write a struct that is none of our messages."""
        self._write(topic, message, self._clock.stamp_apart(time_ns))

    def finish(self) -> None:
        """Write what is buffered and the index."""
        self._writer.finish()

    def _state(self, state: RobotState) -> None:
        stamp = self._clock.stamp(state.time_ns)
        if self._robot is None:
            return  # whose joints these are is not known yet
        names = self._robot.joints
        self._write(
            "/joint_states", foxglove.joint_states(stamp, names, state.position, state.velocity, state.torque), stamp
        )
        self._write("/joint_commands", foxglove.joint_states(stamp, names, state.command), stamp)
        if state.base is not None:
            self._world = WORLD
            self._write("/base", state.base, stamp)
        if not 0 < self._next_transforms - stamp <= TRANSFORM_PERIOD_NS:
            self._next_transforms = stamp + TRANSFORM_PERIOD_NS
            self._transforms(state, stamp)

    def _cloud(self, message: PointCloud) -> None:
        try:
            points = cloud.unpack(message)
        except ValueError as problem:
            typer.echo(f"recorder: a cloud of {message.camera} is left out: {problem}", err=True)
            return
        stamp = self._clock.stamp_late(message.time_ns)  # a picture takes its time, many times as long in lock-step
        self._write(f"/camera/{message.camera}", foxglove.point_cloud(stamp, self._world, points), stamp)

    def _transforms(self, state: RobotState, stamp: int) -> None:
        transforms = [
            foxglove.transform(stamp, self._world, instance.name, instance.pose_in_world)
            for instance in self._instances.values()
        ]
        if state.base is not None:
            transforms.append(foxglove.transform(stamp, WORLD, BASE, state.base_in_world))
        if self._links is not None:
            poses, tips = self._links.poses(state.position, state.base_in_world)
            transforms += [foxglove.transform(stamp, self._world, name, pose) for name, pose in poses.items()]
            for arm, pose in tips.items():
                tip = foxglove.PoseInFrame(foxglove.time(stamp), self._world, foxglove.pose_value(pose))
                self._write(f"/tool/{arm}", tip, stamp)
        if transforms:
            self._write("/tf", foxglove.FrameTransforms(transforms), stamp)

    def _write(self, topic: str, message: Any, stamp: int, *, leave_out_none: bool = False) -> None:
        channel = self._channels.get(topic)
        if channel is None:
            channel = self._writer.register_channel(topic, "json", self._schema(type(message)))
            self._channels[topic] = channel
        plain = message
        if leave_out_none and None in msgspec.structs.astuple(message):
            # Where a schema says object, number or text, viewers take nothing for one that is missing, and null for an error.
            plain = {name: value for name, value in msgspec.to_builtins(message).items() if value is not None}
        self._add(topic, channel, self._encoder.encode(plain), stamp)

    def _add(self, topic: str, channel: int, data: bytes, stamp: int) -> None:
        self.counts[topic] = self.counts.get(topic, 0) + 1
        self._writer.add_message(channel, stamp, data, stamp, self.counts[topic])

    def _schema(self, kind: type) -> int:
        if kind not in self._schemas:
            text = msgspec.json.encode(foxglove.schema(kind))
            self._schemas[kind] = self._writer.register_schema(foxglove.schema_name(kind), "jsonschema", text)
        return self._schemas[kind]


class Links:
    """Where the robot's moving links, its tools and their contact points are. Needs pinocchio. Raises ConfigError."""

    def __init__(self, robot: str):
        from handrail.robot import library as robots
        from handrail.robot.kinematics import Kinematics

        loaded = robots.load(robot)
        self._kinematics = Kinematics(loaded)
        self._tips = {name: arm.tip for name, arm in loaded.arms.items()}
        # One frame a joint is enough to see the robot move: its child link's, of the same name as in the URDF.
        model = self._kinematics.model
        moved = {model.getJointId(joint) for joint in loaded.joints}
        self._frames: dict[str, int] = {}
        for index, frame in enumerate(model.frames):
            if str(frame.type) == "BODY" and frame.parentJoint in moved and frame.placement.isIdentity(1e-9):
                self._frames[frame.name] = index
        for arm in loaded.arms.values():
            self._frames[arm.tool] = self._kinematics.frame_id(arm.tool)

    def poses(self, position: list[float], base_in_world: Pose) -> tuple[dict[str, Pose], dict[str, Pose]]:
        """(link → pose, arm → tip's pose), in the world; position (n,) rad in the description's order."""
        import pinocchio as pin

        kinematics = self._kinematics
        pin.framesForwardKinematics(kinematics.model, kinematics.data, kinematics.configuration(np.array(position)))

        base = pin.XYZQUATToSE3(np.array([*base_in_world.position, *base_in_world.orientation]))

        def pose(index: int) -> Pose:
            values = pin.SE3ToXYZQUAT(base * kinematics.data.oMf[index]).tolist()
            return Pose(position=tuple(values[:3]), orientation=tuple(values[3:]))

        tips = {arm: pose(kinematics.frame_id(tip)) for arm, tip in self._tips.items()}
        return {name: pose(index) for name, index in self._frames.items()}, tips


def _meet(runtime: Runtime) -> RobotInfo | None:
    """Which robot speaks; None when its daemon does not answer."""
    caller = Caller(runtime.endpoint("daemon.call"), timeout_s=2.0)
    try:
        return caller.call(GetRobot())
    except (Unreachable, RefusedError):
        return None
    finally:
        caller.close()


def _links(robot: RobotInfo) -> Links | None:
    try:
        return Links(robot.name)
    except (ConfigError, ImportError) as problem:
        typer.echo(f"recorder: without transforms: {problem}", err=True)
        return None


def record(
    out: Annotated[Path, typer.Option(help="The MCAP file to write.")],
    runtime: Annotated[Path | None, typer.Option(help="Folder where the robot's processes meet.")] = None,
) -> None:
    """Record everything that the robot says, until SIGTERM or Ctrl-C."""
    listen(Runtime.at(runtime), out)


def listen(place: Runtime, out: Path, more: Callable[[Recording], None] | None = None) -> None:
    """Record until SIGTERM or SIGINT. `more`: called now and then, and at the end, to write what comes by other ways."""
    # A signal wakes the poll below through this pair; nothing else happens inside a signal's handler.
    ended, wake = socket.socketpair()
    wake.setblocking(False)
    signal.set_wakeup_fd(wake.fileno())
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: None)

    endpoints = [place.endpoint(f"{who}.events") for who in ("daemon", "engine", "sensors", "link")]
    subscriber = Subscriber(endpoints, DaemonEvent | EngineEvent | SensorEvent | LinkEvent, queue=100_000)
    poller = zmq.Poller()
    poller.register(subscriber.socket, zmq.POLLIN)
    poller.register(ended, zmq.POLLIN)
    out.parent.mkdir(parents=True, exist_ok=True)
    with out.open("wb") as stream:
        recording = Recording(stream, time.time_ns())
        try:
            print("recorder ready", flush=True)
            known = False
            while True:
                ready = dict(poller.poll(None if more is None else _LOOK_MS))
                for message in subscriber.drain():
                    if not known and isinstance(message, RobotState) and (robot := _meet(place)):
                        recording.describe(robot, _links(robot))
                        known = True
                    recording.take(message)
                if more is not None:
                    more(recording)
                if ended.fileno() in ready:
                    break
                select.select([ended], [], [], BATCH_S)
        finally:
            recording.finish()
    total = sum(recording.counts.values())
    typer.echo(f"recorder: {total} messages on {len(recording.counts)} topics in {out}", err=True)


def main() -> None:
    """Entry point of ``python -m handrail.recorder``."""
    typer.run(record)


if __name__ == "__main__":
    main()
