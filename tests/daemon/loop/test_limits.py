"""The final limits, as pure functions."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.safety.limits import Limits, effective_torque, enforce, first_not_finite
from hal.joint import JointCommand, JointState

LIMITS = Limits(
    lower=np.array([-1.0, -2.0]),
    upper=np.array([1.0, 2.0]),
    velocity=np.array([2.0, 1.0]),
    torque=np.array([50.0, 8.0]),
    torque_step=np.array([2.0, 0.3]),
    period=0.002,
)


def command(**rows: list[float]) -> JointCommand:
    made = JointCommand(2)
    for name, values in rows.items():
        getattr(made, name)[:] = values
    return made


def test_a_command_within_the_limits_is_left_alone() -> None:
    previous = command(position=[0.1, 0.2], stiffness=[500, 60], damping=[20, 1], torque=[10, 2])
    wanted = command(position=[0.101, 0.2], velocity=[0.02, 0], stiffness=[500, 60], damping=[20, 1], torque=[10, 2.1])
    before, state = command(), JointState(2)
    before.copy_from(wanted)
    state.position[:] = [0.09, 0.19]
    assert enforce(wanted, previous, state, LIMITS) == 0
    for name in ("position", "velocity", "torque", "stiffness", "damping"):
        assert np.array_equal(getattr(wanted, name), getattr(before, name))


def test_a_position_step_becomes_a_motion_at_the_velocity_limit() -> None:
    wanted = command(position=[0.5, -0.5])
    assert enforce(wanted, command(), JointState(2), LIMITS) == 2
    assert wanted.position == pytest.approx([0.004, -0.002])


def test_a_joint_outside_its_limits_may_come_back_but_not_go_further() -> None:
    outside = command(position=[1.2, 0.0])
    further, back = command(position=[1.203, 0.0]), command(position=[1.198, 0.0])
    enforce(further, outside, JointState(2), LIMITS)
    enforce(back, outside, JointState(2), LIMITS)
    assert further.position[0] == 1.2
    assert back.position[0] == pytest.approx(1.198)


def test_a_stiffness_that_would_jerk_a_deflected_joint_is_balanced_by_torque() -> None:
    state = JointState(2)
    state.position[:] = [0.1, 0.0]
    previous, wanted = command(), command(stiffness=[1000.0, 0.0])
    assert enforce(wanted, previous, state, LIMITS) == 1
    assert effective_torque(wanted, state.position, state.velocity)[0] == pytest.approx(-2.0)


@given(st.lists(st.floats(-1e3, 1e3), min_size=24, max_size=24))
@settings(max_examples=200, deadline=None)
def test_whatever_is_asked_no_limit_is_passed(numbers: list[float]) -> None:
    values = np.array(numbers).reshape(12, 2)
    state = JointState(2)
    state.position[:], state.velocity[:] = values[0] * 1e-3, values[1] * 1e-2
    previous = command(position=values[2] * 1e-3, torque=np.clip(values[3], -LIMITS.torque, LIMITS.torque))
    wanted = command(position=values[4], velocity=values[5], torque=values[6], stiffness=values[7], damping=values[8])
    enforce(wanted, previous, state, LIMITS)
    reach = LIMITS.velocity * LIMITS.period + 1e-9
    assert np.all(wanted.position <= np.maximum(previous.position, state.position) + reach)
    assert np.all(wanted.position >= np.minimum(previous.position, state.position) - reach)
    assert np.all(wanted.position <= np.maximum(LIMITS.upper, previous.position))
    assert np.all(wanted.position >= np.minimum(LIMITS.lower, previous.position))
    assert np.all(np.abs(wanted.velocity) <= LIMITS.velocity)
    assert np.all(wanted.stiffness >= 0)
    assert np.all(wanted.damping >= 0)
    torque = effective_torque(wanted, state.position, state.velocity)
    assert np.all(np.abs(torque) <= LIMITS.torque + 1e-6)
    assert np.all(np.abs(torque - previous.torque) <= LIMITS.torque_step + 1e-6)


@pytest.mark.parametrize("row", ["position", "velocity", "torque", "stiffness", "damping"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_set_point_that_is_no_number_is_found(row: str, value: float) -> None:
    bad = command()
    assert first_not_finite(bad) == -1
    getattr(bad, row)[1] = value
    assert first_not_finite(bad) == 1


def test_a_robots_limits_come_from_its_description(talos) -> None:  # type: ignore[no-untyped-def]
    limits = Limits.of(talos)
    assert limits.period == pytest.approx(0.002)
    assert limits.torque_step == pytest.approx(talos.torque_rate_limit * 0.002)
    assert dataclasses.asdict(limits)["lower"] is not None
