"""`do: control`: whole-body control in programs, with the arm that the deployment names."""

from __future__ import annotations

import pytest

from engines.programs import program
from handrail import messages as m
from handrail.config import ConfigError
from handrail.topics import refuse
from tests.engines.conftest import until


def follow(stack, **parameters: float) -> None:
    stack.place()
    deployed = stack.call(
        m.Deploy(program="follow", bindings={"arm": "right", "guide": "wheel_1"}, parameters=parameters)
    )
    stack.call(m.Run(deployment=deployed.id))


def streamed(daemon) -> list[tuple[float, ...]]:
    return [call.position for call in daemon.calls if isinstance(call, m.StreamPose)]


def enough(stack) -> None:
    stack.call(m.AnswerPrompt(id=stack.prompt().id, answer="enough", by="test"))


def test_a_compound_task_is_run_with_the_bound_arms_joints_and_frame_and_the_programs_numbers(stack, daemon):
    daemon.slow = True
    follow(stack, lift=0.07)
    until(daemon.started)
    (call,) = daemon.started()
    line = m.FrameLine(task="hand", shift=(0.0, 0.0, 0.07), duration=1.0)
    assert call.motion == m.WholeBody(compound="hand", joints=["angle", "depth"], frame="tip", references=[line])
    assert call.ends == [m.ContactEnd(frame="tip", threshold=15.0)]


def test_what_is_followed_is_streamed_when_it_moves_and_the_next_motion_waits_for_the_one_that_is_left(stack, daemon):
    daemon.trip = lambda action: "" if isinstance(action.motion.references[0], m.PoseStream) else "done"
    daemon.slow = True
    follow(stack, distance=0.2)
    until(lambda: streamed(daemon))
    assert streamed(daemon) == [pytest.approx((0.35, -0.35, 0.30))]
    half_turn = m.Pose(position=(0.6, 0.0, 0.3), orientation=(0.0, 0.0, 1.0, 0.0))
    stack.call(m.MoveInstance(name="wheel_1", pose_in_world=half_turn))
    until(lambda: len(streamed(daemon)) > 1)
    assert streamed(daemon)[1:] == [pytest.approx((0.8, 0.0, 0.3))], "a point of the template turns with it"
    enough(stack)
    assert stack.ended().status == "succeeded"
    shifts = [call.motion.references[0].shift[2] for call in daemon.started()[::2]]
    assert shifts == [0.03, -0.03]
    assert len(daemon.started()) == 3


def test_an_end_condition_is_a_result_that_the_program_reads(stack, daemon):
    daemon.trip = lambda action: "contact"
    follow(stack)
    assert stack.ended().status == "failed"
    assert stack.ended().detail == "something was touched"


def test_a_motion_whose_controller_is_still_being_made_is_asked_for_again(stack, daemon):
    begin, asked = daemon._start, []

    def making(action) -> None:
        asked.append(action)
        if len(asked) < 3:
            raise refuse("its controller is still being made", "motion", m.NOT_READY, "call again")
        begin(action)

    daemon._start, daemon.slow = making, True
    follow(stack)
    until(lambda: daemon.action is not None)
    assert len({action.id for action in asked}) == 1
    assert stack.call(m.GetEngine()).run.status == "running"


SIDE_BY_SIDE = """\
title: Two at once
resources: {arm: {kind: arm}}
states:
  both:
    parallel: true
    states:
      one:
        states:
          turning:
            do: control
            with: {compound: posture, joints: [angle], duration: 5}
            transitions: [{event: done.invoke.turning, target: turned}]
          turned: {final: true}
      other:
        states:
          pushing:
            do: control
            with: {compound: posture, joints: [SECOND], duration: 5}
            transitions: [{event: done.invoke.pushing, target: pushed}]
          pushed: {final: true}
    transitions: [{event: done.state.both, target: good}, {event: error.execution, target: bad}]
  good: {final: true, outcome: succeeded}
  bad: {final: true, outcome: failed, detail: "{failure}"}
"""


@pytest.fixture
def both(stack, daemon, tmp_path, monkeypatch):
    """Runs two states side by side, the second one with the joint that it is told."""

    def begin(second: str) -> None:
        monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
        (tmp_path / "rtc_programs").mkdir()
        (tmp_path / "rtc_programs" / "two_at_once.yaml").write_text(SIDE_BY_SIDE.replace("SECOND", second))
        daemon.slow = True
        deployed = stack.call(m.Deploy(program="two_at_once", bindings={"arm": "right"}))
        stack.call(m.Run(deployment=deployed.id))

    return begin


