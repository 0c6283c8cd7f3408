"""The actuators' firmware: bandwidth, modes, saturation."""

from __future__ import annotations

import numpy as np
import pytest

from hal.joint import Mode
from hal.plant.actuator import CURRENT_RESERVE, FIRMWARE_HZ, GEAR_RATIO, TORQUE_CONSTANT, Actuators, springs_for


def _bandwidth(**loop: bool) -> float:
    """Hz: where the spring's torque falls 3 dB below its set-point, output locked."""
    frequencies = np.concatenate([np.arange(2.0, 30.0, 1.0), np.arange(30.0, 110.0, 2.0)])
    n, amplitude, settle = len(frequencies), 10.0, FIRMWARE_HZ // 2
    actuators = Actuators(springs_for(np.full(n, 175.0)), **loop)
    actuators.mode[:], actuators.powered[:] = Mode.TORQUE, True
    still, response = np.zeros(n), np.zeros(n, complex)
    for cycle in range(2 * settle):
        time = cycle / FIRMWARE_HZ
        actuators.torque[:] = amplitude * np.sin(2 * np.pi * frequencies * time)
        torque = actuators.step(still, still, 1)
        if cycle >= settle:
            response += torque * np.exp(-2j * np.pi * frequencies * time)
    gain = np.abs(response) * 2 / settle / amplitude
    return float(frequencies[np.flatnonzero(gain < 10 ** (-3 / 20))[0]])


def test_the_torque_loop_reaches_seventy_hertz_where_the_open_loop_reaches_fourteen():
    assert _bandwidth(feedback=False, observer=False) == pytest.approx(14, abs=1)
    assert _bandwidth() == pytest.approx(70, abs=4)


def _settled(actuators: Actuators, position: np.ndarray, disturbance: float = 0.0) -> np.ndarray:
    still = np.zeros(len(actuators))
    for _ in range(500):
        actuators.step(position, still, 5)
    return actuators.spring_torque.copy()


def _one(mode: Mode, limit: float = 100.0) -> Actuators:
    actuators = Actuators(springs_for(np.array([limit])))
    actuators.mode[:], actuators.powered[:] = mode, True
    return actuators


def test_torque_mode_gives_the_torque_that_is_asked_for():
    actuators = _one(Mode.TORQUE)
    actuators.torque[:] = 37.0
    assert _settled(actuators, np.zeros(1))[0] == pytest.approx(37.0, rel=0.01)


def test_the_observer_takes_out_what_proportional_control_leaves():
    """A spring that is already wound up by friction-like offsets leaves an error without the observer."""
    errors = []
    for observer in (False, True):
        actuators = Actuators(springs_for(np.array([100.0])), observer=observer)
        actuators.mode[:], actuators.powered[:] = Mode.TORQUE, True
        velocity, position, peak = np.zeros(1), np.zeros(1), 0.0
        for step in range(2000):  # zero torque is asked for while something moves the joint at 2 Hz
            angle = 2 * np.pi * 2 * step * 1e-3
            position[:], velocity[:] = 0.2 * np.sin(angle), 0.2 * 4 * np.pi * np.cos(angle)
            actuators.step(position, velocity, 5)
            peak = max(peak, abs(actuators.spring_torque[0])) if step > 1000 else 0.0
        errors.append(peak)
    assert errors[1] < 0.6 * errors[0]


def test_impedance_mode_is_torque_plus_stiffness_plus_damping():
    actuators = _one(Mode.IMPEDANCE)
    actuators.position[:], actuators.stiffness[:], actuators.torque[:] = 0.3, 50.0, 4.0
    assert _settled(actuators, np.array([0.1]))[0] == pytest.approx(4.0 + 50.0 * 0.2, rel=0.01)
    actuators.velocity[:], actuators.damping[:] = 0.5, 6.0
    assert _settled(actuators, np.array([0.1]))[0] == pytest.approx(4.0 + 50.0 * 0.2 + 6.0 * 0.5, rel=0.01)


def test_damping_mode_works_against_the_velocity_and_ignores_the_set_point():
    actuators = _one(Mode.DAMPING)
    actuators.damping[:], actuators.torque[:], actuators.stiffness[:] = 5.0, 90.0, 900.0
    actuators.relax(np.zeros(1))
    position, velocity = np.zeros(1), np.full(1, 0.4)
    for _ in range(500):
        actuators.step(position, velocity, 5)
        position += velocity * 1e-3
    assert actuators.goal[0] == pytest.approx(-2.0)
    assert actuators.spring_torque[0] == pytest.approx(-2.0, rel=0.1)


def test_torque_saturates_at_the_rated_torque_and_current_at_its_limit():
    actuators = _one(Mode.TORQUE, limit=20.0)
    actuators.torque[:] = 1e6
    largest = 0.0
    for _ in range(500):
        actuators.step(np.zeros(1), np.zeros(1), 5)
        largest = max(largest, actuators.current[0])
    assert actuators.spring_torque[0] == pytest.approx(20.0, rel=0.01)
    assert largest <= CURRENT_RESERVE * 20.0 / (GEAR_RATIO * TORQUE_CONSTANT) + 1e-9


def test_without_power_the_spring_goes_slack():
    actuators = _one(Mode.TORQUE)
    actuators.torque[:] = 37.0
    _settled(actuators, np.zeros(1))
    actuators.powered[:] = False
    assert abs(_settled(actuators, np.zeros(1))[0]) < 0.01


def test_position_mode_ends_at_its_goal_although_gravity_pulls(host):
    host.enable()
    world = host.world
    goal = world.position.copy()
    goal[world.description.index("arm_right_4_joint")] += 0.3
    host.command.mode[:], host.command.torque[:] = Mode.POSITION, 0.0
    start = world.position.copy()
    for cycle in range(1500):  # no gravity torque from the host: the drives' integrators find it
        share = min(1.0, cycle / 500)
        host.command.position[:] = start + share * (goal - start)
        world.drives.command(host.command)
        world.advance(2)
    np.testing.assert_allclose(world.position, goal, atol=0.01)
