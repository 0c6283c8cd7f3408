"""No plan, and why; what clients see of a plan; cancelling; the same question twice."""

from __future__ import annotations

import numpy as np
import pytest

from engines.planning.plan import Infeasible
from engines.planning.waiting import Cancelled
from handrail.messages import PlanPreview


@pytest.fixture(scope="module")
def home(description):
    return description.home_position("ready")


@pytest.fixture(scope="module")
def stroke(seeded_plans):
    return seeded_plans[0]


def test_a_wheel_out_of_reach_is_infeasible_by_the_reach_that_is_missing(wheel_at, planner, home):
    with pytest.raises(Infeasible) as caught:
        planner.plan(wheel_at(np.array([2.0, -0.35, 0.30]), np.zeros(3)), "turn", "right", home)
    assert caught.value.constraint == "reach of the tool's tip"
    assert caught.value.unit == "m"
    assert 0.5 < caught.value.by < 2.0
    assert f"{caught.value.by:.3g} m" in str(caught.value)


def test_a_wheel_in_the_robots_chest_is_infeasible_and_names_the_constraint(wheel_at, planner, home):
    with pytest.raises(Infeasible) as caught:
        planner.plan(wheel_at(np.array([0.12, -0.05, 0.25]), np.zeros(3)), "turn", "right", home)
    assert caught.value.constraint == "clearance of the robot from itself"
    assert caught.value.by > 0.01


def test_an_arm_that_starts_in_the_wheel_is_told_which_bodies_are_too_close(wheel_at, planner, home, kinematics):
    beside = kinematics.frame(home, "arm_right_5_link").translation + np.array([0.0, 0.15, 0.0])
    with pytest.raises(
        Infeasible, match=r"where the robot stands: clearance .*\(arm_right_\d_link and (rim|spokes) of wheel_1\)"
    ):
        planner.plan(wheel_at(beside, np.zeros(3)), "turn", "right", home)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"arm": "middle"}, "expected one of right, left"),
        ({"trajectory": "open"}, "expected one of turn"),
        ({"position": np.zeros(3)}, r"expected \(18,\)"),
        ({"position": np.full(18, np.nan)}, "finite"),
    ],
)
def test_a_wrong_question_is_told_what_is_expected(nominal_wheel, planner, home, changes, words):
    question = {"trajectory": "turn", "arm": "right", "position": home} | changes
    with pytest.raises(ValueError, match=words):
        planner.plan(nominal_wheel, **question)


def test_the_preview_has_every_segments_ends_and_says_why_it_is_stale(stroke):
    _, plan = stroke
    preview = plan.preview(False, "the wheel was moved")
    assert isinstance(preview, PlanPreview)
    assert (preview.fresh, preview.stale_because) == (False, "the wheel was moved")
    assert preview.made_from == {"wheel_1": 1}
    assert preview.duration == pytest.approx(plan.duration)
    for shown, segment in zip(preview.segments, plan.segments, strict=True):
        assert shown.times[0] == 0.0
        assert shown.times[-1] == pytest.approx(segment.duration, abs=1e-3)
        assert np.allclose(shown.positions[0], segment.positions[0], atol=1e-4)
        assert np.allclose(shown.positions[-1], segment.positions[-1], atol=1e-4)
        assert len(shown.times) < 0.5 * len(segment.times) + 2
        drawn = [np.interp(segment.times, shown.times, column) for column in np.transpose(shown.positions)]
        assert np.abs(np.transpose(drawn) - segment.positions).max() < 0.006
    assert plan.preview(True, ghost=False).segments == []


def test_a_plan_goes_to_the_daemon_as_a_trajectory(stroke):
    _, plan = stroke
    motion = plan.segment("turn").motion(plan.joints)
    assert motion.joints == list(plan.joints)
    assert np.shape(motion.positions) == np.shape(motion.velocities) == (len(motion.times), len(plan.joints))
    assert motion.path_force is not None


@pytest.mark.parametrize("asked", [1, 40, 85])
def test_planning_stops_soon_after_it_is_cancelled(nominal_wheel, planner, home, asked):
    count = 0

    def cancelled() -> bool:
        nonlocal count
        count += 1
        return count >= asked

    try:
        planner.plan(nominal_wheel, "turn", "right", home, cancelled=cancelled)
    except Cancelled:
        assert count == asked
    else:
        pytest.fail(f"asked {count} times and not cancelled")


def test_cancelling_while_the_way_is_built_works_too_and_leaves_the_planner_usable(nominal_wheel, planner, home):
    words: list[str] = []
    with pytest.raises(Cancelled):
        planner.plan(
            nominal_wheel, "turn", "right", home, progress=words.append, cancelled=lambda: "way to turn" in words
        )
    assert words[0] == "arc and posture"
    assert planner.plan(nominal_wheel, "turn", "right", home).segments


def test_the_same_question_has_the_same_answer(seeded_plans, planner, home):
    wheel, plan = seeded_plans[3]
    again = planner.plan(wheel, "turn", "right", home)
    assert again.outputs == plan.outputs
    for one, other in zip(plan.segments, again.segments, strict=True):
        assert np.array_equal(one.times, other.times)
        assert np.array_equal(one.positions, other.positions)
        assert np.array_equal(one.velocities, other.velocities)
