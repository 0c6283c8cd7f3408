"""A verified plan: what is wrong with it is found whatever made it, named with place, time and figure."""

from __future__ import annotations

import dataclasses

import coal
import numpy as np
import pinocchio as pin
import pytest

from engines.planning.collision.margins import Margins
from engines.planning.collision.obstacles import Obstacle
from engines.planning.collision.world import World
from engines.planning.ik.constraints import Position
from engines.planning.plan import Plan, Segment
from engines.planning.timing.timing import Limits, parametrise
from engines.planning.verifier import Verifier

JOINT = "torso_1_joint"


@pytest.fixture(scope="module")
def joints(description):
    return description.arms["right"].joints


@pytest.fixture(scope="module")
def limits(description, joints):
    velocity = 0.7 * description.velocity_limit[description.index(joints)]
    return Limits(velocity, 2.0 * velocity)


@pytest.fixture(scope="module")
def plan(mechanism, ready, joints, limits):
    """The torso turns by 0.5 rad, and back."""
    start = ready[mechanism.coordinate[[mechanism.row(joint) for joint in joints]]]
    there = start.copy()
    there[joints.index(JOINT)] += 0.5
    segments = []
    for name, ends in {"there": (start, there), "back": (there, start)}.items():
        knots = parametrise(np.linspace(*ends, 20), limits, 1.0)
        segments.append(Segment(name, knots.times, knots.positions, knots.velocities))
    return Plan("plan-1", "turn", "right", joints, tuple(segments), {}, start, 0.0, 0.0)


@pytest.fixture(scope="module")
def world(mechanism, description, joints):
    return World(mechanism, (), description.allowed_collision_pairs, moving=joints)


def verify(plan, world, limits, at, *, margins=None, **more):
    return Verifier(world, margins=margins).violations(plan, limits, at, **more)


def with_segment(plan, number, **changes):
    segments = list(plan.segments)
    segments[number] = dataclasses.replace(segments[number], **changes)
    return dataclasses.replace(plan, segments=tuple(segments))


def test_a_sound_plan_has_nothing_to_be_said_against_it(plan, world, limits, ready, description, joints):
    torque = description.torque_limit[description.index(joints)]
    assert verify(plan, world, limits, ready, torque=torque) == []


def test_a_plan_that_is_too_fast_is_found_in_velocity_and_acceleration(plan, world, limits, ready):
    back = plan.segments[1]
    hurried = with_segment(plan, 1, times=back.times / 8.0, velocities=back.velocities * 8.0)
    found = verify(hurried, world, limits, ready)
    assert {(v.segment, v.measure.constraint, v.measure.what) for v in found} == {
        ("back", "velocity limits", JOINT),
        ("back", "acceleration limits", JOINT),
    }
    speed = next(v for v in found if v.measure.constraint == "velocity limits")
    assert abs(speed.measure.value) == pytest.approx(8.0 * np.abs(back.velocities).max(), rel=1e-2)


def test_a_swing_beyond_a_limit_between_two_knots_is_found(plan, world, ready, mechanism, joints):
    top = float(mechanism.upper[mechanism.row(JOINT)])
    column = joints.index(JOINT)
    start = plan.start.copy()
    start[column] = top - 0.05
    rows, rates = np.repeat(start[None], 4, axis=0), np.zeros((4, len(joints)))
    rates[1, column] = 1.0  # up beyond the limit and back before the next knot
    swung = dataclasses.replace(
        plan, start=start, segments=(Segment("swing", np.array([0.0, 1.0, 2.0, 3.0]), rows, rates),)
    )
    (found,) = [
        v
        for v in verify(swung, world, Limits(np.full(len(joints), 9.0), np.full(len(joints), 99.0)), ready)
        if v.measure.constraint == "joint limits"
    ]
    assert found.measure.what == JOINT
    # Hermite's polynomial of a velocity of 1 rad/s at one end of 1 s: 4/27 rad at a third of it.
    assert found.measure.by == pytest.approx(4.0 / 27.0 - 0.05, abs=2e-3)
    assert found.time == pytest.approx(4.0 / 3.0, abs=0.05)


def test_what_stands_in_the_way_is_named_with_the_time_and_may_be_allowed(
    plan, mechanism, description, joints, limits, ready
):
    across = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, -0.726), np.array([0.383, -0.341, 0.08]))
    plate = Obstacle("plate", coal.Box(0.06, 0.0005, 0.2), across)
    world = World(mechanism, [plate], description.allowed_collision_pairs, moving=joints)
    found = verify(plan, world, limits, ready, margins=Margins(objects=0.0))
    assert {v.segment for v in found} == {"there", "back"}
    assert all(v.measure.what.endswith("and plate") for v in found)
    half = plan.segments[0].duration / 2.0
    assert any(v.time == pytest.approx(half, abs=0.15) for v in found), "the plate stands half-way"
    assert str(found[0].error()).startswith("there: clearance (")
    touching = {"there": (("*", "plate"),)}
    allowed = verify(plan, world, limits, ready, margins=Margins(objects=0.0), touching=touching)
    assert {v.segment for v in allowed} == {"back"}


def test_a_gap_a_start_in_motion_and_no_number_are_found(plan, world, limits, ready):
    first = plan.segments[0]
    moved = verify(with_segment(plan, 1, positions=plan.segments[1].positions + 0.01), world, limits, ready)
    assert [v.measure.constraint for v in moved] == ["begins where it is"]
    rolling = first.velocities.copy()
    rolling[0, 0] = 0.2
    assert [v.measure.constraint for v in verify(with_segment(plan, 0, velocities=rolling), world, limits, ready)] == [
        "rest at both ends"
    ]
    broken = first.positions.copy()
    broken[3, 0] = np.nan
    assert [v.measure.constraint for v in verify(with_segment(plan, 0, positions=broken), world, limits, ready)] == [
        "finite numbers"
    ]
    with pytest.raises(ValueError, match=r"there: got positions \(2, 9\)"):
        verify(with_segment(plan, 0, positions=first.positions[:2]), world, limits, ready)


def test_a_constraint_is_looked_at_in_its_window_only(plan, world, limits, ready, mechanism):
    data = mechanism.model.createData()
    pin.framesForwardKinematics(mechanism.model, data, ready)
    here = data.oMf[mechanism.frame_id("tool_right_tip")].translation
    end = plan.segments[0].duration
    stays = Position.at("tool_right_tip", here, name="stays", window=(0.0, 0.0))
    returns = Position.at("tool_right_tip", here, name="returns", window=(plan.duration, plan.duration))
    assert verify(plan, world, limits, ready, constraints=[stays, returns]) == []
    away = Position.at("tool_right_tip", here, name="away", window=(end, end))
    found = verify(plan, world, limits, ready, constraints=[away])
    assert {v.measure.constraint for v in found} == {"away"}
    assert max(v.measure.by for v in found) > 0.1


def test_too_heavy_a_motion_is_found_in_its_torques(plan, world, limits, ready, description, joints):
    torque = description.torque_limit[description.index(joints)].copy()
    torque[joints.index("arm_right_1_joint")] = 0.5
    found = verify(plan, world, limits, ready, torque=torque)
    assert {(v.measure.constraint, v.measure.what) for v in found} == {("torque limits", "arm_right_1_joint")}
