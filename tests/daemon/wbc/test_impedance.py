"""Desired positions that go with torques."""

import numpy as np
import pytest

from daemon.wbc import layout as at
from daemon.wbc import moving
from daemon.wbc.impedance import Easing, ImpedanceOutput

PERIOD = 0.002


def test_a_robot_that_does_what_it_is_told_is_where_it_is_desired() -> None:
    output = ImpedanceOutput(1, PERIOD)
    position, velocity = np.zeros(1), np.zeros(1)
    output.start(position, velocity)
    for cycle in range(2000):
        acceleration = np.array([np.sin(0.01 * cycle)])
        output.advance(acceleration, position, velocity)
        velocity = velocity + PERIOD * acceleration
        position = position + PERIOD * velocity
        assert output.velocity == pytest.approx(velocity, abs=2e-3)
        assert output.position == pytest.approx(position, abs=1e-3)


def test_a_constant_error_of_the_model_does_not_pile_up() -> None:
    output = ImpedanceOutput(1, PERIOD, leak=20.0, within=1.0)
    still = np.zeros(1)
    for _ in range(5000):
        output.advance(np.array([2.0]), still, still)
    assert output.velocity == pytest.approx([2.0 / 20.0], rel=1e-2)
    assert output.position == pytest.approx([2.0 / 20.0**2], rel=1e-2)


def test_it_never_leads_the_robot_further_than_it_may_and_takes_nothing_that_is_no_number() -> None:
    output = ImpedanceOutput(2, PERIOD, leak=0.0, within=0.03)
    still = np.zeros(2)
    for _ in range(1000):
        output.advance(np.array([50.0, -50.0]), still, still)
    assert output.position == pytest.approx([0.03, -0.03])
    before = output.position.copy()
    output.advance(np.array([np.nan, 0.0]), still, still)
    output.advance(np.zeros(2), np.array([np.inf, 0.0]), still)
    assert output.position == pytest.approx(before)


def test_a_leak_faster_than_the_period_is_refused() -> None:
    with pytest.raises(ValueError, match="leak: got 600"):
        ImpedanceOutput(1, PERIOD, leak=600.0)


def test_a_solution_that_jumps_is_told_step_by_step_and_within_its_bounds_where_it_is_damped() -> None:
    """One joint of 1 kg m² and 10 N·m rated: its solution jumps by 3 N·m, a share of 1 % is let go in a cycle of 2 ms."""
    solver = {"settings": np.zeros((1, at.SETTINGS_WIDTH)), "bound": np.array([[-1e3], [1e3]]), "mass": np.eye(1)}
    easing, drives = Easing(np.array([10.0]), solver, 0.002), ImpedanceOutput(1, 0.002)  # type: ignore[arg-type]
    row, table, mode = np.zeros(1, np.int64), np.zeros((5, 1)), np.zeros(1, np.uint8)

    def told(solved: float) -> float:
        solution = (np.full((2, 1), solved), row, *easing.arguments)
        moving.tell(drives.desired, *drives.settings, *solution, np.zeros((4, 1)), np.ones((2, 1)), row, 0, table, mode)
        return float(table[2, 0])

    easing.start()
    assert [told(1.0), told(1.05), told(4.05), told(1.05)] == [1.0, 1.05, 4.05, 1.05], "nothing is damped"
    solver["settings"][0, at.DAMPING] = 0.1
    steps = np.diff([told(1.05), *(told(4.05) for _ in range(40))])
    assert steps.max() == pytest.approx(0.1)
    assert (steps > 0.0).sum() == 30
    assert told(4.05) == 4.05
    assert told(1.0) == pytest.approx(3.95)
    solver["bound"][1] = 2.0
    assert told(1.0) == pytest.approx(2.0), "a bound holds at once"
