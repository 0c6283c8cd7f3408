"""What is told of a whole-body motion that can't be run, and how one that can gets to the loop."""

from __future__ import annotations

import math
from pathlib import Path

import msgspec
import numpy as np
import pytest

from daemon import exchange
from daemon.controllers import whole_body
from daemon.exchange import Answer, Kind, PreparedMotion
from daemon.replay.player import Replay
from daemon.replay.recorded_loop import cycles
from daemon.replay.tape import TapeReader
from daemon.serving.whole_body_door import WholeBodyDoor
from daemon.wbc.composition import CompoundTask
from daemon.wbc.tasks import SE3
from handrail import compound_tasks
from handrail.messages import (
    DivergenceEnd,
    EndCondition,
    FixedPose,
    FrameKnots,
    FrameLine,
    Pose,
    PoseErrorEnd,
    PoseStream,
    PostureKnots,
    StartAction,
    StreamPose,
    WholeBody,
)
from handrail.topics import RefusedError

GOOD = """
constraints: [{constraint: JointLimits}]
levels:
  - - {task: SE3, name: hand, frame: tool_right_tip}
  - - {task: JPos, name: posture}
"""
STAY = {"positions": [[0.0], [0.0]], "velocities": [[0.0], [0.0]]}
WAY = {"times": [0.0, 1.0], "positions": [(0.0, 0.0, 0.0)] * 2, "velocities": [(0.0, 0.0, 0.0)] * 2}
KNOTS = {"task": "posture", "joints": ["torso_1_joint"], "times": [0.0, 1.0]}


def call(compound: str = GOOD, references: tuple = (), ends: tuple = (), **fields: object) -> StartAction:
    motion = WholeBody(compound=compound, references=list(references), **fields)
    return StartAction(id="a", owner="o", motion=motion, ends=list(ends))


def parts(asked: StartAction) -> tuple[WholeBody, list[EndCondition]]:
    assert isinstance(asked.motion, WholeBody)
    return asked.motion, asked.ends


def refused(door: WholeBodyDoor, talos, asked: StartAction) -> RefusedError:
    with pytest.raises(RefusedError) as caught:
        door.checked(*parts(asked), talos.home_position(), 1 << 18)
    return caught.value


@pytest.mark.parametrize(
    ("asked", "field", "words"),
    [
        (call("levels: ["), "motion.compound", "not YAML"),
        (call("no_such_thing"), "motion.compound", "no such compound task; expected one of"),
        (call(GOOD.replace("tool_right_tip", "tool_rigt_tip")), "motion.compound", "compound:4: "),
        (call("constraints: []"), "motion.compound", "a compound task has tasks"),
        (call(references=(FixedPose(task="hnd", pose=Pose()),)), "motion.references[0].task", "no such task"),
        (call(references=(PoseStream(task="posture"),)), "motion.references[0].task", "a JPos takes no such reference"),
        (
            call(references=(FrameLine(task="hand", goal=Pose(orientation=(0, 0, 0, 2.0)), duration=1.0),)),
            "motion.references[0].goal.orientation",
            "no unit quaternion",
        ),
        (
            call(references=(FrameLine(task="hand", goal=Pose(), duration=math.inf),)),
            "motion.references[0].duration",
            "not a finite number",
        ),
        (
            call(references=(FrameKnots(task="posture", **WAY),)),
            "motion.references[0].task",
            "a JPos takes no such reference",
        ),
        (
            call(references=(FrameKnots(task="hand", **(WAY | {"velocities": [(0.0, 0.0, 0.0)]})),)),
            "motion.references[0].velocities",
            "a row a knot",
        ),
        (
            call(
                references=(FrameKnots(task="hand", **(WAY | {"positions": [(0.0, 0.0, 0.0), (0.0, math.nan, 0.0)]})),)
            ),
            "motion.references[0].positions[1][1]",
            "not a finite number",
        ),
        (
            call(references=(FrameKnots(task="hand", **(WAY | {"times": [0.0, 0.0]})),)),
            "motion.references[0].times[1]",
            "times don't increase",
        ),
        (
            call(references=(PostureKnots(**KNOTS, positions=[[0.0], [9.0]], velocities=[[0.0], [0.0]]),)),
            "motion.references[0].positions[1][0]",
            "beyond the limits of torso_1_joint",
        ),
        (
            call(references=(PoseStream(task="hand"), PoseStream(task="hand"))),
            "motion.references[1].task",
            "one reference",
        ),
        (call(GOOD.replace("right_tip", "left_tip"), joints=["arm_right_1_joint"]), "motion.compound", "moves it"),
        (
            call(joints=["arm_right_1_joint"], references=(PostureKnots(**KNOTS, **STAY),)),
            "motion.references[0].joints",
            "does not move it",
        ),
        (call(ends=(DivergenceEnd(error=0.2),)), "ends[0]", "guard a frame"),
        (call(ends=(PoseErrorEnd(frame="tool_left_tip", position=0.1),)), "ends[0].frame", "no task of the compound"),
    ],
)
def test_what_is_wrong_is_told_with_field_and_expectation(door, talos, asked, field, words) -> None:
    error = refused(door, talos, asked)
    assert error.refusal.field == field
    assert words in error.refusal.message
    assert error.refusal.expected


