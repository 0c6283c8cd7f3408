"""Recordings are begun, marked and seen again in the same view, some seconds at a time; meanwhile nothing is commanded but STOP."""

from __future__ import annotations

import pytest

from handrail.messages import (
    Base,
    BaseAt,
    Disable,
    Enable,
    GetSamples,
    InstanceAt,
    ListRecordings,
    Mark,
    Pose,
    RecordingInfo,
    Recordings,
    Samples,
    StartRecording,
    StopRecording,
)
from tablet_client.models.recordings import RecordingList
from tablet_client.models.replay import WINDOW_S, Replay
from tests.tablet.shown import judge

INFO = RecordingInfo(name="valve", size=1000, duration_s=25.0, robot="talos_upper")


def samples(begin: float, **changes: object) -> Samples:
    """10 Hz; joint `b` stands at a tenth of the time, rad."""
    times = [begin + k / 10 for k in range(100)]
    fields = {
        "recording": "valve", "begin_s": begin, "joints": ["a", "b"], "times_s": times,
        "positions": [[0, round(1000 * at)] for at in times],
    }  # fmt: skip
    return Samples(**{**fields, **changes})


def answered(replay: Replay, now: float = 0.0, **changes: object) -> GetSamples:
    (call,) = replay.want(now)
    replay.take(call, samples(call.begin_s, **changes))
    return call


@pytest.fixture
def replay() -> Replay:
    made = Replay()
    made.begin(INFO)
    return made


def test_it_fetches_what_is_looked_at_then_what_comes_and_one_window_at_a_time(replay):
    assert replay.waiting and replay.state(["a", "b"]) is None
    replay.advance(5.0)
    assert replay.time_s == 0.0, "it waits for what is not here"
    first, second = answered(replay), answered(replay)
    assert [call.begin_s for call in (first, second)] == [0.0, WINDOW_S] and first.rate_hz == 10.0
    assert replay.want(0.0) == [], "a window ahead is enough"
    replay.scrub(21.0)
    assert replay.waiting
    (third,) = replay.want(0.0, slow=True)
    assert (third.begin_s, third.rate_hz) == (20.0, 3.0) and replay.want(0.5, slow=True) == []
    replay.take(third, samples(20.0))
    assert replay.want(1.0) == [], "the end"


def test_the_robot_stands_between_two_samples_and_in_the_order_that_is_asked(replay):
    answered(replay)
    replay.scrub(1.25)
    state = replay.state(["b", "unknown", "a"])
    assert state.position == pytest.approx([0.125, 0.0, 0.0]) and state.base is None
    base = Base(
        time_ns=0, pose_in_world=Pose(position=(1, 2, 3)), linear_velocity=(0, 0, 0), angular_velocity=(0, 0, 0),
        position_deviation=0.0, orientation_deviation=0.0, source="feet",
    )  # fmt: skip
    replay.scrub(12.0)
    answered(replay, bases=[BaseAt(10.0, base)])
    assert replay.state(["a"]).base == base


def test_what_was_placed_is_there_from_then_on_and_gone_when_it_was_removed(replay, robot):
    wheel, gone = robot.wheel(), robot.wheel(removed=True, version=2)
    answered(replay, instances=[InstanceAt(2.0, wheel), InstanceAt(4.0, gone)])
    for at, there in ((0.0, False), (2.0, True), (3.9, True), (4.1, False)):
        replay.scrub(at)
        assert ("wheel_1" in replay.instances()) is there, at
    replay.scrub(15.0)
    answered(replay, instances=[InstanceAt(2.0, wheel)])  # stood before the window begins
    assert replay.instances() == {"wheel_1": wheel}


def test_it_plays_to_the_end_and_from_the_beginning_again(replay):
    for _ in range(3):
        replay.scrub(replay.time_s + WINDOW_S)
        if replay.waiting:
            answered(replay)
    replay.scrub(24.5)
    replay.play(True)
    replay.advance(2.0)
    assert (replay.time_s, replay.playing) == (25.0, False)
    replay.scrub(-3.0)
    assert replay.time_s == 0.0


