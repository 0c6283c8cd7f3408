"""Whole-body steps of behaviours, in TALOS' upper body in the plant: beside compliant ones, guarded, repeated, replayed."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.exchange import ActionState, Answer, Kind, Outcome
from daemon.replay.player import Replay
from daemon.replay.recorded_loop import cycles
from daemon.replay.tape import TapeReader
from handrail.messages import CompliantMotion, ContactEnd, FrameLine, PoseErrorEnd, PoseStream, Step, WholeBody
from tests.daemon.compliant.conftest import TIP, wall_before

COMPOUND = """
constraints: [{constraint: JointLimits}]
levels:
  - - {task: SE3, name: hand, frame: tool_right_tip, stiffness: 200}
  - - {task: JPos, name: posture, stiffness: 50}
"""


def line(*shift: float, duration: float = 0.3) -> WholeBody:
    way = FrameLine(task="hand", shift=(shift[0], shift[1], shift[2]), duration=duration)
    return WholeBody(compound=COMPOUND, references=[way])


def compliant(bench, *shift: float, duration: float = 0.3) -> CompliantMotion:
    joints = list(bench.description.joints)
    return CompliantMotion(frame=TIP, joints=joints, duration=duration, shift=(shift[0], shift[1], shift[2]))


def row(bench) -> np.ndarray:
    return bench.snapshot()["actions"][0]


def steps_of(bench, most: int = 2000) -> list[int]:
    """The steps that it goes through until it ends; the robot goes with its command, and no torque jumps."""
    told, torque, at = [int(row(bench)["step"])], bench.torque(), int(row(bench)["steps_taken"])
    for _ in range(most):
        if row(bench)["state"] == ActionState.ENDED:
            return told
        bench.run()
        jump = float((np.abs(bench.torque() - torque) / bench.description.torque_limit).max())
        if (taken := int(row(bench)["steps_taken"])) != at:
            assert jump < 0.02, "of the rated torque, where a step takes over"
            told, at = [*told, int(row(bench)["step"])], taken
        torque = bench.torque()
    raise AssertionError("the behaviour did not end")


def test_a_guarded_whole_body_step_ends_in_the_cycle_that_trips_it_and_the_next_one_takes_over_in_it(in_plant) -> None:
    bench = in_plant(wall_before(in_plant().tip(), gap=0.02))
    start = bench.tip()
    out = tuple((start.rotation @ np.array([0.0, 0.0, -0.06])).tolist())
    touch = Step(name="touch", motion=line(*out, duration=1.0), ends=[ContactEnd(frame=TIP, threshold=6.0)],
                 then={"contact": "back", "done": "end"})  # fmt: skip
    back = Step(name="back", motion=compliant(bench, *(-np.array(out) / 3)))
    assert bench.begin_behaviour(touch, back) is Answer.ACCEPTED
    forces = []
    while row(bench)["step"] == 0:
        assert row(bench)["state"] == ActionState.RUNNING
        bench.run()
        if row(bench)["step"] == 0:
            forces.append(float(np.linalg.norm(bench.loop.robot.wrenches[TIP][:3])))
    assert max(forces) <= 6.0, "no cycle of it ran with more"
    assert np.linalg.norm(bench.loop.robot.wrenches[TIP][:3]) > 6.0, "the one in which it ended measured more"
    assert row(bench)["cycle"] == bench.snapshot()["cycle"]
    assert "compliant_motion" in {controller.name for controller in bench.loop.manager.active}
    assert bench.run_to_end() is Outcome.DONE
    assert bench.world.contact_force["wall"] < 1.0, "it let go"


def test_one_whole_body_step_follows_another_goes_over_to_compliance_and_is_returned_to(in_plant) -> None:
    bench = in_plant()
    start = bench.tip().translation
    there, across = line(0.0, 0.05, 0.0), line(0.0, 0.0, 0.04)
    guard = PoseErrorEnd(frame=TIP, position=0.1)
    steps = [
        Step(name="there", motion=there, ends=[guard]),
        Step(name="across", motion=across),
        Step(name="back", motion=compliant(bench, 0.0, -0.05, -0.04), then={"done": "there"}),
    ]
    assert bench.begin_behaviour(*steps, most_steps=5) is Answer.ACCEPTED
    assert steps_of(bench) == [0, 1, 2, 0, 1]
    assert bench.action()[1] is Outcome.TOO_MANY_STEPS
    assert bench.tip().translation == pytest.approx(start + np.array([0.0, 0.05, 0.04]), abs=3e-3)


def test_a_whole_body_step_that_leads_to_itself_begins_anew(in_plant) -> None:
    bench = in_plant()
    start = bench.tip().translation
    again = Step(name="inch", motion=line(0.0, 0.02, 0.0, duration=0.2), then={"done": "inch"})
    assert bench.begin_behaviour(again, most_steps=3) is Answer.ACCEPTED
    assert steps_of(bench) == [0, 0, 0]
    assert bench.tip().translation == pytest.approx(start + np.array([0.0, 0.06, 0.0]), abs=3e-3)


def test_a_pause_and_a_stream_reach_the_step_that_runs(in_plant) -> None:
    bench = in_plant()
    start = bench.tip().translation
    followed = WholeBody(compound=COMPOUND, references=[PoseStream(task="hand", speed=0.2)], duration=1.0)
    steps = [Step(name="wait", motion=compliant(bench, 0.0, 0.0, 0.0, duration=0.1)), Step(name="go", motion=followed)]
    assert bench.begin_behaviour(*steps) is Answer.ACCEPTED
    bench.stream("hand", position=tuple(start))
    assert Answer(int(bench.run()["answer"])) is Answer.NO_SUCH_REFERENCE, "the step that takes it does not run yet"
    bench.run(60)
    goal = start + np.array([0.0, 0.03, 0.0])
    bench.stream("hand", position=tuple(goal))
    assert Answer(int(bench.run()["answer"])) is Answer.ACCEPTED
    assert bench.ask(Kind.PAUSE, action=bench.started) is Answer.ACCEPTED
    bench.run(250)
    assert bench.action()[0] is ActionState.PAUSED
    assert bench.ask(Kind.RESUME, action=bench.started) is Answer.ACCEPTED
    assert bench.run_to_end() is Outcome.DONE
    assert bench.tip().translation == pytest.approx(goal, abs=4e-3)


def test_a_behaviour_with_whole_body_steps_is_replayed_bit_for_bit(in_plant, tmp_path) -> None:
    bench = in_plant(tape=True)
    steps = [
        Step(name="go", motion=line(0.0, 0.02, 0.0, duration=0.1)),
        Step(name="on", motion=line(0.0, 0.0, 0.02, duration=0.1)),
    ]
    assert bench.begin_behaviour(*steps) is Answer.ACCEPTED
    assert steps_of(bench) == [0, 1]
    tape = TapeReader(bench.runtime.folder / "loop.tape")
    assert tape.attach()
    _, *taped = tape.read()
    replayed = Replay(bench.kinematics, True, tmp_path)
    try:
        found = replayed.run(list(cycles(taped)))
    finally:
        replayed.close()
    assert found is None, found
    assert replayed.compared == bench.loop.cycles
