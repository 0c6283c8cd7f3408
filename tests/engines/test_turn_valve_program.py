"""The library's program, run by a real engine against a daemon that plays actions."""

from __future__ import annotations

import math

import pytest

from handrail import messages as m

OUT = -0.08 + 1e-6


def approve(stack, count=1):
    stack.call(m.AnswerPrompt(id=stack.prompt(count).id, answer="approve", by="test"))


def test_strokes_go_on_until_the_wheel_is_believed_far_enough_and_the_tool_ends_outside(stack, daemon):
    stack.place()
    stack.run(goal_deg=285)
    approve(stack)
    ended = stack.ended()
    assert ended.status == "succeeded", ended.detail
    assert ended.data["turned_deg"] >= 285
    assert ended.data["stroke"] >= 3
    assert daemon.command[1] <= OUT
    assert math.degrees(daemon.wheel) == pytest.approx(ended.data["turned_deg"], abs=0.5)
    state = stack.call(m.GetInstances()).instances[0]
    assert math.degrees(state.joint_state["hinge"]) == pytest.approx(ended.data["turned_deg"], abs=1e-6)
    assert state.version == 1, "believing another angle is not an edit"


def test_it_is_bound_to_a_wheel_or_a_lever_and_to_nothing_else(stack):
    stack.call(m.PlaceInstance(name="it", template="box", pose_in_world=m.Pose(position=(0.5, 0.0, 0.0))))
    refused = stack.refusal(m.Deploy(program="turn_valve", bindings={"arm": "right", "valve": "it"}))
    assert refused.expected == "an instance of wheel or lever_valve; there is none, place one first"


def test_later_strokes_keep_the_arc_that_the_first_one_chose_and_start_from_where_the_robot_is_commanded(
    stack, planner, daemon
):
    stack.place()
    stack.run(goal_deg=150)
    approve(stack)
    assert stack.ended().status == "succeeded"
    assert planner.asked[0]["arc"] is None
    assert {each["arc"] for each in planner.asked[1:]} == {0.5}
    assert planner.asked[1]["position"][1] == pytest.approx(-0.08)
    assert planner.asked[1]["instance"].joint_state["hinge"] > 0.1


def test_a_plan_is_shown_when_it_is_made_and_again_only_when_its_freshness_changes(stack):
    stack.place()
    stack.run(goal_deg=285)
    approve(stack)
    assert stack.ended().data["stroke"] >= 3
    told = [(e.id, e.fresh) for e in stack.events if isinstance(e, m.PlanPreview)]
    assert len(told) == len(set(told)), told
    assert all((f"plan-{number}", True) in told for number in (1, 2, 3))


def test_a_tripped_guard_backs_out_and_reaches_in_further_around(stack, planner, daemon):
    daemon.resist(2)
    stack.place()
    stack.run(goal_deg=60)
    approve(stack)
    ended = stack.ended()
    assert ended.status == "succeeded", ended.detail
    shifts = [math.degrees(each["entry_shift"]) for each in planner.asked[:3]]
    assert shifts == pytest.approx([0, 12, 24])
    assert planner.asked[1]["position"][1] == pytest.approx(-0.08, abs=1e-3), (
        "it must have backed out to where engaging began"
    )
    assert max(e.data["retries"] for e in stack.events if isinstance(e, m.RunState) and e.data) == 2
    assert ended.data["retries"] == 0


def test_it_gives_up_withdrawn_when_every_attempt_meets_resistance(stack, planner, daemon):
    daemon.trip = lambda action: "pose_error" if any(isinstance(end, m.PoseErrorEnd) for end in action.ends) else ""
    stack.place()
    stack.run(max_retries=2)
    approve(stack)
    ended = stack.ended()
    assert ended.status == "failed"
    assert "resistance (pose_error) in engage" in ended.detail
    assert len(planner.asked) == 3
    assert daemon.command[1] <= OUT + 1e-3


def test_a_motion_that_fails_in_mid_turn_is_withdrawn_from_and_named(stack, daemon):
    daemon.trip = lambda action: "diverged" if getattr(action.motion, "path_force", None) else ""
    stack.place()
    stack.run()
    approve(stack)
    ended = stack.ended()
    assert ended.status == "failed"
    assert "turn: the robot left its command" in ended.detail
    assert daemon.command[1] <= OUT + 1e-3
    turn = next(action for action in daemon.started() if getattr(action.motion, "path_force", None))
    back = daemon.started()[daemon.started().index(turn) + 1]
    assert back.motion.positions[-1][0] == pytest.approx(back.motion.positions[0][0] - math.radians(8), abs=0.01)
    assert ended.data["turned_deg"] == 0, "a failed action's push is not counted"


def test_too_few_strokes_end_in_failure_with_the_numbers(stack):
    stack.place()
    stack.run(goal_deg=3000, max_strokes=2)
    approve(stack)
    ended = stack.ended()
    assert ended.status == "failed"
    assert "no more strokes" in ended.detail and "2 strokes" in ended.detail


def test_a_rejected_prompt_moves_nothing(stack, daemon):
    stack.place()
    stack.run()
    prompt = stack.prompt()
    assert prompt.plan == "plan-1" and prompt.options == ["approve", "reject"]
    assert prompt.details["clearance_m"] == pytest.approx(0.03)
    stack.call(m.AnswerPrompt(id=prompt.id, answer="reject", by="someone"))
    ended = stack.ended()
    assert ended.status == "failed" and "rejected by someone" in ended.detail
    assert not daemon.started()


def test_an_infeasible_plan_ends_the_run_naming_the_constraint(stack, planner):
    planner.infeasible = True
    stack.place()
    stack.run()
    ended = stack.ended()
    assert ended.status == "failed"
    assert "elbow limit missed by 0.12 rad" in ended.detail


def test_an_instance_moved_while_the_operator_thinks_is_planned_and_asked_about_anew(stack, planner, daemon):
    stack.place()
    stack.run(goal_deg=30)
    first = stack.prompt()
    stack.call(m.MoveInstance(name="wheel_1", pose_in_world=m.Pose(position=(0.55, -0.35, 0.31))))
    stack.call(m.AnswerPrompt(id=first.id, answer="approve"))
    second = stack.prompt(2)
    assert not daemon.started(), "the stale plan must not move anything"
    assert second.plan == "plan-2"
    assert planner.asked[1]["instance"].version == 2
    approve(stack, 2)
    assert stack.ended().status == "succeeded"


def test_simulated_time_is_held_while_the_program_computes_and_released_at_its_end(stack, daemon):
    stack.place()
    stack.run(goal_deg=30)
    approve(stack)
    stack.ended()
    kinds = daemon.kinds()
    assert kinds[0] == "HoldTime" and kinds[-1] == "ReleaseTime"
    assert all(action.hold_after_s > 0 and action.owner == "engine" for action in daemon.started())
    assert len({action.id for action in daemon.started()}) == len(daemon.started())
    held = [call for call in daemon.calls if isinstance(call, m.HoldTime)]
    assert all(call.owner == "engine" for call in held)


def test_the_guard_and_the_path_force_reach_the_daemon_with_their_segments(stack, daemon):
    stack.place()
    stack.run(goal_deg=30)
    approve(stack)
    stack.ended()
    turning = [action for action in daemon.started() if action.motion.path_force is not None]
    guarded = [action for action in daemon.started() if action.ends]
    strokes = stack.ended().data["stroke"]
    assert len(turning) == len(guarded) == strokes
    assert not {action.id for action in turning} & {action.id for action in guarded}