def test_states_side_by_side_that_move_different_joints_run_at_once_and_are_paused_and_go_on_together(
    stack, daemon, both
):
    both("depth")
    until(lambda: len(daemon.running) == 2)
    assert {call.motion.joints[0] for call in daemon.started()} == {"angle", "depth"}
    ids = {action.id for action in daemon.running}
    stack.call(m.PauseRun())
    until(lambda: {call.id for call in daemon.calls if isinstance(call, m.PauseAction)} == ids)
    stack.call(m.ResumeRun())
    until(lambda: {call.id for call in daemon.calls if isinstance(call, m.ResumeAction)} == ids)
    daemon.finish()
    until(lambda: len(daemon.running) == 1)
    daemon.finish()
    assert stack.ended().status == "succeeded"
    assert len(daemon.started()) == 2


def test_one_that_moves_a_joint_of_anothers_waits_for_it(stack, daemon, both):
    both("angle")
    until(lambda: daemon.running)
    first = daemon.action
    stack.call(m.PauseRun())
    stack.call(m.ResumeRun())
    assert daemon.running == [first]
    daemon.finish()
    until(lambda: daemon.running and daemon.action is not first)
    daemon.finish()
    assert stack.ended().status == "succeeded"


def test_stopping_the_run_cancels_all_that_runs_side_by_side(stack, daemon, both):
    both("depth")
    until(lambda: len(daemon.running) == 2)
    ids = {action.id for action in daemon.running}
    stack.call(m.StopRun())
    assert stack.ended().status == "stopped"
    assert {call.id for call in daemon.calls if isinstance(call, m.CancelAction)} == ids


def test_without_an_arm_it_moves_all_joints_and_a_foot_that_does_not_hold_is_a_failure_that_may_be_tried_again(
    stack, daemon, tmp_path, monkeypatch
):
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    (tmp_path / "rtc_programs").mkdir()
    (tmp_path / "rtc_programs" / "stands.yaml").write_text(
        "title: Stand\nresources: {}\nstates:\n  standing:\n    do: control\n    with: {compound: posture, duration: 1}\n"
        "    retry: 2\n    transitions: [{event: done.invoke.standing, target: good}, {event: error.execution, target: bad}]\n"
        "  good: {final: true, outcome: succeeded}\n  bad: {final: true, outcome: failed, detail: '{failure}'}\n"
    )
    begin, asked = daemon._start, []

    def hangs(action) -> None:
        asked.append(action)
        if len(asked) < 3:
            raise refuse("the left foot does not hold", "motion.compound", m.NOT_STANDING, "feet that all hold")
        begin(action)

    daemon._start = hangs
    deployed = stack.call(m.Deploy(program="stands", bindings={}))
    stack.call(m.Run(deployment=deployed.id))
    assert stack.ended().status == "succeeded"
    assert [call.motion.joints for call in asked] == [[]] * 3


WITH = "compound: hand, arm: arm"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ("compound: hnd, arm: arm", r"with.compound: got 'hnd'; expected a compound task's name, of .*hand, posture"),
        ("compound: {constraints: []}, arm: arm", r"with.compound.levels: missing"),
        (WITH + ", references: {}", r"with.references: got .*expected a list"),
        (WITH + ", references: [{type: lin, task: hand}]", r"with.references\[0\].type: Invalid value 'lin'"),
        (
            WITH + ", references: [{type: line, task: hand, shift: [0, 0, hgh], duration: 1}]",
            r"with.references\[0\].shift\[2\]: unknown name 'hgh'",
        ),
        (
            WITH + ", references: [{type: stream, task: hand, follow: arm}]",
            r"with.references\[0\].follow: got 'arm', no resource of kind instance",
        ),
        (WITH + ", ends: [{type: contact, threshold: -1}]", r"go.yaml:5: states.go.with.ends\[0\].threshold: .*got -1"),
        (
            "compound: hand, ends: [{type: contact, threshold: 5}]",
            r"with.ends: one names no frame; expected `frame`, or an",
        ),
        (WITH + ", references: [{type: fixed, task: 'hand {who}'}]", r"with.references\[0\].task: unknown name 'who'"),
    ],
)
def test_what_is_wrong_with_its_arguments_is_told_with_line_and_field(tmp_path, arguments, told):
    file = tmp_path / "go.yaml"
    file.write_text(
        "title: Go\nresources: {arm: {kind: arm}}\nstates:\n  go:\n    "
        f"with: {{{arguments}}}\n    do: control\n    transitions: [{{event: '*', target: end}}]\n"
        "  end: {final: true, outcome: failed}\n"
    )
    with pytest.raises(ConfigError, match=told):
        program.read(file)
