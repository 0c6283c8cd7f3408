"""A plan's figures: the worst of each measure, on the way to which waypoint, and how it stands."""

from __future__ import annotations

import pytest

from handrail.messages import PlanWaypoint, PlanWorst
from tablet_client.models.plan_figures import CLEARANCE, MEASURES, figures, level_of
from tablet_client.models.plans import Plans


def waypoint(name: str, time: float, clearance: float, margin: float, residual: float = 0.001, torque: float = 0.2):
    return PlanWaypoint(
        name=name,
        time=time,
        residual=residual,
        tilt=0.0,
        clearance=PlanWorst(value=clearance, time=time - 0.5, about="arm_right_5_link and rim"),
        limit_margin=PlanWorst(value=margin, time=time - 0.2, about="arm_right_4_joint"),
        torque_share=PlanWorst(value=torque, time=time, about="arm_right_6_joint"),
    )


@pytest.fixture
def plan(robot):
    return robot.plan(waypoints=[waypoint("approach", 2.0, 0.012, 0.3), waypoint("turn", 3.0, 0.05, 0.05, 0.004, 0.9)])


def test_each_figure_is_the_worst_waypoints_with_its_time_and_what_it_is_about(plan):
    told = {figure.code: figure for figure in figures(plan)}
    assert list(told) == ["clearance", "residual", "limit_margin", "torque_share"]
    near = told["clearance"]
    assert (near.text, near.where, near.at, near.about) == ("12 mm", "approach", 1.5, "arm_right_5_link and rim")
    assert (told["limit_margin"].text, told["limit_margin"].where) == ("2.9°", "turn")
    assert (told["residual"].text, told["residual"].where, told["residual"].at) == ("4 mm", "turn", 3.0)
    assert told["torque_share"].text == "90 %"
    assert {code: figure.level for code, figure in told.items()} == {
        "clearance": "danger",
        "residual": "warning",
        "limit_margin": "warning",
        "torque_share": "danger",
    }


def test_the_most_that_it_presses_with_is_told_where_something_is_to_be_touched(robot):
    ways = [PlanWaypoint(name="reach", time=1.0), PlanWaypoint(name="turn", time=3.0, force_limit=60.0)]
    ways.append(PlanWaypoint(name="press", time=4.0, force_limit=25.0))
    (force,) = (figure for figure in figures(robot.plan(waypoints=ways)) if figure.code == "force_limit")
    assert (force.text, force.where, force.at, force.decides) == ("60 N", "turn", 3.0, True)


def test_a_way_stands_as_its_worst_measure_does(plan):
    assert [level_of(plan, name) for name in ("approach", "turn", "elsewhere")] == ["danger", "danger", "good"]


def test_goals_that_are_met_point_at_no_waypoint_and_easy_torques_decide_nothing(robot):
    told = {figure.code: figure for figure in figures(robot.plan(waypoints=[waypoint("turn", 3.0, 0.05, 0.3, 1e-5)]))}
    assert (told["residual"].text, told["residual"].where, told["residual"].at) == ("0 mm", "", -1.0)
    assert [figure.code for figure in told.values() if figure.decides] == ["clearance", "residual", "limit_margin"]


def test_a_plan_that_tells_only_its_whole_is_shown_by_that(robot):
    assert [(figure.code, figure.text, figure.where) for figure in figures(robot.plan())] == [
        ("clearance", "31 mm", ""),
        ("limit_margin", "12.0°", ""),
    ]


@pytest.mark.parametrize("measure", MEASURES, ids=lambda measure: measure.code)
def test_levels_go_from_good_over_warning_to_danger(measure):
    better = measure.warning + (1e-6 if measure.least_is_worst else -1e-6)
    assert [measure.level(value) for value in (better, measure.warning, measure.danger)] == [
        "good",
        "warning",
        "danger",
    ]
    assert measure.least_is_worst == (measure is CLEARANCE or measure.code == "limit_margin")


def test_a_plan_without_its_ghost_is_asked_for_once(robot):
    plans = Plans()
    assert plans.want() == ""
    plans.take(robot.plan(segments=[]))
    assert plans.want() == "plan-1"
    assert plans.want() == "", "it is on its way"
    plans.take(robot.plan())
    assert plans.track.duration == 3.0
    assert plans.want() == ""


def test_why_a_plan_can_not_be_approved_is_its_first_cause(robot):
    plans = Plans()
    plans.take(robot.plan(fresh=False, stale_because="...", stale_causes=["instance_moved", "start_left"]))
    assert plans.why_not_execute("plan-1") == "stale_instance_moved"
