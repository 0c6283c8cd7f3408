"""Recordings are started, marked, ended, listed and looked into through the link, a few seconds at a time."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from daemon.service_desk import ServiceDesk
from daemon.supervisor import Supervisor
from handrail import recordings
from handrail.client import RefusedError, Unreachable
from handrail.messages import (
    GetRobot,
    GetSamples,
    InstanceState,
    ListRecordings,
    Mark,
    Pose,
    RobotState,
    StartRecording,
    StopRecording,
)
from handrail.recorder import Recording
from tests.link.conftest import ROBOT

START_S = 1_700_000_000


def state(seconds: float, angle: float) -> RobotState:
    return RobotState(
        time_ns=round(seconds * 1e9), cycle=0, position=[angle], velocity=[0.0], torque=[0.0], command=[angle]
    )


def wheel(version: int, x: float, **changes: object) -> InstanceState:
    made = InstanceState(
        name="wheel_1", template="wheel", template_hash="0", version=version, pose_in_world=Pose(position=(x, 0, 0)),
        parameters={}, joint_state={},
    )  # fmt: skip
    return msgspec.structs.replace(made, **changes)


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A folder with a recording of 20 s: the joint turns by 0.1 rad/s, a wheel is placed, moved at 8 s, removed at 15 s."""
    with (tmp_path / "valve.mcap").open("wb") as stream:
        made = Recording(stream, START_S * 10**9)
        made.describe(ROBOT, None)
        for step in range(2000):
            made.take(state(1.0 + step / 100, step / 1000))
            if step == 0:
                made.take(wheel(1, 0.1))
            elif step == 800:
                made.take(wheel(2, 0.2))
                made.take(Mark(text="now it turns", by="ada"))
            elif step == 1500:
                made.take(wheel(3, 0.2, removed=True))
        made.finish()
    (tmp_path / "torn.mcap").write_bytes((tmp_path / "valve.mcap").read_bytes()[:5000])
    (tmp_path / "empty.mcap").write_bytes(b"")
    return tmp_path


def test_the_list_has_each_with_its_marks_and_what_is_wrong_with_it(place):
    listed = {each.name: each for each in recordings.listing(place).recordings}
    valve = listed.pop("valve")
    assert (valve.robot, valve.began, valve.problem) == (ROBOT.name, START_S, "")
    assert valve.duration_s == pytest.approx(19.99)
    (mark,) = valve.marks
    assert (mark.text, mark.by) == ("now it turns", "ada") and mark.at_s == pytest.approx(8.0, abs=0.02)
    assert listed.keys() == {"torn", "empty"} and all(each.problem for each in listed.values())
    assert recordings.listing(place / "nowhere" / "at all").recordings == []


def test_samples_are_the_robot_and_what_stood_then_at_the_rate_that_was_asked(place):
    got = recordings.samples(place, GetSamples(recording="valve", begin_s=6.0, duration_s=4.0, rate_hz=5.0))
    assert got.joints == ROBOT.joints and len(got.times_s) == 20
    assert got.times_s == pytest.approx([6.0 + k / 5 for k in range(20)], abs=0.011)
    for at, (angle,) in zip(got.times_s, got.positions, strict=True):
        assert angle * 1e-4 == pytest.approx(at / 10, abs=1.1e-4)
    assert [(each.instance.version, round(each.at_s)) for each in got.instances] == [(1, 0), (2, 8)]
    later = recordings.samples(place, GetSamples(recording="valve", begin_s=16.0, duration_s=60.0))
    assert later.instances == [] and 38 <= len(later.times_s) <= 41, "what is past the end is not there"
    past = recordings.samples(place, GetSamples(recording="valve", begin_s=600.0))
    assert past.times_s == [] and past.positions == []


