"""Motions to goals: planned by call and in programs, from now and from where another plan ends."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from engines.programs import program
from handrail import cloud
from handrail import messages as m
from handrail.config import ConfigError
from handrail.topics import Caller, Publisher, RefusedError

PROGRAM = """\
title: Go there
resources:
  arm: {kind: arm}
  valve: {kind: instance, template: wheel}
variables: {plan: "", next: "", why: ""}
states:
  reaching:
    do: plan
    with:
      arm: arm
      goals:
        - {type: frame, instance: valve, feature: turn.approach, pose: {}, about: z}
      through:
        - goals: [{type: joints, positions: {angle: 0.1}}]
      clearance: 0.02
      relax: ["goals[0]"]
    transitions:
      - {event: done.invoke.reaching, target: looking_ahead, set: {plan: _event.data.plan}}
      - {event: error.execution, target: failed, set: {why: failure}}
  looking_ahead:
    do: plan
    with: {arm: arm, goals: [{type: joints, positions: {depth: -0.1}}], after: plan}
    transitions:
      - {event: done.invoke.looking_ahead, target: going, set: {next: _event.data.plan}}
      - {event: error.execution, target: failed, set: {why: failure}}
  going:
    do: execute
    with: {plan: plan}
    transitions:
      - {event: done.invoke.going, target: on}
      - {event: error.execution, target: failed, set: {why: failure}}
  on:
    do: execute
    with: {plan: next}
    transitions:
      - {event: done.invoke.on, target: good}
      - {event: error.execution, target: failed, set: {why: failure}}
  good: {final: true, outcome: succeeded}
  failed: {final: true, outcome: failed, detail: "{why}"}
"""


def joints(**positions: float) -> list[m.Goal]:
    return [m.JointsGoal(positions=positions)]


def test_a_motion_is_planned_among_all_instances_shown_and_executed(stack, daemon, planner, wait_until):
    stack.place()
    plan = stack.call(m.PlanMotion(goals=joints(angle=0.5), arm="right", label="aside"))
    assert (plan.label, plan.joints, plan.fresh, plan.made_from) == ("aside", ["angle", "depth"], True, {"wheel_1": 1})
    assert planner.asked[-1]["instances"] == ["wheel_1"]
    assert stack.wait(lambda e: isinstance(e, m.PlanPreview) and e.id == plan.id)
    stack.call(m.ExecutePlan(id=plan.id))
    stack.wait(lambda e: isinstance(e, m.LogLine) and "aside: done after goals" in e.text)
    assert daemon.command[0] == pytest.approx(0.5)


def test_a_motion_that_is_infeasible_is_refused_with_what_is_missed(stack, planner):
    planner.infeasible = True
    refusal = stack.refusal(m.PlanMotion(goals=joints(angle=0.5), arm="right"))
    assert "no plan to the goals: elbow limit missed by 0.12 rad" in refusal.message


def test_a_plan_made_from_where_another_ends_waits_for_that_one(stack, daemon, planner, wait_until):
    first = stack.call(m.PlanMotion(goals=joints(angle=0.5), arm="right"))
    second = stack.call(m.PlanMotion(goals=joints(depth=-0.1), arm="right", after=first.id))
    third = stack.call(m.PlanMotion(goals=joints(angle=0.2), arm="right", after=second.id))
    assert np.allclose(planner.asked[1]["position"], [0.5, -0.3, 0.0])
    assert np.allclose(planner.asked[2]["position"], [0.5, -0.1, 0.0]), "and of what was planned before that"
    assert first.fresh and not third.fresh
    assert third.stale_because == f"it begins where {second.id} (to goals) ends, which was not executed"
    assert "was not executed" in stack.refusal(m.ExecutePlan(id=third.id)).message
    for plan, row, there in ((first, 0, 0.5), (second, 1, -0.1), (third, 0, 0.2)):
        stack.call(m.ExecutePlan(id=plan.id))
        wait_until(lambda: not stack.engine._job.active)
        assert daemon.command[row] == pytest.approx(there)
        wait_until(lambda row=row, there=there: abs(stack.engine._services.daemon.command()[row] - there) < 1e-9)


def test_a_stroke_is_planned_from_where_a_motion_ends_and_no_plan_from_one_that_is_not_there(stack, planner):
    stack.place()
    first = stack.call(m.PlanMotion(goals=joints(angle=0.5), arm="right"))
    stack.call(m.MakePlan(instance="wheel_1", trajectory="turn", after=first.id))
    assert planner.asked[-1]["position"][0] == pytest.approx(0.5)
    refusal = stack.refusal(m.PlanMotion(goals=joints(angle=0.5), arm="right", after="plan-99"))
    assert "after: no such plan" in refusal.message and "plan-99" in refusal.message


def test_a_program_plans_to_goals_at_the_instance_that_it_is_bound_to_and_ahead(
    stack, daemon, planner, tmp_path, monkeypatch
):
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    (tmp_path / "rtc_programs").mkdir()
    (tmp_path / "rtc_programs" / "go_there.yaml").write_text(PROGRAM)
    stack.place()
    deployed = stack.call(m.Deploy(program="go_there", bindings={"arm": "right", "valve": "wheel_1"}))
    stack.call(m.Run(deployment=deployed.id))
    end = stack.ended()
    assert end.status == "succeeded", end.detail
    first, second = (asked["call"] for asked in planner.asked)
    assert first.goals == [m.FrameGoal(instance="wheel_1", feature="turn.approach", pose=m.Pose(), about="z")]
    assert first.through == [m.KeyFrame(goals=joints(angle=0.1))]
    assert (first.arm, first.clearance, second.after) == ("right", 0.02, "plan-1")
    assert (first.relax, second.relax) == (["goals[0]"], [])
    assert np.allclose(daemon.command, [0.3, -0.1, 0.0])


def test_planning_tells_what_it_does_and_ends_when_it_is_cancelled(stack, planner):
    planner.pace.clear()
    asking = Caller(stack.runtime.endpoint("engine.call"))
    refused: list[RefusedError] = []

    def ask() -> None:
        try:
            asking.call(m.PlanMotion(goals=joints(angle=0.5), arm="right", label="aside"), 30.0)
        except RefusedError as problem:
            refused.append(problem)
        finally:
            asking.close()

    thread = threading.Thread(target=ask)
    thread.start()
    assert stack.wait(lambda e: isinstance(e, m.PlanProgress) and e.what == "aside").doing == "waiting for the test"
    stack.call(m.CancelPlanning())
    assert stack.wait(lambda e: isinstance(e, m.PlanProgress) and e.done).what == "aside"
    thread.join(30)
    assert "planning was cancelled" in str(refused[0])
    planner.pace.set()
    assert stack.call(m.PlanMotion(goals=joints(angle=0.5), arm="right")).fresh, "later calls are not"


ALONG = """\
title: Turn it in the hand
resources:
  arm: {kind: arm}
  valve: {kind: instance, template: wheel}
