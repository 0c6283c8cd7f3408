"""Trajectories that keep constraints in their windows: judged at ten times their knots' density."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from scipy.interpolate import CubicSpline

from engines.planning.ik.checker import LENGTH
from engines.planning.ik.constraints import Balance, Direction, Pose, Position
from engines.planning.ik.spline import Spline
from engines.planning.ik.trajectory import TrajectoryProblem, TrajectorySolver
from engines.planning.plan import Infeasible
from engines.planning.waiting import Cancelled

TIP, HAND = "tool_right_tip", "gripper_right_base_link"
FOOT = ((0.1, 0.05, 0.0), (0.1, -0.05, 0.0), (-0.1, -0.05, 0.0), (-0.1, 0.05, 0.0))
FEET = ("left_sole_link", "right_sole_link")
KNOTS = [0.0, 0.5, 1.0, 1.5, 2.0]


@pytest.fixture(scope="module")
def trajectories(solver) -> TrajectorySolver:
    return TrajectorySolver(solver)


def test_the_spline_is_scipys_cubic_one_at_rest_at_both_ends():
    times = np.array([0.0, 0.3, 1.0, 1.2, 2.5])
    when = np.linspace(0.0, 2.5, 101)
    mine, other = Spline(times), CubicSpline(times, np.eye(5), bc_type="clamped")
    for derivative in range(3):
        assert np.allclose(mine.at(when, derivative), other(when, derivative), atol=1e-10)
    assert np.allclose(Spline(times[:2]).at(np.array([0.15])), [[0.5, 0.5]])


def test_a_humanoid_reaches_with_its_feet_still_and_its_weight_over_them_all_the_way(
    whole_body, humanoid, standing, placed, message
):
    feet = [Pose(frame=foot, target=message(placed(humanoid, standing, foot))) for foot in FEET]
    goal = placed(humanoid, standing, HAND).translation + np.array([0.35, 0.1, 0.2])
    reach = Position.at(HAND, goal, window=(2.0, 2.0))
    balance = Balance(contacts=dict.fromkeys(FEET, FOOT), margin=0.02)
    found = TrajectorySolver(whole_body).solve([*feet, balance, reach], standing, KNOTS).require()
    when = np.linspace(0.0, 2.0, 81)
    way = found.at(when)
    assert np.abs(pin.difference(humanoid.model, way[0], standing)).max() < 1e-9
    assert np.abs(placed(humanoid, way[-1], HAND).translation - goal).max() < LENGTH
    corners = np.array([placed(humanoid, standing, foot).act(np.array(corner))[:2] for foot in FEET for corner in FOOT])
    for q in way:
        for foot in FEET:
            apart = placed(humanoid, q, foot).translation - placed(humanoid, standing, foot).translation
            assert np.linalg.norm(apart) < 4e-3
        com = pin.centerOfMass(humanoid.model, humanoid.model.createData(), q)[:2]
        assert (com > corners.min(axis=0) + 0.018).all()
        assert (com < corners.max(axis=0) - 0.018).all()
    rows = [humanoid.coordinate[row] for row in humanoid.v_rows]
    numeric = (found.at(when + 1e-5)[:, rows] - found.at(when - 1e-5)[:, rows])[1:-1] / 2e-5
    assert np.allclose(found.velocities(when)[1:-1], numeric, atol=1e-5)
    assert np.abs(found.velocities(np.array([0.0, 2.0]))).max() < 1e-12


def test_a_steps_rows_are_how_much_nearer_each_knots_bounds_come_for_a_base_that_has_turned_too(
    whole_body, humanoid, standing, placed, message
):
    feet = [Pose(frame=foot, target=message(placed(humanoid, standing, foot))) for foot in FEET]
    once = Position.at(HAND, (0.3, -0.2, 0.9), window=(1.0, 1.0))
    columns = np.arange(humanoid.nv)
    problem = TrajectoryProblem(
        whole_body,
        [*feet, once],
        standing,
        np.array([0.0, 0.5, 1.0]),
        standing,
        np.ones(humanoid.nv),
        columns,
        (0.1, 0.1),
    )

    def below(point):
        return problem.linearise(point, 1.0).below[len(point) :].copy()

    point = np.random.default_rng(5).uniform(-0.3, 0.3, 2 * humanoid.nv)
    matrix = problem.linearise(point, 1.0).matrix.copy()
    numeric = [(below(point - 1e-6 * one) - below(point + 1e-6 * one)) / 2e-6 for one in np.eye(len(point))]
    assert matrix.shape == (2 * 12 + 3, len(point))
    assert np.allclose(matrix, np.transpose(numeric), atol=1e-6)


def test_a_constraint_holds_in_its_window_and_not_outside(trajectories, upper, ready, placed):
    there = placed(upper, ready, TIP).translation
    by_the_side = Position.at(TIP, there + np.array([0.0, -0.1, 0.1]), window=(0.7, 0.9), name="stop")
    back = Position.at(TIP, there, window=(2.0, 2.0))
    found = trajectories.solve([by_the_side, back], ready, KNOTS).require()
    assert {0.7, 0.9} <= set(found.times.tolist()), "a window's ends are knots"

    def off(time):
        return np.abs(placed(upper, found.at(time)[0], TIP).translation - there - [0.0, -0.1, 0.1]).max()

    assert max(off(time) for time in np.linspace(0.7, 0.9, 21)) < 2e-3
    assert off(0.3) > 0.02
    assert off(1.5) > 0.02
    assert np.abs(placed(upper, found.at(2.0)[0], TIP).translation - there).max() < LENGTH


def test_knots_are_added_where_more_is_missed_between_them_than_is_tolerated(trajectories, upper, ready, placed):
    tip = placed(upper, ready, TIP)
    level = Direction(frame=TIP, axis=(0, 0, -1), direction=tuple(-tip.rotation[:, 2]), cone=0.02, name="level")
    goal = Position.at(TIP, tip.translation + np.array([0.0, -0.25, 0.2]), window=(2.0, 2.0))
    coarse = trajectories.solve([level, goal], ready, [0.0, 2.0], between=1e6).require()
    fine = trajectories.solve([level, goal], ready, [0.0, 2.0], between=2.0).require()
    assert len(coarse.times) == 2
    assert len(fine.times) > 2

    def tilt(found):
        return max(
            np.arccos(min(1.0, placed(upper, q, TIP).rotation[:, 2] @ tip.rotation[:, 2]))
            for q in found.at(np.linspace(0.0, 2.0, 101))
        )

    assert tilt(coarse) > 0.025
    assert tilt(fine) < 0.0225


def test_smoother_costs_more_way_and_less_acceleration(trajectories, upper, ready, placed):
    there = placed(upper, ready, TIP).translation
    via = Position.at(TIP, there + np.array([0.0, -0.2, 0.2]), window=(0.5, 0.5))
    home = Position.at(TIP, there, window=(2.0, 2.0))

    def hardest(weight):
        found = trajectories.solve([via, home], ready, KNOTS, acceleration=weight).require()
        return np.abs(Spline(found.times).acceleration @ found.knots).max()

    assert hardest(1.0) < 0.9 * hardest(0.0)


def test_a_way_that_is_not_found_names_the_constraint_and_the_time(trajectories, upper, ready):
    far = Position.at(TIP, [3.0, 0.0, 0.3], window=(1.0, 2.0), name="button")
    found = trajectories.solve([far], ready, KNOTS, starts=1)
    assert not found.feasible
    assert found.violations[0].measure.constraint == "button"
    assert 1.0 <= found.violations[0].time <= 2.0
    with pytest.raises(Infeasible, match=r"way: button \(x\) is .* m at .* s, missed by"):
        found.require("way")


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"times": [0.0]}, "times: got .*expected two or more"),
        ({"times": [0.0, 0.0]}, "each after the one before"),
        ({"times": [0.0, float("nan")]}, "finite times"),
        ({"velocity": -1.0}, "velocity: got -1.0"),
        ({"start": np.zeros(2)}, "start: got shape"),
        (
            {"constraints": [Position.at(TIP, [0, 0, 0], window=(5, 6))]},
            r"window: got \(5, 6\); expected one that meets 0 to 2 s",
        ),
    ],
)
def test_a_question_that_can_not_be_meant_is_refused(more, words, trajectories, ready):
    with pytest.raises(ValueError, match=words):
        trajectories.solve(**({"constraints": [], "start": ready, "times": KNOTS} | more))


def test_it_stops_when_it_is_cancelled(trajectories, ready):
    with pytest.raises(Cancelled):
        trajectories.solve([], ready, KNOTS, cancelled=lambda: True)