def test_compound_tasks_have_names_and_a_text_may_extend_one(door, talos, monkeypatch, tmp_path: Path) -> None:
    (tmp_path / "compound_tasks").mkdir()
    (tmp_path / "compound_tasks" / "mine.yaml").write_text(GOOD)
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    motion = door.checked(*parts(call("mine")), talos.home_position(), 1 << 18)
    text = "extends: mine\nlevels: [[{task: COM, axes: [x]}]]"
    longer = door.checked(*parts(call(text)), talos.home_position(), 1 << 18)
    first = msgspec.json.decode(motion.compound, type=CompoundTask).levels
    assert isinstance(first[0][0], SE3)
    assert msgspec.json.decode(longer.compound, type=CompoundTask).levels[1:] == first, "its own levels first"


def test_every_compound_task_that_comes_with_handrail_fits_its_robot(door, talos) -> None:
    names = [file.stem for folder in compound_tasks.folders(talos.folder) for file in folder.glob("*.yaml")]
    assert names
    for name in names:
        door.checked(*parts(call(name, frame="tool_right_tip")), talos.home_position(), 1 << 18)


def test_what_is_prepared_started_and_streamed_comes_through_the_mailbox_as_it_was_sent() -> None:
    motion = WholeBody(compound="{}", references=[PoseStream(task="hand", stale=0.2)], duration=2.0)
    command = exchange.decode(*exchange.encode_prepare(motion, 7), ())
    assert (command.serial, command.kind) == (7, Kind.PREPARE)
    assert msgspec.msgpack.decode(command.text, type=WholeBody) == motion
    start = StartAction(id="x", owner="y", motion=motion)
    command = exchange.decode(*exchange.encode_start(start, 8, 1, {"a": 0, "b": 1}, {}, prepared=7), ())
    assert isinstance(command.motion, PreparedMotion)
    assert (command.motion.joints.tolist(), command.motion.prepared) == ([0, 1], 7)
    pose = StreamPose(id="x", task="händ", position=(1.0, 2.0, 3.0), velocity=(0.1, 0.2, 0.3, 0.4, 0.5, 0.6))
    reference = exchange.decode(*exchange.encode_stream(pose, 9, 8), ()).reference
    assert reference is not None
    assert (reference.task, reference.orientation) == ("händ", None)
    assert reference.position is not None
    assert reference.position.tolist() == [1.0, 2.0, 3.0]
    assert reference.velocity.tolist() == list(pose.velocity)


