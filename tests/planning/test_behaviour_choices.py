"""Choices for a behaviour: ranked by how much of it an arm can do from which place, then by how far the arm has to go."""

from __future__ import annotations

import numpy as np
import pytest

from engines.planning import constraints
from engines.planning.waiting import Cancelled


@pytest.fixture(scope="module")
def home(description):
    return description.home_position("ready")


@pytest.fixture(scope="module")
def ranked(planner, home, wheel_at):
    """y of a wheel → its choices."""
    return {y: planner.rank(wheel_at(np.array([0.55, y, 0.30]), np.zeros(3)), home) for y in (-0.35, 0.35)}


def test_choices_are_ranked_by_share_then_by_the_arms_way_and_every_place_has_one_of_each_arm(ranked):
    for choices in ranked.values():
        keys = [(-round(choice.share, 3), choice.cost) for choice in choices]
        assert keys == sorted(keys)
        assert sorted((choice.arm, round(choice.arc, 6)) for choice in choices) == sorted(
            (arm, round(k * np.pi / 4, 6)) for arm in ("right", "left") for k in range(8)
        )
        assert all(bool(choice.lacks) == (choice.share < 1.0) for choice in choices)


def test_the_arm_on_whose_side_the_object_is_comes_first(ranked):
    assert ranked[-0.35][0].arm == "right" and ranked[0.35][0].arm == "left"
    assert ranked[-0.35][0].share == ranked[0.35][0].share == 1.0


def test_a_choice_that_is_feasible_as_a_whole_leads_to_a_plan_there(ranked, planner, home, wheel_at):
    best = ranked[-0.35][0]
    wheel = wheel_at(np.array([0.55, -0.35, 0.30]), np.zeros(3))
    assert planner.plan(wheel, best.trajectory, best.arm, home, arc=best.arc).outputs["arc_centre"] == best.arc


def test_where_a_choice_begins_the_tool_is_at_the_standoff_by_the_arcs_beginning(ranked, kinematics, description, home):
    best = ranked[-0.35][0]
    arm = description.arms[best.arm]
    position = home.copy()
    position[description.index(arm.joints)] = best.posture
    tip = kinematics.frame(position, arm.tip).translation - [0.55, -0.35, 0.30]
    angle = best.arc - np.deg2rad(60.0)
    assert np.allclose(tip, [-0.08, 0.1 * np.cos(angle), 0.1 * np.sin(angle)], atol=constraints.REACH.bound)
    assert best.cost == pytest.approx(np.linalg.norm(best.posture - home[description.index(arm.joints)]))


def test_what_only_a_part_of_is_in_reach_has_that_share_and_nothing_of_what_is_out_of_reach(planner, home, wheel_at):
    shares = []
    for x in (0.6, 1.0, 1.4):
        choices = planner.rank(wheel_at(np.array([x, -0.35, 0.30]), np.zeros(3)), home, arms=["right"])
        shares.append(np.mean([choice.share for choice in choices]))
    assert shares[0] > shares[1] > shares[2] == 0.0
    assert choices[0].lacks == constraints.REACH.name


def test_ranking_can_be_cancelled(planner, home, nominal_wheel):
    left = iter(range(20))
    with pytest.raises(Cancelled):
        planner.rank(nominal_wheel, home, cancelled=lambda: next(left, None) is None)
