"""Recordings: complete, readable with the stock reader, and in the part of JSON Schema that Foxglove understands."""

from __future__ import annotations

import io
import json
import signal
import subprocess
import sys
import threading
from collections import Counter
from typing import get_args

import msgspec
import numpy as np
import pytest
from mcap.reader import make_reader

from handrail import cloud, foxglove
from handrail.messages import (
    ActionEvent,
    Base,
    BusStatistics,
    ControllerEvent,
    DaemonEvent,
    DaemonStatus,
    DeviceStates,
    EngineEvent,
    Foot,
    ImuState,
    InstanceState,
    LogLine,
    LoopStatistics,
    Pose,
    PowerState,
    RobotInfo,
    RobotState,
    RunState,
)
from handrail.recorder import _AS_THEY_COME, TRANSFORM_PERIOD_NS, FileClock, Links, Recording

START_NS = 1_700_000_000_000_000_000
STEP_NS = 10_000_000
ROBOT = RobotInfo(
    name="talos_upper",
    joints=["arm_right_1_joint"],
    lower=[-1.0],
    upper=[1.0],
    velocity_limit=[2.0],
    torque_limit=[40.0],
    groups={},
    tools={"right": "tool_right"},
    tips={},
    arms={},
    home={},
    period_ns=2_000_000,
)
STATUS = DaemonStatus(
    time_ns=STEP_NS,
    clock="lockstep",
    enabled=True,
    stopped=False,
    drives=[],
    controllers={"hold": ["arm_right_1_joint"]},
    loop=LoopStatistics(),
    buses=[],
)
DEVICES = DeviceStates(
    time_ns=STEP_NS,
    imus=[
        ImuState(
            name="torso_imu",
            age=0,
            orientation=(0.0, 0.0, 0.0, 1.0),
            angular_velocity=(0.0, 0.0, 0.1),
            linear_acceleration=(0.0, 0.0, 9.81),
        )
    ],
    powers=[PowerState(name="battery", age=3, voltage=54.0, current=2.0, charge=0.7, temperature=27.0, relay=True)],
)
INSTANCE = InstanceState(
    name="wheel_1",
    template="wheel",
    template_hash="0",
    version=1,
    pose_in_world=Pose(position=(0.55, -0.35, 0.3)),
    parameters={"radius": 0.15},
    joint_state={"hinge": 0.0},
)


def state(cycle: int) -> RobotState:
    return RobotState(
        time_ns=cycle * STEP_NS,
        cycle=cycle,
        position=[0.01 * cycle],
        velocity=[0.1],
        torque=[2.0],
        command=[0.02 * cycle],
    )


def _standing(pose: Pose) -> Base:
    return Base(
        time_ns=STEP_NS,
        pose_in_world=pose,
        linear_velocity=(0.0, 0.0, 0.0),
        angular_velocity=(0.0, 0.0, 0.0),
        position_deviation=0.001,
        orientation_deviation=0.01,
        source="feet",
        feet=[Foot(name="left", holds=True, force=(1.0, 0.0, 450.0))],
    )


def recorded(messages, links=None, robot=ROBOT):
    stream = io.BytesIO()
    recording = Recording(stream, START_NS)
    if robot:
        recording.describe(robot, links)
    for message in messages:
        recording.take(message)
    recording.finish()
    stream.seek(0)
    reader = make_reader(stream)
    return reader, [
        (schema, channel, message, json.loads(message.data)) for schema, channel, message in reader.iter_messages()
    ]


def foxglove_reads(schema: dict, where: str = "") -> None:
    """Fails on what Foxglove's reader of JSON schemas does not take."""
    assert "$ref" not in schema and "anyOf" not in schema and "prefixItems" not in schema, where
    assert schema["type"] in {"object", "array", "string", "number", "integer", "boolean"}, where
    if schema["type"] == "object":
        for name, inner in schema["properties"].items():
            foxglove_reads(inner, f"{where}.{name}")
    if schema["type"] == "array":
        foxglove_reads(schema["items"], f"{where}[]")


@pytest.mark.parametrize(
    "kind",
    [
        *foxglove.WELL_KNOWN,
        BusStatistics,
        *(k for k in get_args(DaemonEvent) + get_args(EngineEvent) if k is not LogLine),
    ],
    ids=lambda kind: kind.__name__,
)
def test_every_schema_is_one_that_foxglove_reads(kind):
    schema = foxglove.schema(kind)
    assert schema["title"].startswith(("foxglove.", "handrail."))
    foxglove_reads(schema, kind.__name__)


def test_a_field_without_a_form_for_foxglove_is_named():
    class Odd(msgspec.Struct):
        either: int | str

    with pytest.raises(TypeError, match=r"Odd\.either"):
        foxglove.schema(Odd)


