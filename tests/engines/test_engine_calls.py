"""What clients ask the engine: instances, plans, deployments, prompts, the whole picture for the late."""

from __future__ import annotations

import re

import numpy as np
import pytest

from affordance_templates import instance_file
from handrail import messages as m
from handrail.topics import Caller, RefusedError
from tests.engines.conftest import tip_pose

ELSEWHERE = m.Pose(position=(0.5, -0.3, 0.3))


def test_a_plan_goes_stale_when_its_instance_moves_and_is_refused_with_the_reason(stack, daemon):
    stack.place()
    plan = stack.call(m.MakePlan(instance="wheel_1", trajectory="turn"))
    assert plan.fresh and plan.made_from == {"wheel_1": 1}
    moved = stack.call(m.MoveInstance(name="wheel_1", pose_in_world=ELSEWHERE))
    assert moved.version == 2
    told = stack.wait(lambda e: isinstance(e, m.PlanPreview) and not e.fresh)
    assert told.id == plan.id and "version 1, now 2" in told.stale_because
    refusal = stack.refusal(m.ExecutePlan(id=plan.id))
    assert "stale" in refusal.message and "wheel_1 was moved 70.7 mm" in refusal.message
    assert not daemon.started()


def test_a_plan_goes_stale_when_parameters_change_or_the_instance_is_removed(stack):
    stack.place()
    plan = stack.call(m.MakePlan(instance="wheel_1", trajectory="turn"))
    assert stack.call(m.SetParameters(name="wheel_1", parameters={"radius": 0.16})).version == 2
    assert not stack.call(m.GetPlan(id=plan.id)).fresh
    stack.call(m.RemoveInstance(name="wheel_1"))
    assert "removed" in stack.call(m.GetPlan(id=plan.id)).stale_because
    assert stack.wait(lambda e: isinstance(e, m.InstanceState) and e.removed).name == "wheel_1"


def test_a_name_placed_again_does_not_freshen_old_plans(stack):
    stack.place()
    plan = stack.call(m.MakePlan(instance="wheel_1", trajectory="turn"))
    stack.call(m.RemoveInstance(name="wheel_1"))
    assert stack.place().version == 2
    assert not stack.call(m.GetPlan(id=plan.id)).fresh


def test_a_plan_whose_start_the_robot_has_left_is_stale(stack, daemon, wait_until):
    stack.place()
    plan = stack.call(m.MakePlan(instance="wheel_1", trajectory="turn"))
    daemon.command[0] = 0.05
    wait_until(lambda: stack.engine._services.daemon.command()[0] == 0.05)
    refusal = stack.refusal(m.ExecutePlan(id=plan.id))
    assert "angle is 0.050 rad off" in refusal.message


def test_clients_hear_without_asking_that_the_robot_has_left_a_plans_start_and_that_it_is_back(stack, daemon):
    stack.place()
    plan = stack.call(m.MakePlan(instance="wheel_1", trajectory="turn"))
    start = daemon.command[0]
    daemon.command[0] = start + 0.05
    told = stack.wait(lambda e: isinstance(e, m.PlanPreview) and not e.fresh)
    assert (told.id, told.stale_causes, told.segments) == (plan.id, ["start_left"], []), "the ghost is not sent again"
    daemon.command[0] = start
    stack.wait(lambda e: isinstance(e, m.PlanPreview) and e.fresh and not e.segments)


def test_a_plan_that_counts_on_a_joint_to_stay_is_stale_when_that_has_moved(stack, daemon):
    stack.place()
    plan = stack.call(m.MakePlan(instance="wheel_1", trajectory="turn"))
    daemon.command[2] = 0.3
    told = stack.wait(lambda e: isinstance(e, m.PlanPreview) and not e.fresh)
    assert told.stale_causes == ["others_moved"] and "other" in told.stale_because
    assert "counts on other to stay" in stack.refusal(m.ExecutePlan(id=plan.id)).message


def test_a_plans_details_come_when_asked_for_and_only_then(stack, daemon):
    stack.place(radius=0.16)
    made = stack.call(m.MakePlan(instance="wheel_1", trajectory="turn"))
    told = stack.wait(lambda e: isinstance(e, m.PlanPreview))
    for thin in (made, told, stack.call(m.GetPlan(id=made.id))):
        assert (thin.origin, thin.measures, thin.tool) == (None, {}, [])
        assert [waypoint.name for waypoint in thin.waypoints] == [segment.name for segment in thin.segments]
        assert thin.waypoints[1].clearance == m.PlanWorst(value=0.03, time=2.0, about="arm and post")
        assert thin.waypoints[1].residual is None, "was not measured"
    whole = stack.call(m.GetPlan(id=made.id, details=True))
    assert whole.origin.asked == {"instance": "wheel_1", "trajectory": "turn", "arm": "right", "entry_shift": 0.0}
    assert whole.origin.joints == {"angle": 0.0, "depth": -0.3, "other": 0.0}
    assert (whole.origin.instances[0].version, whole.origin.instances[0].parameters["radius"]) == (1, 0.16)
    near = whole.measures["clearance"]
    assert [near.names[row] for row in near.which] == ["arm and wheel", "arm and post"] * len(whole.segments)
    assert near.times[:4] == [0.0, 1.0, 1.0, 2.0]
    knots = [knot for segment in whole.segments for knot in segment.positions]
    assert whole.tool[-1] == pytest.approx(tip_pose(np.array([*knots[-1], 0.0]), "right")[0].tolist(), abs=1e-3)
    assert len(whole.tool) == len(knots)


