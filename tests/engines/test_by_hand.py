"""A pause in which the robot is moved by hand: what the states need so that they go on is checked, named, and can be mended."""

from __future__ import annotations

import numpy as np
import pytest

from engines.activities import ACTIVITIES
from engines.activities.base import Activity
from engines.runs import let_go
from handrail import messages as m
from handrail.topics import RefusedError


@pytest.fixture
def stroke(stack, daemon, stroking):
    """A run that is paused in the first segment of its first plan; returns that segment's action."""
    stack.call(m.PauseRun())
    return daemon.started()[0]


def by_hand(stack, daemon, wait_until, joint: str, by: float) -> None:
    """Jog to the end, as the engine hears it."""
    daemon.slow = False
    there = stack.call(m.Jog(joints={joint: by}, by=True)).joints[joint]
    row = ("angle", "depth", "other").index(joint)
    wait_until(lambda: abs(stack.engine._services.daemon.command()[row] - there) < 1e-9)
    daemon.slow = True


def refusal(stack, call: m.Message) -> str:
    return stack.refusal(call).message


def ids(daemon, kind: type) -> list[str]:
    return [call.id for call in daemon.calls if isinstance(call, kind)]


def test_what_the_plan_counts_on_to_stay_is_named_when_it_was_moved_and_moved_back_the_run_goes_on(
    stack, daemon, wait_until, stroke
):
    by_hand(stack, daemon, wait_until, "other", 0.31)
    why = refusal(stack, m.ResumeRun())
    assert "stroking: plan-1 (turn wheel_1) can be gone on with" in why
    assert "other is 0.31 rad off, at most 0.02 rad" in why
    assert "Move the robot back by hand; plan anew (run from planning_next); retry (run from stroking)" in why
    run = stack.call(m.GetEngine()).run
    assert (run.status, run.detail) == ("paused", why), "whoever comes late reads the same"
    by_hand(stack, daemon, wait_until, "other", -0.30)
    stack.call(m.ResumeRun())
    assert not ids(daemon, m.CancelAction), "its own joints were never let go"
    assert ids(daemon, m.ResumeAction) == [stroke.id]
    daemon.slow = False
    daemon.finish()
    assert stack.ended().status == "succeeded"


def test_its_own_joints_are_let_go_and_moved_back_the_rest_of_the_way_is_gone(stack, daemon, wait_until, stroke):
    before = stack.engine._services.daemon.command()
    by_hand(stack, daemon, wait_until, "depth", 0.2)
    assert ids(daemon, m.CancelAction) == [stroke.id]
    left = daemon.command.copy() - [0.0, 0.2, 0.0]
    assert abs(left[0] - before[0]) > 0.01, "it was let go in the midst of its way"
    why = refusal(stack, m.StepRun())
    assert "approach goes on from where it was let go: depth is 0.20 rad off, at most 0.02 rad" in why
    by_hand(stack, daemon, wait_until, "depth", -0.2)
    count = len(daemon.started())
    stack.call(m.ResumeRun())
    wait_until(lambda: len(daemon.started()) > count)
    rest = daemon.started()[-1].motion
    assert rest.positions[0] == pytest.approx(left[:2]) and rest.positions[-1] == pytest.approx(
        stroke.motion.positions[-1]
    )
    assert np.diff(np.array(rest.positions), axis=0).min(axis=0)[1] >= 0.0, "on along its path, not back over it"
    daemon.slow = False
    daemon.finish()
    assert stack.ended().status == "succeeded"
    wait_until(lambda: not daemon.leases.held())


def test_resumed_once_more_the_program_goes_its_own_way_and_where_more_has_changed_it_is_asked_anew(
    stack, daemon, wait_until, stroke
):
    by_hand(stack, daemon, wait_until, "depth", 0.2)
    assert "depth is 0.20" in refusal(stack, m.ResumeRun())
    by_hand(stack, daemon, wait_until, "depth", 0.2)
    assert "depth is 0.40" in refusal(stack, m.ResumeRun()), "that is not what was told"
    count = len(daemon.started())
    stack.call(m.ResumeRun())
    assert stack.prompt(2).plan == "plan-2", "stale: it plans anew from where the robot is, and asks again"
    assert len(daemon.started()) == count


def test_the_tool_is_not_drawn_out_from_where_it_was_never_led_in(stack, daemon, wait_until):
    daemon.slow = True
    stack.place()
    stack.run(goal_deg=10)
    stack.call(m.AnswerPrompt(id=stack.prompt().id, answer="approve"))
    for segment in ("approach", "standoff", "engage"):
        wait_until(lambda: daemon.action is not None and stack.engine._run._motion._running)
        if segment != "engage":
            before = daemon.action.id
            daemon.finish()
            wait_until(lambda before=before: daemon.action is not None and daemon.action.id != before)
    stack.call(m.PauseRun())
    by_hand(stack, daemon, wait_until, "angle", 0.4)
    refusal(stack, m.ResumeRun())
    count = len(daemon.started())
    stack.call(m.ResumeRun())
    ended = stack.ended()
    assert (
        ended.status == "failed"
        and "the tool is on the way that it came, engage of plan-1: angle is 0.40" in ended.detail
    )
    assert len(daemon.started()) == count