@pytest.mark.parametrize("payload", [[1e9, 0.0], [math.nan, 0.0], [-1.0]])
def test_a_payload_that_is_shorter_than_it_says_is_no_command(payload: list[float]) -> None:
    header, _ = exchange.encode_prepare(WholeBody(compound="{}"), 7)
    with pytest.raises(ValueError, match="shorter"):
        exchange.decode(header, np.array(payload), ())


def test_nothing_starts_that_was_not_prepared_and_nothing_is_streamed_to_what_takes_no_stream(in_plant) -> None:
    bench = in_plant()
    prepared = bench.ask(Kind.PREPARE, action=4711)
    assert prepared is Answer.MALFORMED
    header, payload = exchange.encode_start(call(), bench._count(), 1, bench._joints, bench._frames, 4711)
    bench._mailbox.post(header, payload)
    assert Answer(int(bench.run()["answer"])) is Answer.NOT_READY
    assert bench.begin(WholeBody(compound=GOOD)) is Answer.ACCEPTED
    bench.stream("hand", position=(0.3, -0.3, 0.1))
    assert Answer(int(bench.run()["answer"])) is Answer.NO_SUCH_REFERENCE
    assert bench.ask(Kind.PREPARE, action=bench.started - 1) is Answer.MALFORMED, "it is used once"
    bench.cancel()
    bench.run_to_end()
    bench.stream("hand", position=(0.3, -0.3, 0.1))
    assert Answer(int(bench.run()["answer"])) is Answer.NO_SUCH_ACTION


def test_controllers_that_are_asked_for_at_once_are_made_one_after_the_other(
    in_plant, door, talos, monkeypatch
) -> None:
    bench = in_plant()
    motion = door.checked(*parts(call()), talos.home_position(), 1 << 18)
    made_from, inside, most = whole_body.made_from, [0], [0]

    def watched(*arguments) -> whole_body.WholeBodyControl:
        inside[0] += 1
        most[0] = max(most[0], inside[0])
        try:
            return made_from(*arguments)
        finally:
            inside[0] -= 1

    monkeypatch.setattr(whole_body, "made_from", watched)
    serials = [bench._count() for _ in range(4)]
    for serial in serials:
        bench._mailbox.post(*exchange.encode_prepare(motion, serial))
        bench.run()
    header, payload = exchange.encode_start(call(), bench._count(), 1, bench._joints, bench._frames, serials[-1])
    bench._mailbox.post(header, payload)
    assert Answer(int(bench.run()["answer"])) is Answer.ACCEPTED
    assert most == [1]


def test_what_can_not_be_made_is_refused_and_the_loop_goes_on(in_plant) -> None:
    bench = in_plant()
    serial = bench._count()
    bench._mailbox.post(*exchange.encode_prepare(WholeBody(compound="{broken"), serial))
    bench.run()
    header, payload = exchange.encode_start(call(), bench._count(), 1, bench._joints, bench._frames, serial)
    bench._mailbox.post(header, payload)
    assert Answer(int(bench.run()["answer"])) is Answer.NOT_READY
    assert bench.run(3)["flags"] & exchange.Flag.ENABLED


def test_a_whole_body_motion_is_made_anew_in_a_replay_and_commands_the_same(in_plant, tmp_path) -> None:
    bench = in_plant(tape=True)
    assert bench.begin(WholeBody(compound=GOOD)) is Answer.ACCEPTED
    bench.run(60)
    bench.cancel()
    bench.run_to_end()
    tape = TapeReader(bench.runtime.folder / "loop.tape")
    assert tape.attach()
    _, *taped = tape.read()
    recorded = list(cycles(taped))
    assert [found for cycle in recorded for found in cycle.motions] == [True]
    replayed = Replay(bench.kinematics, True, tmp_path)
    try:
        found = replayed.run(recorded)
    finally:
        replayed.close()
    assert found is None, found
    assert replayed.compared == bench.loop.cycles
