"""Which arm and where: choices are ranked, and the first that leads to a plan is taken where no arm is named."""

from __future__ import annotations

from handrail import messages as m


def test_choices_are_told_the_best_first_with_what_they_lack_and_where_they_begin(stack):
    stack.place()
    found = stack.call(m.RankChoices(instance="wheel_1")).choices
    assert [(each.arm, each.arc, each.share, each.lacks) for each in found] == [
        ("left", 0.5, 1.0, ""),
        ("right", 1.5, 1.0, ""),
        ("right", 2.5, 0.25, "reach"),
    ]
    assert found[0].joints == {"angle": 0.1, "depth": -0.2}
    only = stack.call(m.RankChoices(instance="wheel_1", trajectory="turn", arms=["right"])).choices
    assert {each.arm for each in only} == {"right"}


def test_any_arm_is_the_first_that_leads_to_a_plan(stack, planner):
    stack.place()
    assert stack.call(m.MakePlan(instance="wheel_1", trajectory="turn", arm="")).arm == "left"
    planner.cannot = {("left", 0.5)}
    assert stack.call(m.MakePlan(instance="wheel_1", trajectory="turn", arm="")).arm == "right"
    assert [(asked["arm"], asked["arc"]) for asked in planner.asked] == [("left", 0.5), ("left", 0.5), ("right", 1.5)]
    planner.infeasible = True
    refusal = stack.refusal(m.MakePlan(instance="wheel_1", trajectory="turn", arm=""))
    assert "no plan for turn at wheel_1 with any arm: elbow limit" in refusal.message


def test_a_stroke_is_planned_beside_all_other_instances_and_stale_when_one_of_them_moves(stack, planner):
    stack.place()
    pose = m.Pose(position=(0.2, 0.5, 0.3))
    stack.call(m.PlaceInstance(name="wheel_2", template="wheel", pose_in_world=pose))
    plan = stack.call(m.MakePlan(instance="wheel_1", trajectory="turn"))
    assert planner.asked[-1]["others"] == ["wheel_2"]
    stack.call(m.MoveInstance(name="wheel_2", pose_in_world=m.Pose(position=(0.3, 0.5, 0.3))))
    told = stack.call(m.GetPlan(id=plan.id))
    assert told.stale_causes == ["instance_moved"] and "wheel_2 was moved" in told.stale_because


def test_choices_for_what_is_not_there_are_refused(stack):
    assert stack.refusal(m.RankChoices(instance="wheel_9")).message.startswith("no such instance")
    stack.place()
    assert "no arm 'third'" in stack.refusal(m.RankChoices(instance="wheel_1", arms=["third"])).message