class TestARecording:
    def test_has_every_message_on_its_topic(self):
        buses = [BusStatistics(channel="can0", load=0.4), BusStatistics(channel="can1", load=0.5)]
        run = RunState(
            run="r", deployment="d", program="turn_valve", hash="0", status="running", active=["turning", "stroking"]
        )
        messages = [
            *(state(cycle) for cycle in range(1, 101)),
            msgspec.structs.replace(STATUS, buses=buses),
            ActionEvent(id="a", state="ended", outcome="done", time_ns=STEP_NS, cycle=5),
            ControllerEvent(name="sway", state="inactive", time_ns=STEP_NS, cycle=6),
            run,
            INSTANCE,
            LogLine(source="engine", level="warning", text="retry"),
        ]
        reader, rows = recorded(messages)
        counts = Counter(channel.topic for _, channel, _, _ in rows)
        assert counts["/joint_states"] == counts["/joint_commands"] == 100
        for topic in (
            "/daemon_status",
            "/can/can0",
            "/can/can1",
            "/action",
            "/controller",
            "/run_state",
            "/instance",
            "/log",
        ):
            assert counts[topic] == 1, topic
        assert reader.get_summary().statistics.message_count == len(rows)

    def test_has_a_topic_for_whatever_is_said(self):
        said = {*get_args(DaemonEvent), *get_args(EngineEvent)}
        assert said - _AS_THEY_COME.keys() == {RobotState, DeviceStates, LogLine}, "which have forms of their own"

    def test_devices_have_a_topic_each_with_their_own_schema(self):
        _, rows = recorded([DEVICES])
        assert {(channel.topic, schema.name) for schema, channel, _, _ in rows} == {
            ("/device/torso_imu", "handrail.ImuState"),
            ("/device/battery", "handrail.PowerState"),
        }

    def test_messages_fit_their_schemas(self):
        _, rows = recorded([state(1), STATUS, DEVICES, INSTANCE, LogLine(source="engine", level="error", text="no")])
        assert rows
        for schema, channel, _, data in rows:
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            _fits(data, json.loads(schema.data), schema.name)

    def test_joints_have_names_and_measured_and_commanded_values(self):
        _, rows = recorded([state(3)])
        by_topic = {channel.topic: data for _, channel, _, data in rows}
        assert by_topic["/joint_states"]["joints"] == [
            {"name": "arm_right_1_joint", "position": 0.03, "velocity": 0.1, "effort": 2.0}
        ]
        assert by_topic["/joint_commands"]["joints"] == [{"name": "arm_right_1_joint", "position": 0.06}]

    def test_begins_at_the_hour_and_goes_on_with_the_robots_clock(self):
        _, rows = recorded([state(500), state(501)])
        stamps = [message.log_time for _, channel, message, _ in rows if channel.topic == "/joint_states"]
        assert stamps == [START_NS, START_NS + STEP_NS]
        timestamp = rows[0][3]["timestamp"]
        assert timestamp["sec"] * 1_000_000_000 + timestamp["nsec"] == START_NS

    def test_shows_where_instances_are_until_they_are_removed(self):
        later = TRANSFORM_PERIOD_NS // STEP_NS
        removed = msgspec.structs.replace(INSTANCE, removed=True)
        _, rows = recorded([INSTANCE, state(1), state(1 + later), removed, state(1 + 2 * later)])
        transforms = [data["transforms"] for _, channel, _, data in rows if channel.topic == "/tf"]
        assert len(transforms) == 2
        (wheel,) = transforms[0]
        assert (wheel["parent_frame_id"], wheel["child_frame_id"]) == ("base_link", "wheel_1")
        assert wheel["translation"] == {"x": 0.55, "y": -0.35, "z": 0.3}

    def test_has_a_free_base_and_what_its_feet_feel_and_puts_the_links_there(self):
        pose = Pose(position=(0.1, 0.0, -0.5), orientation=(0.0, 0.0, 1.0, 0.0))
        eighteen = dict.fromkeys(("position", "velocity", "torque", "command"), [0.0] * 18)
        robot = msgspec.structs.replace(ROBOT, joints=[f"j{number}" for number in range(18)])
        standing = msgspec.structs.replace(state(30), base=_standing(pose), **eighteen)
        _, rows = recorded([INSTANCE, standing], links=Links("talos_upper"), robot=robot)
        schema, data = next((schema, data) for schema, channel, _, data in rows if channel.topic == "/base")
        _fits(data, json.loads(schema.data), schema.name)
        assert data["source"] == "feet"
        assert data["feet"] == [{"name": "left", "holds": True, "force": [1.0, 0.0, 450.0]}]
        transforms = [data["transforms"] for _, channel, _, data in rows if channel.topic == "/tf"][-1]
        assert {transform["parent_frame_id"] for transform in transforms} == {"world"}
        base, tip = (next(t for t in transforms if t["child_frame_id"] == name) for name in ("base_link", "tool_right"))
        assert base["translation"] == {"x": 0.1, "y": 0.0, "z": -0.5}
        straight = Links("talos_upper").poses([0.0] * 18, Pose())[0]["tool_right"].position
        assert [tip["translation"][axis] for axis in "xyz"] == pytest.approx(
            [0.1 - straight[0], -straight[1], straight[2] - 0.5]
        )

    def test_has_what_a_camera_sees_at_the_time_it_was_seen_however_late_it_comes(self):
        seen = cloud.pack("head", 5 * STEP_NS, np.eye(3), np.full((3, 3), 200, np.uint8), (0.0, 0.0, 0.0))
        _, rows = recorded([state(5), state(500), seen, state(501)])
        stamps = {(channel.topic, message.log_time): data for _, channel, message, data in rows}
        written = stamps["/camera/head", START_NS]
        assert written["frame_id"] == "base_link" and written["point_stride"] == 16
        assert ("/joint_states", START_NS + 496 * STEP_NS) in stamps, "the robot's clock did not begin anew"

    def test_leaves_out_a_cloud_that_can_not_be_read_and_goes_on(self, capsys):
        broken = cloud.pack("head", STEP_NS, np.eye(3), None, (0.0, 0.0, 0.0))
        broken.points = b"?"
        _, rows = recorded([broken, STATUS])
        assert [channel.topic for _, channel, _, _ in rows] == ["/daemon_status"]
        assert "head" in capsys.readouterr().err

    def test_without_a_known_robot_keeps_what_needs_no_names(self):
        _, rows = recorded([state(1), INSTANCE], robot=None)
        assert [channel.topic for _, channel, _, _ in rows] == ["/instance"]

    def test_says_whose_it_is(self):
        reader, _ = recorded([state(1)])
        (robot,) = [metadata for metadata in reader.iter_metadata() if metadata.name == "robot"]
        assert robot.metadata["name"] == "talos_upper"


