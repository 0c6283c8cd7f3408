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
