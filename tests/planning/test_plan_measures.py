"""What a plan says of itself, held against the model at postures of its own motion."""

from __future__ import annotations

import numpy as np
import pytest

from engines.planning.collision.bodies import CollisionScene
from engines.planning.collision.obstacles import obstacles_of
from engines.planning.measures import CLEARANCE, LIMIT_MARGIN, TORQUE_SHARE, Measure, times_of


@pytest.fixture(scope="module")
def turning(wheel_at, planner, description):
    """A wheel, the plan for it, and one sample a row of its motion: times (k,), positions (k, m)."""
    wheel = wheel_at(np.array([0.55, -0.35, 0.30]), np.zeros(3))
    return wheel, planner.plan(wheel, "turn", "right", description.home_position("ready"))


def at(plan, time):
    """(m,) rad, where the plan is at a time, s."""
    times = np.concatenate([segment.times + start for segment, start in zip(plan.segments, plan.starts, strict=True)])
    positions = np.vstack([segment.positions for segment in plan.segments])
    return np.array([np.interp(time, times, column) for column in positions.T])


def test_every_waypoint_says_what_the_way_to_it_keeps_and_the_worst_of_all_is_the_plans(turning):
    _, plan = turning
    assert [waypoint.name for waypoint in plan.waypoints] == [segment.name for segment in plan.segments]
    assert plan.waypoints[-1].time == pytest.approx(plan.duration, abs=1e-3)
    assert min(waypoint.clearance.value for waypoint in plan.waypoints) == pytest.approx(plan.clearance, abs=1e-4)
    assert min(waypoint.limit_margin.value for waypoint in plan.waypoints) == pytest.approx(plan.limit_margin, abs=1e-4)
    for waypoint, segment, start in zip(plan.waypoints, plan.segments, plan.starts, strict=True):
        assert waypoint.residual < 0.003 and waypoint.tilt < 0.15
        for worst in (waypoint.clearance, waypoint.limit_margin, waypoint.torque_share):
            assert start - 1e-3 <= worst.time <= start + segment.duration + 1e-3


def test_clearances_are_those_of_the_bodies_named_at_the_time_told(turning, planner, description, whole):
    wheel, plan = turning
    scene = CollisionScene(planner._mechanism, description, description.arms["right"], obstacles_of(wheel), wheel.name)
    for waypoint in plan.waypoints:
        found = scene.to_self(whole(plan, at(plan, waypoint.clearance.time)[None]))
        if found.pairs[0] == waypoint.clearance.about:
            assert found.distance == pytest.approx(waypoint.clearance.value, abs=1e-3)
    nearest = min(plan.waypoints, key=lambda waypoint: waypoint.clearance.value)
    assert nearest.clearance.about == scene.to_self(whole(plan, at(plan, nearest.clearance.time)[None])).between


def test_margins_and_torques_name_the_joint_that_has_them(turning, description, kinematics, whole):
    _, plan = turning
    rows = description.index(plan.joints)
    worst = plan.measures[LIMIT_MARGIN].worst()
    q = at(plan, worst.time)
    room = np.minimum(q - description.lower[rows], description.upper[rows] - q)
    assert plan.joints[int(room.argmin())] == worst.about
    assert room.min() == pytest.approx(worst.value, abs=1e-6)

    still = plan.measures[TORQUE_SHARE]
    first = kinematics.gravity(whole(plan, plan.start[None])[0])[rows] / description.torque_limit[rows]
    assert still.values[0] == pytest.approx(np.abs(first).max(), abs=0.02), "at rest it is gravity that is held"
    limits = {waypoint.name: waypoint.force_limit for waypoint in plan.waypoints if waypoint.force_limit is not None}
    assert limits == {"turn": 60.0}, "as the template says"
    pushing = next(waypoint for waypoint in plan.waypoints if waypoint.name == "turn").torque_share
    free = next(waypoint for waypoint in plan.waypoints if waypoint.name == "withdraw").torque_share
    assert free.value < pushing.value < 1.0, "turning has the wheel's resistance to hold as well"


def test_inverse_dynamics_are_mass_and_gravity(kinematics, description):
    generator = np.random.default_rng(3)
    q = generator.uniform(-0.5, 0.5, len(description.joints))
    acceleration = generator.normal(0.0, 1.0, len(q))
    expected = kinematics.mass_matrix(q) @ acceleration + kinematics.gravity(q)
    found = kinematics.inverse_dynamics(q[None], np.zeros((1, len(q))), acceleration[None])[0]
    assert np.allclose(found, expected, atol=1e-9)
    assert not np.allclose(kinematics.inverse_dynamics(q[None], 1.0 + 0 * q[None], acceleration[None])[0], expected)


def test_a_motion_passes_the_rows_of_its_path_when_it_is_there():
    path = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    times = np.linspace(0.0, 4.0, 401)
    way = 2.0 * (times / 4.0) ** 2  # slow at first
    positions = np.column_stack([np.minimum(way, 1.0), np.maximum(way - 1.0, 0.0)])
    assert times_of(path, times, positions) == pytest.approx([0.0, 4.0 * np.sqrt(0.5), 4.0], abs=0.01)
    assert times_of(np.zeros((3, 2)), times, np.zeros((401, 2))) == pytest.approx([0.0, 2.0, 4.0])


@pytest.mark.parametrize(("name", "value", "time"), [(CLEARANCE, 0.1, 2.0), (TORQUE_SHARE, 0.3, 1.0)])
def test_the_worst_is_the_least_clearance_but_the_largest_torque(name, value, time):
    measure = Measure(name, np.array([0.0, 1.0, 2.0]), np.array([0.2, 0.3, 0.1]), ("a", "b", "c"))
    worst = measure.worst()
    assert (worst.value, worst.time, worst.about) == (value, time, {2.0: "c", 1.0: "b"}[time])
    assert measure.shifted(1.0).worst().time == time + 1.0
    series = measure.series()
    assert [series.names[row] for row in series.which] == ["a", "b", "c"]