def test_while_the_robot_is_moved_by_hand_nothing_goes_on_and_a_stop_stops_the_hand_first(
    stack, daemon, wait_until, stroke, elsewhere
):
    jog = elsewhere(m.Jog(joints={"depth": 0.1}, by=True))
    wait_until(lambda: daemon.action is not None and isinstance(daemon.action.motion, m.JointTarget))
    wait_until(lambda: stack.engine._by_hand._motion._running)
    for call in (m.ResumeRun(), m.StepRun(), m.RunFrom(state="planning"), m.Jog(joints={"other": 0.1})):
        assert "moved by hand" in refusal(stack, call)
    stack.call(m.StopRun())
    jog.end()
    assert "cancelled" in jog.refusal
    wait_until(lambda: not stack.engine._by_hand.active)
    assert stack.call(m.GetEngine()).run.status == "paused"
    assert daemon.leases.held(), "they are the run's still"
    stack.call(m.StopRun())
    assert stack.ended().status == "stopped"
    wait_until(lambda: not daemon.leases.held())


def test_a_plan_is_executed_in_a_pause_too_and_answers_when_it_has_ended(stack, daemon, wait_until, stroke):
    by_hand(stack, daemon, wait_until, "depth", 0.0)
    there = round(float(daemon.command[0]) + 0.4, 3)
    plan = stack.call(m.PlanMotion(goals=[m.JointsGoal(positions={"angle": there})], arm="right"))
    daemon.slow = False
    stack.call(m.ExecutePlan(id=plan.id))
    assert stack.call(m.AwaitPlan(id=plan.id)).stale_causes == ["executed"]
    assert daemon.command[0] == pytest.approx(there)
    assert "approach goes on from where it was let go: angle is 0.40 rad off" in refusal(stack, m.ResumeRun())


def test_only_a_pause_lends_the_robot(stack, daemon, stroking):
    assert "busy" in refusal(stack, m.Jog(joints={"other": 0.1}))
    with pytest.raises(RefusedError, match="not paused"):
        stack.engine._run.lend(["depth"])
    assert not ids(daemon, m.CancelAction)


def test_a_plan_that_is_being_made_when_the_robot_is_moved_starts_elsewhere(stack, daemon, planner, wait_until):
    stack.place()
    planner.pace.clear()
    stack.run(goal_deg=10)
    wait_until(lambda: planner.asked)
    stack.call(m.PauseRun())
    by_hand(stack, daemon, wait_until, "other", 0.31)
    why = refusal(stack, m.ResumeRun())
    assert "planning: the plan that is being made starts at the robot's present posture: other is 0.31 rad off" in why
    planner.pace.set()


def test_a_question_about_a_plan_that_starts_elsewhere_is_told_before_it_is_asked(stack, daemon, wait_until):
    stack.place()
    stack.call(m.SetBreakpoints(states=["confirming"]))
    stack.run(goal_deg=10)
    stack.wait(lambda e: isinstance(e, m.RunState) and e.waiting == ["confirming"])
    by_hand(stack, daemon, wait_until, "angle", 0.5)
    why = refusal(stack, m.StepRun())
    assert (
        "confirming: plan-1 (turn wheel_1), which it asks about, can be executed" in why and "angle is 0.500 rad" in why
    )
    assert "plan anew (run from planning)" in why
    assert not [event for event in stack.events if isinstance(event, m.Prompt)]


def test_a_behaviour_that_was_let_go_can_only_be_tried_anew(stack, daemon, wait_until):
    daemon.slow = True
    stack.run("press")
    stack.call(m.AnswerPrompt(id=stack.prompt().id, answer="press"))
    wait_until(lambda: stack.engine._run._motion._running)
    stack.call(m.PauseRun())
    by_hand(stack, daemon, wait_until, "depth", 0.0)
    why = refusal(stack, m.ResumeRun())
    assert "press can go on from its middle: a behaviour that was let go" in why
    stack.call(m.ResumeRun())
    assert "was not resumed" in stack.ended().detail


def test_what_may_carry_the_robot_is_not_let_go(stack, daemon, wait_until, monkeypatch):
    daemon.slow = True
    stack.place()
    deployed = stack.call(m.Deploy(program="follow", bindings={"arm": "right", "guide": "wheel_1"}))
    stack.call(m.Run(deployment=deployed.id))
    wait_until(lambda: stack.engine._run._motion._running)
    stack.call(m.PauseRun())
    running = stack.engine._run._motion._running[0]
    whole = m.WholeBody(compound="stand")
    monkeypatch.setattr(running, "message", m.StartAction(id=running.message.id, owner="engine", motion=whole))
    assert "may be what it stands by" in refusal(stack, m.Jog(joints={"other": 0.1}))
    assert not ids(daemon, m.CancelAction)


@pytest.mark.parametrize("name", ACTIVITIES)
def test_every_activity_says_what_it_needs(name):
    assert ACTIVITIES[name].preconditions is not Activity.preconditions


@pytest.mark.parametrize(
    ("motion", "ends", "goes_on"),
    [
        (m.JointTarget(joints=["a"], positions=[1.0]), [], True),
        (m.JointTarget(joints=["a"], positions=[1.0]), [m.TimeEnd(after=1.0)], False),
        (m.CompliantMotion(frame="tip", joints=["a"], duration=1.0, goal_in_world=m.Pose()), [], True),
        (m.CompliantMotion(frame="tip", joints=["a"], duration=1.0), [], False),
        (
            m.CompliantMotion(frame="tip", joints=["a"], duration=1.0, goal_in_world=m.Pose()),
            [m.TravelEnd(frame="tip", distance=0.1, axis=(1.0, 0.0, 0.0))],
            False,
        ),
        (m.WholeBody(compound="posture", joints=["a"]), [], False),
    ],
)
def test_only_what_does_not_count_from_its_beginning_is_gone_on_with(motion, ends, goes_on):
    assert let_go.goes_on(m.StartAction(id="a", owner="engine", motion=motion, ends=ends)) is goes_on