def test_a_plan_can_be_executed_segment_by_segment(stack, daemon, wait_until):
    stack.place()
    plan = stack.call(m.MakePlan(instance="wheel_1", trajectory="turn"))
    stack.call(m.ExecutePlan(id=plan.id, segments=["approach", "standoff"]))
    stack.wait(lambda e: isinstance(e, m.LogLine) and "done after standoff" in e.text)
    assert daemon.command[1] == pytest.approx(-0.08)
    wait_until(lambda: not stack.engine._job.active)
    stack.call(m.ExecutePlan(id=plan.id, segments=["engage", "turn", "release", "withdraw"]))
    stack.wait(lambda e: isinstance(e, m.LogLine) and "done after withdraw" in e.text)
    assert stack.call(m.GetInstances()).instances[0].joint_state["hinge"] == pytest.approx(daemon.wheel, abs=1e-6)


def test_a_plan_is_executed_once(stack, daemon, wait_until):
    stack.place()
    plan = stack.call(m.MakePlan(instance="wheel_1", trajectory="turn"))
    stack.call(m.ExecutePlan(id=plan.id))
    stack.wait(lambda e: isinstance(e, m.LogLine) and "done after withdraw" in e.text)
    wait_until(lambda: not stack.engine._job.active)
    daemon.command[:2] = plan.segments[0].positions[0]
    wait_until(lambda: stack.engine._services.daemon.command()[1] == daemon.command[1])
    assert "executed already" in stack.call(m.GetEngine()).plans[0].stale_because
    assert "executed already" in stack.refusal(m.ExecutePlan(id=plan.id)).message
    assert "executed already" in stack.refusal(m.ExecutePlan(id=plan.id, segments=["turn", "approach"])).message


def test_unknown_segments_plans_instances_arms_and_trajectories_are_refused_naming_what_there_is(stack):
    stack.place()
    plan = stack.call(m.MakePlan(instance="wheel_1", trajectory="turn"))
    assert "approach, standoff" in stack.refusal(m.ExecutePlan(id=plan.id, segments=["wave"])).message
    assert "plan-1" in stack.refusal(m.GetPlan(id="plan-9")).expected
    assert "wheel_1" in stack.refusal(m.MakePlan(instance="wheel_2", trajectory="turn")).expected
    assert "right, left" in stack.refusal(m.MakePlan(instance="wheel_1", trajectory="turn", arm="third")).message
    assert "expected one of turn" in stack.refusal(m.MakePlan(instance="wheel_1", trajectory="paint")).message


def test_an_infeasible_plan_is_refused_with_the_constraint_and_by_how_much(stack, planner):
    planner.infeasible = True
    stack.place()
    assert "elbow limit missed by 0.12 rad" in stack.refusal(m.MakePlan(instance="wheel_1", trajectory="turn")).message


def test_other_clients_are_answered_while_one_waits_for_its_plan(stack, planner, runtime):
    stack.place()
    planner.pace.clear()
    other = Caller(runtime.endpoint("engine.call"))
    stack.caller._socket.send(__import__("msgspec").msgpack.encode(m.MakePlan(instance="wheel_1", trajectory="turn")))
    assert other.call(m.GetInstances(), timeout_s=30).instances[0].name == "wheel_1"
    planner.pace.set()
    assert stack.caller._socket.poll(5000)
    other.close()


def test_a_late_answer_is_told_that_and_by_whom_the_prompt_was_answered(stack):
    stack.place()
    stack.run()
    prompt = stack.prompt()
    assert "approve, reject" in stack.refusal(m.AnswerPrompt(id=prompt.id, answer="maybe")).expected
    stack.call(m.AnswerPrompt(id=prompt.id, answer="reject", by="anna"))
    late = stack.refusal(m.AnswerPrompt(id=prompt.id, answer="approve", by="bert"))
    assert late.message == "the prompt was already answered 'reject' by anna"
    assert stack.wait(lambda e: isinstance(e, m.PromptClosed)).by == "anna"
    assert "no such prompt" in stack.refusal(m.AnswerPrompt(id="prompt-0", answer="approve")).message


def test_a_late_client_gets_instances_plans_the_run_and_open_prompts(stack):
    stack.place()
    assert stack.call(m.GetEngine()).run is None
    stack.run()
    prompt = stack.prompt()
    stack.wait(lambda e: isinstance(e, m.RunState) and e.active == ["confirming"])
    picture = stack.call(m.GetEngine())
    assert [each.name for each in picture.instances] == ["wheel_1"]
    assert [each.id for each in picture.plans] == [prompt.plan]
    assert picture.run.status == "running" and picture.run.active == ["confirming"]
    assert picture.run.data.keys() >= {"turned_deg", "stroke", "retries"}
    assert picture.prompts == [prompt]