variables: {plan: "", turned: 0.0}
states:
  planning:
    do: plan
    with: {arm: arm, along: {instance: valve, joint: hinge, by: 0.4, about: z}}
    transitions:
      - {event: done.invoke.planning, target: going, set: {plan: _event.data.plan}}
      - {event: error.execution, target: failed}
  going:
    do: execute
    with: {plan: plan}
    transitions:
      - {event: done.invoke.going, target: good, set: {turned: _event.data.turned}}
      - {event: error.execution, target: failed}
  good: {final: true, outcome: succeeded, detail: "{turned:.1f}"}
  failed: {final: true, outcome: failed, detail: "{failure}"}
"""


def test_a_joint_that_a_tool_went_with_is_believed_to_have_moved(stack, planner, tmp_path, monkeypatch):
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    (tmp_path / "rtc_programs").mkdir()
    (tmp_path / "rtc_programs" / "turn.yaml").write_text(ALONG)
    stack.place()
    deployed = stack.call(m.Deploy(program="turn", bindings={"arm": "right", "valve": "wheel_1"}))
    assert stack.call(m.CheckTask(deployment=deployed.id)).feasible
    assert stack.call(m.GetInstances()).instances[0].joint_state == {"hinge": 0.0}, "a rehearsal turns nothing"
    stack.call(m.Run(deployment=deployed.id))
    end = stack.ended()
    assert (end.status, end.detail) == ("succeeded", "0.4")
    assert planner.asked[-1]["call"].along == m.Along(instance="wheel_1", joint="hinge", by=0.4, about="z")
    assert stack.call(m.GetInstances()).instances[0].joint_state["hinge"] == pytest.approx(0.4)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("type: frame", "type: fram", r"go.yaml:11: states.reaching.with.goals: .*'fram'.* expected goals"),
        ("about: z", "about: w", r"with.goals: .*about.* expected goals"),
        ("instance: valve, f", "instance: wheel, f", "goals: got 'wheel', no resource of kind instance; expected one of: valve"),
        ("  clearance: 0.02", "  clearance: 0.02\n      trajectory: turn", "with.trajectory: beside goals"),
        ("goals: [{type: joints, positions: {depth: -0.1}}], after", "after", "with.instance: missing; plan needs it"),
        ("goals: [{type: joints, positions: {depth: -0.1}}], after", "goals: [], after", "with.goals: got none; expected goals"),
    ],
)  # fmt: skip
def test_wrong_goals_are_refused_before_anything_runs(tmp_path, old, new, told):
    file = tmp_path / "go.yaml"
    assert old in PROGRAM
    file.write_text(PROGRAM.replace(old, new))
    with pytest.raises(ConfigError, match=told):
        program.read(file)


def test_what_cameras_see_is_kept_clear_of_where_that_is_asked_for_and_told(stack, runtime, daemon, wait_until):
    question = m.PlanMotion(goals=joints(angle=0.5), arm="right", seen=True)
    stack.place()
    stroke = m.MakePlan(instance="wheel_1", trajectory="turn", seen=True)
    for asked in (question, stroke):
        assert "no camera sees anything" in stack.refusal(asked).message
    camera = Publisher(runtime.endpoint("sensors.events"))
    picture = cloud.pack("head", 0, np.zeros((7, 3)), None, (0.0, 0.0, 0.0))

    def seen() -> bool:
        camera.send(picture)
        return bool(stack.engine._services.clouds())

    wait_until(seen)
    plans = [stack.call(question), stack.call(stroke)]
    camera.close()
    for plan in plans:
        assert stack.call(m.GetPlan(id=plan.id, details=True)).origin.asked["seen"] == "head: 7 points, 0.0 s old"
