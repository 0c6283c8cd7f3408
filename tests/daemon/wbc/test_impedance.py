"""Desired positions that go with torques."""

import numpy as np
import pytest

from daemon.wbc.impedance import ImpedanceOutput

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