def test_what_can_not_be_read_and_what_is_too_much_is_refused_by_field(place):
    for call, field in (
        (GetSamples(recording="nobody"), "recording"),
        (GetSamples(recording="torn"), "recording"),
        (GetSamples(recording="valve", duration_s=60.0, rate_hz=30.0), "rate_hz"),
    ):
        with pytest.raises(RefusedError) as caught:
            recordings.samples(place, call)
        assert caught.value.refusal.field == field
    for name in ("../valve", "/etc/passwd", "a.b", "", "x" * 64):
        with pytest.raises(msgspec.ValidationError):
            msgspec.msgpack.decode(msgspec.msgpack.encode(GetSamples(recording=name)), type=GetSamples)


class Serving:
    """A supervisor of nothing, in a thread, that is asked for recordings."""

    def __init__(self, runtime):
        self._over = threading.Event()
        self._ready = threading.Event()
        self.said: list[str] = []
        self._runtime = runtime
        self._thread = threading.Thread(target=self._run)
        self._thread.start()
        assert self._ready.wait(30)

    def _run(self) -> None:
        supervisor = Supervisor([], report=lambda name, text: self.said.append(f"{name} {text}"))
        desk = ServiceDesk(self._runtime, supervisor)
        self._ready.set()
        while not self._over.is_set():
            supervisor.step(0.02)
        desk.close()
        supervisor.close()

    def close(self) -> None:
        self._over.set()
        self._thread.join()


@pytest.fixture
def serving(stand, tmp_path, monkeypatch) -> Iterator[Serving]:
    monkeypatch.setenv("HANDRAIL_RECORDINGS", str(tmp_path / "kept"))
    made = Serving(stand.runtime)
    yield made
    made.close()


def test_a_recording_is_started_marked_ended_and_looked_into_through_the_link(stand, serving, tmp_path):
    daemon, engine = stand.daemon(), stand.engine()
    daemon.answers[GetRobot] = lambda _: msgspec.structs.replace(ROBOT, name="none_such")  # without its links' places
    stand.gate()
    client = stand.client()
    with pytest.raises(RefusedError, match="nothing is being recorded"):
        client.call(Mark(text="too early"))
    client.call(StartRecording(name="test"))
    with pytest.raises(RefusedError, match="test is being made"):
        client.call(StartRecording(name="another"))
    assert client.call(ListRecordings()).running == "test"

    for _ in range(1200):
        if any("up after" in line for line in serving.said):
            break
        threading.Event().wait(0.05)
    # Again and again: a recorder that has just been started does not hear everybody at once.
    engine.publish(wheel(1, 0.1))
    for k in range(100):
        daemon.publish(state(1.0 + k / 100, k / 1000))
        if k % 5 == 0:
            client.call(Mark(text="here", by="somebody else"))
        threading.Event().wait(0.01)
    client.call(StopRecording())
    for _ in range(600):
        listed = client.call(ListRecordings())
        if not listed.running:
            break
        threading.Event().wait(0.05)
    (info,) = listed.recordings
    assert (info.name, info.problem, info.robot) == ("test", "", "none_such")
    assert {(mark.text, mark.by) for mark in info.marks} == {("here", "local")}
    got = client.call(GetSamples(recording="test", duration_s=10.0, rate_hz=30.0))
    assert got.joints == ROBOT.joints and len(got.times_s) > 5
    with pytest.raises(RefusedError, match="one of that name"):
        client.call(StartRecording(name="test"))
    with pytest.raises(RefusedError, match="not a call"):
        client.call(StartRecording(name="../up"))


def test_without_a_supervisor_what_is_there_can_still_be_looked_into(stand, place, monkeypatch):
    monkeypatch.setenv("HANDRAIL_RECORDINGS", str(place))
    stand.gate()
    client = stand.client()
    assert {each.name for each in client.call(ListRecordings()).recordings} == {"valve", "torn", "empty"}
    assert client.call(GetSamples(recording="valve", begin_s=2.0, duration_s=1.0)).times_s[0] == pytest.approx(2.0)
    with pytest.raises(Unreachable, match="not started by handrail up"):
        client.call(StartRecording(name="x"))