def test_run_states_name_the_states_outermost_first(stack):
    stack.place()
    stack.run(goal_deg=10)
    stack.call(m.AnswerPrompt(id=stack.prompt().id, answer="approve"))
    stack.ended()
    assert ["turning", "stroking"] in [e.active for e in stack.events if isinstance(e, m.RunState)]


def test_instances_survive_an_engine_restart(start, runtime):
    stack = start()
    stack.place(radius=0.17)
    stack.call(m.MoveInstance(name="wheel_1", pose_in_world=ELSEWHERE))
    before = stack.call(m.GetInstances()).instances
    again = start()
    assert again.call(m.GetInstances()).instances == before
    assert before[0].version == 2 and before[0].parameters["radius"] == 0.17


@pytest.mark.parametrize(
    ("bindings", "parameters", "field", "expected"),
    [
        ({"valve": "wheel_1"}, {}, "bindings.arm", "right, left"),
        ({"arm": "third", "valve": "wheel_1"}, {}, "bindings.arm", "right, left"),
        ({"arm": "right", "valve": "wheel_2"}, {}, "bindings.valve", "one of: wheel_1"),
        ({"arm": "right", "valve": "wheel_1", "hand": "x"}, {}, "bindings.hand", "arm, valve"),
        ({"arm": "right", "valve": "wheel_1"}, {"goal_deg": 9999}, "parameters.goal_deg", "5 to 3600 deg"),
        ({"arm": "right", "valve": "wheel_1"}, {"goal_deg": "far"}, "parameters.goal_deg", "a number"),
        ({"arm": "right", "valve": "wheel_1"}, {"max_strokes": 2.5}, "parameters.max_strokes", "whole number"),
        ({"arm": "right", "valve": "wheel_1"}, {"speed": 1}, "parameters.speed", "goal_deg"),
    ],
)
def test_a_deployment_that_does_not_fit_is_refused_naming_field_and_expectation(
    stack, bindings, parameters, field, expected
):
    stack.place()
    refusal = stack.refusal(m.Deploy(program="turn_valve", bindings=bindings, parameters=parameters))
    assert refusal.field == field
    assert expected in refusal.expected


def test_a_deployment_without_instances_says_to_place_one(stack):
    refusal = stack.refusal(m.Deploy(program="turn_valve", bindings={"arm": "right", "valve": "wheel_1"}))
    assert "place one first" in refusal.expected


def test_a_deployment_whose_instance_is_gone_does_not_run(stack):
    stack.place()
    deployed = stack.call(m.Deploy(program="turn_valve", bindings={"arm": "right", "valve": "wheel_1"}))
    stack.call(m.RemoveInstance(name="wheel_1"))
    assert "deploy again" in stack.refusal(m.Run(deployment=deployed.id)).message


def test_the_library_is_listed_with_hashes(stack):
    entries = {(each.kind, each.name): each for each in stack.call(m.ListLibrary()).entries}
    program = entries["program", "turn_valve"]
    assert program.hash and not program.problem
    stack.place()
    deployed = stack.call(m.Deploy(program="turn_valve", bindings={"arm": "right", "valve": "wheel_1"}))
    assert deployed.hash == program.hash
    assert entries["template", "wheel"].title == "Wheel valve"


def test_only_programs_of_the_library_are_deployed(stack, tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("title: Mine\n")
    for name in (str(file), "../rtc_programs/turn_valve.yaml", "\0.yaml"):
        refusal = stack.refusal(m.Deploy(program=name, bindings={}))
        assert refusal.message == "no such program"
        assert re.search("one of follow, .*, turn_valve", refusal.expected)


def test_a_defect_that_a_call_finds_ends_neither_the_engine_nor_the_run(stack, monkeypatch):
    stack.place()
    stack.run()

    def crash(*_):
        raise OSError("No space left on device")

    monkeypatch.setattr(instance_file, "write", crash)
    refusal = stack.refusal(m.MoveInstance(name="wheel_1", pose_in_world=ELSEWHERE))
    assert "No space left on device" in refusal.message
    assert stack.call(m.GetInstances()).instances[0].version == 1, "nothing has changed"
    assert stack.call(m.GetEngine()).run.status == "running"


def test_a_malformed_call_changes_nothing_and_is_answered(stack):
    stack.caller._socket.send(b"\x93not a call")
    assert stack.caller._socket.poll(2000)
    stack.caller._socket.recv()
    with pytest.raises(RefusedError):
        stack.call(m.GetStatus())
    assert stack.call(m.GetInstances()).instances == []


def test_a_template_is_told_to_whoever_draws_it_elsewhere(stack):
    stack.place()
    (wheel,) = stack.call(m.GetInstances()).instances
    told = stack.call(m.GetTemplate(template="wheel"))
    assert told.hash == wheel.template_hash and "hinge" in told.text
    assert "no such template" in str(stack.refusal(m.GetTemplate(template="whale")))
