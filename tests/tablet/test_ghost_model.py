"""Plans as ghosts: which is shown, where it stands, whether it may be executed."""

from __future__ import annotations

import numpy as np
import pytest

from tablet_client.models.plans import Plans, Track


def test_segments_follow_one_another_in_time(robot):
    track = Track(robot.plan())
    assert track.duration == 3.0
    assert track.spans == (("approach", 0.0, 2.0), ("turn", 2.0, 3.0))
    assert [track.segment(time) for time in (0.0, 1.99, 2.0, 3.0)] == ["approach", "approach", "turn", "turn"]


def test_the_ghost_stands_between_knots_and_at_the_ends_beyond_them(robot):
    plan = robot.plan()
    track = Track(plan)
    first, last = plan.segments[0].positions, plan.segments[-1].positions
    assert track.at(1.0) == pytest.approx((np.array(first[0]) + first[1]) / 2)
    assert track.at(-5.0) == pytest.approx(first[0])
    assert track.at(99.0) == pytest.approx(last[-1])
    assert track.at(np.array([0.0, 3.0])) == pytest.approx(np.array([first[0], last[-1]]))


def test_joints_that_a_plan_does_not_move_stay_where_the_robot_has_them(robot):
    track, joints = Track(robot.plan()), robot.description.joints
    posture = track.posture(joints, robot.position, track.duration)
    moved = {joint for joint, a, b in zip(joints, posture, robot.position, strict=True) if abs(a - b) > 1e-9}
    assert moved and moved <= set(track.joints)
    assert "arm_left_4_joint" not in moved


def test_a_fresh_plan_plays_rests_at_its_goal_and_starts_over(robot):
    plans = Plans()
    plans.take(robot.plan())
    assert plans.advance(2.9) and plans.time == pytest.approx(2.9)
    assert plans.advance(1.0) and plans.time == 3.0
    assert not plans.advance(0.5), "it rests"
    assert plans.advance(0.5) and plans.time == 0.0


def test_a_scrubbed_ghost_stays_where_it_was_put(robot):
    plans = Plans()
    plans.take(robot.plan())
    plans.scrub(1.25)
    assert not plans.advance(1.0)
    assert plans.time == 1.25
    plans.scrub(99.0)
    assert plans.time == 3.0


def test_a_plan_vanishes_when_the_robot_moves_and_the_next_one_appears(robot):
    plans = Plans()
    plans.take(robot.plan("stroke-1"))
    plans.motion_began()
    assert plans.shown is None
    plans.take(robot.plan("stroke-2"))
    assert plans.shown is not None and plans.shown.id == "stroke-2"


def test_an_update_of_a_used_plan_does_not_bring_its_ghost_back(robot):
    plans = Plans()
    plans.take(robot.plan())
    plans.motion_began()
    plans.take(robot.plan(fresh=False, stale_because="it starts elsewhere"))
    assert plans.shown is None


def test_a_plan_that_goes_stale_before_it_was_used_stays_visible_with_its_reason(robot):
    plans = Plans()
    plans.take(robot.plan())
    plans.take(robot.plan(fresh=False, stale_because="wheel_1 was moved"))
    assert plans.shown is not None and plans.shown.stale_because == "wheel_1 was moved"
    assert plans.why_not_execute("plan-1") == "stale"


def test_news_without_a_ghost_leaves_the_ghost_that_is_known(robot):
    plans = Plans()
    plans.take(robot.plan())
    track = plans.track
    plans.take(robot.plan(fresh=False, stale_because="wheel_1 was moved", segments=[]))
    assert plans.track is track and track.duration == 3.0
    assert plans.why_not_execute("plan-1") == "stale"


def test_the_plan_that_a_prompt_is_about_is_shown_before_all_others(robot):
    plans = Plans()
    plans.take(robot.plan("asked"))
    plans.take(robot.plan("newer"))
    plans.attend("asked")
    assert plans.shown is not None and plans.shown.id == "asked"
    plans.attend("")
    assert plans.shown is not None and plans.shown.id == "newer"


def test_old_plans_are_forgotten(robot):
    plans = Plans()
    for number in range(100):
        plans.take(robot.plan(f"plan-{number}"))
    assert plans.get("plan-0") is None and plans.get("plan-99") is not None
    assert plans.why_not_execute("plan-0") == "plan_missing"


def test_a_plan_without_segments_is_no_ghost_but_no_error_either(robot):
    plans = Plans()
    plans.take(robot.plan(segments=[]))
    assert plans.track is not None and plans.track.duration == 0.0
    assert not plans.advance(1.0)
