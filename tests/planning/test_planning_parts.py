"""The planner's parts by themselves: kinematics, time along a path, free ways, obstacles, the entry's angle."""

from __future__ import annotations

import dataclasses

import coal
import numpy as np
import pytest
from scipy.stats import qmc

from engines.planning.collision.obstacles import obstacles_of
from engines.planning.plan import Infeasible
from engines.planning.strokes.halton import halton
from engines.planning.strokes.tip_solver import TipSolver, starts
from engines.planning.strokes.visit import Visit
from engines.planning.timing.timing import Limits, accelerations, parametrise, peak_velocities


@pytest.fixture(scope="module", params=["right", "left"])
def arm(request, description):
    return description.arms[request.param]


@pytest.fixture(scope="module")
def solver(mechanism, description, arm):
    return TipSolver(mechanism, description, arm)


def random_postures(solver, count):
    generator = np.random.default_rng(1)
    return generator.uniform(solver.lower, solver.upper, (count, len(solver.lower)))


@pytest.mark.parametrize("dimensions", [1, 7, 25])
def test_even_points_are_those_of_scipy_without_the_first(dimensions):
    expected = qmc.Halton(dimensions, scramble=False).random(301)[1:]
    assert np.array_equal(halton(300, dimensions), expected)


def test_the_tips_place_agrees_with_pinocchio(solver, arm, description, kinematics):
    for q in random_postures(solver, 50):
        position = description.home_position("ready")
        position[description.index(arm.joints)] = q
        expected = kinematics.frame(position, arm.tip)
        tip, pointing = solver.tip(q)
        assert np.allclose(tip, expected.translation, atol=1e-12)
        assert np.allclose(pointing, -expected.rotation[:, 2], atol=1e-12)


def test_targets_known_to_be_reachable_are_reached_from_a_posture_nearby(solver):
    generator = np.random.default_rng(2)
    reached = 0
    for q in random_postures(solver, 100):
        position, pointing = solver.tip(q)
        start = np.clip(q + generator.normal(0.0, 0.1, len(q)), solver.lower, solver.upper)
        reach = solver.solve(start, position, pointing, start)
        reached += reach.residual[0] < 1e-3 and reach.tilt[0] < 0.02
    assert reached >= 97, "all but the odd one at a stretched elbow"