def test_a_lost_link_leaves_what_is_here_and_what_failed_is_asked_again_later(replay):
    answered(replay)
    (call,) = replay.want(0.0)
    replay.failed(call, "nobody is there", 10.0)
    assert replay.problem == "nobody is there" and replay.want(11.0) == []
    assert replay.want(12.5) == [call] and not replay.waiting
    replay.anew()
    assert replay.want(12.6) == [call]
    replay.end()
    replay.take(call, samples(10.0))
    assert replay.want(13.0) == [] and not replay.active and replay.instances() == {}


def test_the_list_is_asked_for_while_somebody_looks_and_names_are_what_files_may_be_called():
    now = 100.0
    listed = RecordingList(lambda: now)
    assert listed.want(0.0) == []
    listed.look(True)
    assert listed.want(0.0) == [ListRecordings()] and listed.want(50.0) == []
    listed.take(ListRecordings(), Recordings(recordings=[INFO], running="x", running_s=7.0))
    assert (listed.found, listed.running, listed.running_s) == ([INFO], "x", 7.0)
    assert listed.start("../the valve, again!").name == "the-valve-again"
    assert listed.start("").name[:2] == "20" and listed.start("ä" * 300).name[:2] == "20"
    assert listed.mark("  ") is None and listed.mark(" it\n turns ") == Mark(text="it turns")
    listed.take(StopRecording(), None)
    assert listed.want(51.0) == [ListRecordings()]
    listed.failed(ListRecordings(), "no")
    assert listed.problem == "no" and listed.want(52.5) == [ListRecordings()]
    assert isinstance(listed.start("a"), StartRecording)


@pytest.mark.window
def test_a_recording_is_begun_marked_ended_and_seen_again_with_everything_but_stop_disabled(robot, show):
    robot.recordings = [robot.recorded()]
    shown = show().drawn()
    shown.press("tab_recordings")
    shown.press("startRecording")
    shown.until(lambda: shown.there("markText"))
    assert shown.words("Pages.marks.recordings") == shown.words("Theme.danger")
    shown.item("markText").forceActiveFocus()
    for key in "a b":
        shown.key(key)
    shown.press("mark")
    shown.until(lambda: robot.calls_of(Mark))
    assert robot.calls_of(Mark)[0].text == "a b", "a space is a space here, no STOP"
    shown.press("stopRecording")
    shown.until(lambda: not robot.recording and shown.there("replay_valve"))

    robot.publish(robot.state())
    shown.until(lambda: len(shown.opened.stage._drawn_position))
    live = shown.opened.stage._drawn_position.copy()
    shown.press("replay_valve")
    shown.until(lambda: shown.desk.recordings.time > 0.2)
    assert shown.there("replayTag") and shown.there("banner")
    assert shown.desk.header["enableWhy"] == "replaying" and not shown.there("ghostBar")
    shown.desk._send(Enable())
    shown.desk._send(Disable())
    judge(shown, (1024, 640))
    shown.press("goto_0")
    shown.until(lambda: shown.opened.stage._templates.names() == ["wheel_1"])
    joint = shown.opened.stage._robot.chain.joints.index(robot.description.arms["right"].joints[0])
    assert shown.opened.stage._drawn_position[joint] == pytest.approx(0.25, abs=2e-3)
    assert not robot.calls_of(Enable) and not robot.calls_of(Disable)
    shown.press("stop")
    shown.until(lambda: robot.stopped)
    shown.press("endReplay")
    shown.until(lambda: abs(shown.opened.stage._drawn_position - live).max() < 1e-6)
    assert shown.opened.stage._templates.names() == [] and not shown.there("replayBar")
    assert {call.rate_hz for call in robot.calls_of(GetSamples)} == {10.0}
