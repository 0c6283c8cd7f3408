"""A stroke that there is no plan for may miss its goals, on request: as little as it must, told by how much."""

from __future__ import annotations

import numpy as np
import pytest

from engines.planning.constraints import REACH
from engines.planning.plan import Infeasible


@pytest.fixture(scope="module")
def home(description):
    return description.home_position("ready")


def test_a_wheel_at_the_edge_of_reach_is_turned_with_the_tip_off_by_what_the_plan_tells(planner, wheel_at, home):
    wheel = wheel_at(np.array([0.95, -0.35, 0.30]), np.zeros(3))
    with pytest.raises(Infeasible):
        planner.plan(wheel, "turn", "right", home)
    plan = planner.plan(wheel, "turn", "right", home, relax=["tilt", "reach"])
    residual = max(m.values.max() for each in plan.segments for m in each.measures if m.name == "residual")
    (gave,) = (one for one in plan.gave if one.what == "distance")
    assert gave.unit == "m"
    assert gave.by == pytest.approx(residual - REACH.bound, abs=1e-5)
    assert gave.by < 0.09, "as little as it must"
    assert gave.goal.startswith("reach of the tool's tip on the way to ")


def test_where_there_is_a_plan_nothing_gives(planner, nominal_wheel, nominal_plan, home):
    plan = planner.plan(nominal_wheel, "turn", "right", home, relax=["reach"])
    assert plan.gave == ()
    assert np.array_equal(plan.segments[-1].positions, nominal_plan.segments[-1].positions)


def test_what_no_leeway_makes_possible_is_refused_as_without_it(planner, wheel_at, home):
    wheel = wheel_at(np.array([2.0, -0.35, 0.30]), np.zeros(3))
    with pytest.raises(Infeasible, match="reach of the tool's tip is"):
        planner.plan(wheel, "turn", "right", home, relax=["tilt", "reach"])


@pytest.mark.parametrize("relax", [["clearance"], ["tilt", "tilt"]])
def test_only_the_goals_of_the_tool_give_way_each_once(planner, nominal_wheel, home, relax):
    with pytest.raises(ValueError, match=rf"relax\[{len(relax) - 1}\]: got '{relax[-1]}'; expected tilt or reach"):
        planner.plan(nominal_wheel, "turn", "right", home, relax=relax)