def test_solutions_keep_the_joint_limits_even_where_the_target_is_out_of_reach(solver):
    for q in random_postures(solver, 10):
        reach = solver.solve(q, np.array([3.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), q)
        assert reach.residual[0] > 1.0
        assert (reach.q >= solver.lower).all()
        assert (reach.q <= solver.upper).all()


def test_starts_are_within_limits_and_begin_with_the_postures_given(solver):
    first, second = random_postures(solver, 2)
    found = starts([first, second], solver.lower, solver.upper, 10)
    assert found.shape == (10, len(first))
    assert np.array_equal(found[:2], [first, second])
    assert (found >= solver.lower).all()
    assert (found <= solver.upper).all()


PATH = 0.5 * np.sin(np.linspace(0, 2, 30)[:, None] + np.arange(4))
LIMITS = Limits(np.array([2.0, 2.0, 1.0, 2.0]), np.array([4.0, 4.0, 4.0, 1.0]))


@pytest.mark.parametrize("duration", [0.0, 0.5, 2.6, 8.0])
def test_knots_keep_limits_last_long_enough_and_rest_at_both_ends(duration):
    knots = parametrise(PATH, LIMITS, duration)
    assert knots.times[-1] >= duration - 1e-9
    assert (peak_velocities(knots) <= LIMITS.velocity * 1.0001).all()
    assert (np.abs(accelerations(knots)) <= LIMITS.acceleration * 1.0001).all()
    assert not knots.velocities[[0, -1]].any()
    assert np.allclose(knots.positions[[0, -1]], PATH[[0, -1]], atol=1e-9)


def test_an_unhurried_segment_takes_its_duration_and_not_more():
    assert parametrise(PATH, LIMITS, 8.0).times[-1] == pytest.approx(8.0, rel=0.01)


def test_without_a_duration_some_joint_is_at_its_limit():
    knots = parametrise(PATH, LIMITS, 0.0)
    used = np.abs(accelerations(knots)).max(axis=0) / LIMITS.acceleration
    assert max(used.max(), (peak_velocities(knots) / LIMITS.velocity).max()) > 0.9


def test_knots_stay_on_the_path():
    knots = parametrise(PATH, LIMITS, 1.0)
    dense = np.array([0.5 * np.sin(s + np.arange(4)) for s in np.linspace(0, 2, 4000)])
    off = [np.abs(dense - row).max(axis=1).min() for row in knots.positions]
    assert max(off) < 1e-3


def test_acceleration_has_no_steps():
    knots = parametrise(PATH, LIMITS, 2.6)
    second = accelerations(knots)[: len(knots.times) - 1]
    assert np.abs(np.diff(second, axis=0)).max() < 0.35 * np.abs(second).max()


def test_a_path_that_goes_nowhere_waits_out_its_duration():
    knots = parametrise(np.repeat(PATH[:1], 5, axis=0), LIMITS, 0.7)
    assert knots.times[-1] == pytest.approx(0.7)
    assert not knots.velocities.any()


def test_a_wheel_is_an_obstacle_at_every_angle_of_its_hinge(nominal_wheel):
    turned = dataclasses.replace(nominal_wheel, joint_state={"hinge": 0.7})
    for wheel in (nominal_wheel, turned):
        found = {obstacle.name: obstacle for obstacle in obstacles_of(wheel)}
        assert set(found) == {"rim", "spokes"}
        rim = found["rim"].geometry
        assert isinstance(rim, coal.Cylinder)
        assert 0.162 <= rim.radius < 0.165
        assert 0.012 <= rim.halfLength < 0.0135
        assert np.allclose(np.abs(found["rim"].placement.rotation[:, 2]), [1, 0, 0], atol=1e-9)
        assert np.allclose(found["rim"].placement.translation, [0.55, -0.35, 0.30])


def test_the_entry_is_the_earliest_clear_angle_and_moves_with_the_wheel(nominal_wheel):
    needed = np.arcsin(0.022 / 0.10) + np.deg2rad(20)
    for joint in np.linspace(-3.0, 3.0, 25):
        visit = Visit(dataclasses.replace(nominal_wheel, joint_state={"hinge": joint}), "turn")
        entry = visit.entry_angle(np.pi)
        earlier = np.arange(np.pi - np.pi / 3, entry - 0.02, 0.005)
        spokes = np.pi / 2 * np.arange(4) + joint

        def gap(angles, spokes=spokes):
            return np.abs(np.angle(np.exp(1j * (np.atleast_1d(angles)[:, None] - spokes)))).min(axis=1)

        assert gap(entry)[0] >= needed - 1e-9
        assert (gap(earlier) < needed).all()


def test_an_arc_too_short_to_touch_a_spoke_has_no_entry(nominal_wheel):
    narrow = dataclasses.replace(nominal_wheel, parameters={"arc": 30})
    with pytest.raises(Infeasible, match="entry"):
        Visit(narrow, "turn").entry_angle(np.deg2rad(45))


def test_a_tip_is_found_again_about_the_hinge(wheel_at):
    visit = Visit(wheel_at(np.array([0.4, -0.3, 0.2]), np.array([0.3, -0.2, 0.1])), "turn")
    for angle in (-2.0, 0.0, 1.5):
        position, axis = visit.tip(visit.standoff, angle)
        found, radius, depth, tilt = visit.local(position, axis)
        assert found == pytest.approx(angle)
        assert (radius, depth) == (pytest.approx(0.10), pytest.approx(-0.10))
        assert tilt == pytest.approx(0.0, abs=1e-6)


def test_an_instance_that_is_turned_or_moved_has_obstacles_of_its_own(nominal_wheel, wheel_at):
    here = obstacles_of(nominal_wheel)
    assert obstacles_of(nominal_wheel) == here
    there = wheel_at(np.array([0.9, 0.0, 0.3]), np.zeros(3))
    assert np.allclose(obstacles_of(there)[0].placement.translation[0] - here[0].placement.translation[0], 0.9 - 0.55)
    wider = dataclasses.replace(nominal_wheel, parameters={"radius": 0.2})
    assert obstacles_of(wider)[0].geometry.radius > here[0].geometry.radius + 0.04