def test_links_are_where_the_kinematics_says():
    links = Links("talos_upper")
    poses, tips = links.poses([0.0] * 18, Pose())
    assert {"torso_2_link", "arm_right_7_link", "tool_right", "head_2_link"} <= poses.keys()
    assert set(tips) == {"right", "left"}
    right, left = tips["right"].position, tips["left"].position
    assert right == pytest.approx((left[0], -left[1], left[2]), abs=1e-6)
    bent = [0.0] * 18
    bent[3] = -1.0
    assert links.poses(bent, Pose())[1]["right"].position != pytest.approx(right, abs=1e-3)


class TestTheFilesClock:
    def test_keeps_the_robots_distances(self):
        clock = FileClock(START_NS)
        assert [clock.stamp(t) for t in (1_000, 3_000, 2_500)] == [START_NS, START_NS + 2_000, START_NS + 1_500]

    def test_takes_now_for_what_has_no_time(self):
        clock = FileClock(START_NS)
        assert clock.stamp(0) == START_NS
        clock.stamp(1_000)
        assert clock.stamp(5_000) == clock.stamp(0) == START_NS + 4_000

    def test_goes_on_when_the_robots_clock_begins_anew(self):
        clock = FileClock(START_NS)
        clock.stamp(1_000_000_000)
        last = clock.stamp(9_000_000_000)
        assert clock.stamp(1_000_000) == last


def test_the_recorders_process_finishes_its_file_on_sigterm(stand, tmp_path):
    daemon, engine = stand.daemon(), stand.engine()
    out = tmp_path / "recording.mcap"
    process = subprocess.Popen(
        [sys.executable, "-m", "handrail.recorder", "--runtime", str(stand.runtime.folder), "--out", str(out)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout.readline() == "recorder ready\n"
        _publish_until_heard(daemon, process)
        for cycle in range(100, 150):
            daemon.publish(state(cycle))
        engine.publish(LogLine(source="engine", level="info", text="the last word"))
        threading.Event().wait(0.3)  # on its way through the socket
        process.send_signal(signal.SIGTERM)
        assert process.wait(10) == 0
    finally:
        process.kill()
        process.communicate()
    with out.open("rb") as stream:
        reader = make_reader(stream)
        counts = Counter(channel.topic for _, channel, _ in reader.iter_messages())
        assert reader.get_summary() is not None
    assert counts["/joint_states"] >= 50
    assert counts["/log"] == 1


def _publish_until_heard(daemon, process):
    """A subscriber's connection takes a moment: the recorder asks which robot this is once it has heard a state."""
    for cycle in range(1, 1000):
        daemon.publish(state(cycle % 90 + 1))
        if daemon.asked:
            return
        assert process.poll() is None
        threading.Event().wait(0.02)
    pytest.fail("the recorder heard nothing")


def _fits(data, schema, where):
    kinds = {"object": dict, "array": list, "string": str, "number": (int, float), "integer": int, "boolean": bool}
    assert isinstance(data, kinds[schema["type"]]), where
    if schema["type"] == "object":
        if schema["properties"]:
            assert data.keys() <= schema["properties"].keys(), where
        for name, inner in schema["properties"].items():
            if name in data:
                _fits(data[name], inner, f"{where}.{name}")
    if schema["type"] == "array":
        for inner in data:
            _fits(inner, schema["items"], f"{where}[]")
