"""The final limits, as pure functions."""

import dataclasses

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from daemon.safety.limits import Cut, Limits, effective_torque
from daemon.safety.limits import enforce as enforced
from hal.joint import JointCommand, JointState, Mode

LIMITS = Limits(
    lower=np.array([-1.0, -2.0]),
    upper=np.array([1.0, 2.0]),
    velocity=np.array([2.0, 1.0]),
    torque=np.array([50.0, 8.0]),
    torque_step=np.array([2.0, 0.3]),
    period=0.002,
)


def enforce(wanted: JointCommand, previous: JointCommand, state: JointState, limits: Limits) -> Cut:
    """In place."""
    out = JointCommand(len(wanted))
    cut = enforced(out, wanted, previous, state, limits)
    wanted.copy_from(out)
    return cut


def command(**rows: list[float]) -> JointCommand:
    made = JointCommand(2)
    made.mode[:] = Mode.IMPEDANCE
    for name, values in rows.items():
        getattr(made, name)[:] = values
    return made


def test_a_command_within_the_limits_is_left_alone() -> None:
    previous = command(position=[0.1, 0.2], stiffness=[500, 60], damping=[20, 1], torque=[10, 2])
    wanted = command(position=[0.101, 0.2], velocity=[0.02, 0], stiffness=[500, 60], damping=[20, 1], torque=[10, 2.1])
    before, state = command(), JointState(2)
    before.copy_from(wanted)
    state.position[:] = [0.09, 0.19]
    assert enforce(wanted, previous, state, LIMITS).changed == 0
    for name in ("position", "velocity", "torque", "stiffness", "damping"):
        assert np.array_equal(getattr(wanted, name), getattr(before, name))


def test_a_position_step_becomes_a_motion_at_the_velocity_limit() -> None:
    wanted = command(position=[0.5, -0.5])
    assert enforce(wanted, command(), JointState(2), LIMITS).changed == 2
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
    assert enforce(wanted, previous, state, LIMITS).changed == 1
    assert effective_torque(wanted, state.position, state.velocity)[0] == pytest.approx(-2.0)


ANYTHING = st.floats(allow_nan=True, allow_infinity=True) | st.floats(-3.0, 3.0)


@given(
    wanted=st.lists(ANYTHING, min_size=10, max_size=10),
    modes=st.lists(st.integers(0, 255) | st.sampled_from(list(Mode)), min_size=2, max_size=2),
    measured=st.lists(ANYTHING | st.floats(-1.0, 1.0), min_size=4, max_size=4),
    cycles=st.integers(1, 3),
)
@example(wanted=[0.0] * 9 + [2.0], modes=[0, 0], measured=[0.0, 0.0, 0.0, 9e307], cycles=1)  # its spring overflows
@settings(max_examples=150, deadline=None, derandomize=True)
def test_whatever_is_asked_and_measured_no_limit_is_passed(
    wanted: list[float], modes: list[int], measured: list[float], cycles: int
) -> None:
    largest = command(torque=[60.0, 10.0], stiffness=[1e4, 1e4], damping=[1e3, 1e3])
    limits, state = dataclasses.replace(LIMITS, largest=largest), JointState(2)
    state.table[:2] = np.array(measured).reshape(2, 2)
    asked, previous = JointCommand(2), command(position=[0.9, -1.9], stiffness=[500.0, 60.0], damping=[20.0, 1.0])
    asked.table[...], asked.mode[:] = np.array(wanted).reshape(5, 2), modes
    for _ in range(cycles):  # what was written becomes what was written before
        out = JointCommand(2)
        if enforced(out, asked, previous, state, limits).changed < 0:
            return
        assert np.isfinite(out.table).all()
        reach = limits.velocity * limits.period * (1 + 1e-6)
        assert np.all(out.position <= np.maximum(previous.position, state.position) + reach)
        assert np.all(out.position >= np.minimum(previous.position, state.position) - reach)
        assert np.all(out.position <= np.maximum(limits.upper, previous.position))
        assert np.all(out.position >= np.minimum(limits.lower, previous.position))
        assert np.all(np.abs(out.velocity) <= limits.velocity)
        for gains, most in ((out.stiffness, largest.stiffness), (out.damping, largest.damping)):
            assert np.all((gains >= 0) & (gains <= most))
        assert np.all(np.abs(out.torque) <= largest.torque)
        torque, before = (drive_torque(one, state) for one in (out, previous))
        assert np.all(np.abs(torque) <= limits.torque + 1e-6)
        within = np.abs(before) <= limits.torque
        assert np.all((np.abs(torque - before) <= limits.torque_step + 1e-6) | ~within)
        previous = out


def drive_torque(command: JointCommand, state: JointState) -> np.ndarray:
    """What a drive makes of set-points, in whatever mode (hal.joint.Mode)."""
    torque = effective_torque(command, state.position, state.velocity)
    damped = -command.damping * state.velocity
    torque = np.where(command.mode == Mode.TORQUE, command.torque, torque)
    return np.where(command.mode == Mode.DAMPING, damped, torque)


@pytest.mark.parametrize("row", ["position", "velocity", "torque", "stiffness", "damping"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_set_point_that_is_no_number_is_found(row: str, value: float) -> None:
    good, bad, state = command(), command(), JointState(2)
    assert enforce(command(), good, state, LIMITS).changed == 0
    getattr(bad, row)[1] = value
    assert enforced(JointCommand(2), bad, good, state, LIMITS) == (-1, 0, 1)
    assert enforced(JointCommand(2), good, bad, state, LIMITS) == (-1, 0, 1), "nor one before which there was none"
    if row in ("position", "velocity"):
        getattr(state, row)[0] = value
        assert enforced(JointCommand(2), command(stiffness=[1, 1], damping=[1, 1]), good, state, LIMITS).joint == 0


def test_a_robots_limits_come_from_its_description(talos) -> None:  # type: ignore[no-untyped-def]
    limits = Limits.of(talos)
    assert limits.period == pytest.approx(0.002)
    assert limits.torque_step == pytest.approx(talos.torque_rate_limit * 0.002)
    assert dataclasses.asdict(limits)["lower"] is not None
