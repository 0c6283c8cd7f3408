"""Two linear actuators that move pitch and roll together: exact geometry, torques, limits, and a world that runs on it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.drives.lifecycle import DriveError, State
from hal.joint import Mode
from hal.plant.actuator import Actuators
from hal.plant.actuator_model import actuators_of, sized_for
from hal.plant.merge import rotation_from_rpy
from hal.plant.transmission import ParallelTransmission, transmissions_of
from hal.plant.world import World
from handrail.robot.description import Actuator, ParallelPair

ANKLE = ParallelPair(
    name="ankle",
    pitch="arm_right_6_joint",
    roll="arm_right_7_joint",
    fixed_ends=((-0.05, 0.045, 0.25), (-0.05, -0.045, 0.25)),
    moving_ends=((-0.06, 0.04, -0.03), (-0.06, -0.04, -0.03)),
)
ANGLES = st.tuples(st.floats(-0.6, 0.6), st.floats(-0.4, 0.4))


@pytest.mark.parametrize("pitch_first", [True, False])
@settings(max_examples=40, deadline=None)
@given(angles=ANGLES)
def test_a_rods_length_is_the_distance_of_its_ends(pitch_first, angles):
    pitch, roll = angles
    about_y, about_x = rotation_from_rpy(0, pitch, 0), rotation_from_rpy(roll, 0, 0)
    rotation = about_y @ about_x if pitch_first else about_x @ about_y
    ends = zip(ANKLE.fixed_ends, ANKLE.moving_ends, strict=True)
    expected = [np.linalg.norm(rotation @ np.array(moving) - np.array(fixed)) for fixed, moving in ends]
    lengths = ParallelTransmission(ANKLE, pitch_first=pitch_first).lengths(pitch, roll)
    np.testing.assert_allclose(lengths, expected, rtol=1e-12)


@pytest.mark.parametrize("pitch_first", [True, False])
@settings(max_examples=40, deadline=None)
@given(angles=ANGLES)
def test_angles_come_back_from_lengths_and_the_jacobian_is_the_lengths_slope(pitch_first, angles):
    transmission = ParallelTransmission(ANKLE, pitch_first=pitch_first)
    np.testing.assert_allclose(transmission.angles(transmission.positions(*angles)), angles, atol=1e-9)
    step, jacobian = 1e-6, transmission.jacobian(*angles)
    for column in range(2):
        ahead, behind = (np.array(angles) + sign * step * np.eye(2)[column] for sign in (1, -1))
        slope = (transmission.positions(*ahead) - transmission.positions(*behind)) / (2 * step)
        np.testing.assert_allclose(jacobian[:, column], slope, atol=1e-8)


def test_lengths_that_no_angles_have_are_refused():
    transmission = ParallelTransmission(ANKLE)
    with pytest.raises(ValueError, match=r"parallel_pairs\.ankle: no angles"):
        transmission.angles(transmission.positions(0, 0) + 10.0)


def test_rods_that_cannot_tell_pitch_from_roll_are_refused(robot):
    both_left = ParallelPair(
        name="twins",
        pitch=ANKLE.pitch,
        roll=ANKLE.roll,
        fixed_ends=(ANKLE.fixed_ends[0], ANKLE.fixed_ends[0]),
        moving_ends=(ANKLE.moving_ends[0], ANKLE.moving_ends[0]),
    )
    with pytest.raises(ValueError, match=r"parallel_pairs\.twins: its rods cannot move pitch and roll apart"):
        transmissions_of(dataclasses.replace(robot, parallel_pairs=(both_left,)))
    apart = ParallelPair(
        name="apart",
        pitch="head_1_joint",
        roll="arm_left_7_joint",
        fixed_ends=ANKLE.fixed_ends,
        moving_ends=ANKLE.moving_ends,
    )
    with pytest.raises(ValueError, match=r"parallel_pairs\.apart: .* not on one chain"):
        transmissions_of(dataclasses.replace(robot, parallel_pairs=(apart,)))


def _pair(angles: tuple[float, float], rated: float = 40.0) -> Actuators:
    transmission = ParallelTransmission(ANKLE)
    actuators = Actuators(sized_for(np.full(2, rated)), pairs=((0, 1, transmission),))
    actuators.torque_limit[:] = 1e3
    actuators.mode[:], actuators.powered[:] = Mode.TORQUE, True
    actuators.relax(np.array(angles))
    return actuators


def _settle(actuators: Actuators, angles: tuple[float, float]) -> np.ndarray:
    for _ in range(400):
        actuators.step(np.array(angles), np.zeros(2), 5)
    return actuators.spring_torque.copy()


@pytest.mark.parametrize("angles", [(0.0, 0.0), (0.4, -0.2), (-0.5, 0.3)])
def test_the_two_actuators_together_give_the_joints_the_torques_that_were_asked_for(angles):
    actuators = _pair(angles)
    actuators.torque[:] = 12.0, -7.0
    np.testing.assert_allclose(_settle(actuators, angles), [12.0, -7.0], rtol=1e-3)
    np.testing.assert_allclose(actuators.measured_torque, [12.0, -7.0], rtol=1e-3)
    # Each motor does its share: J⁻ᵀ τ.
    force = np.linalg.solve(ParallelTransmission(ANKLE).jacobian(*angles).T, [12.0, -7.0])
    np.testing.assert_allclose(actuators.current * actuators.model.torque_per_current, force, atol=0.3)


def test_the_limits_are_the_actuators_and_the_torques_keep_their_direction():
    transmission = ParallelTransmission(ANKLE)
    rated = transmission.rated(30.0, 20.0)
    actuators = _pair((0.0, 0.0), rated)
    for pitch, roll in ((30.0, 0.0), (0.0, 20.0)):  # either joint alone: all of it
        actuators.torque[:] = pitch, roll
        np.testing.assert_allclose(_settle(actuators, (0.0, 0.0)), [pitch, roll], atol=0.05)
    actuators.torque[:] = 30.0, 20.0
    torque = _settle(actuators, (0.0, 0.0))
    force = np.linalg.solve(transmission.jacobian(0.0, 0.0).T, torque)
    assert np.abs(force).max() == pytest.approx(rated, rel=1e-3)
    assert torque[1] / torque[0] == pytest.approx(20.0 / 30.0, rel=1e-3)
    assert torque[0] < 20.0
    assert actuators.limited.all()


@pytest.fixture
def wrist(robot, kinematics, host):
    """A host that has enabled a robot whose wrist is a parallel one, and the wrist's rows."""
    rows = robot.index([ANKLE.pitch, ANKLE.roll])
    lower, upper = robot.lower.copy(), robot.upper.copy()
    lower[rows], upper[rows] = (-0.7, -0.5), (0.7, 0.5)
    robot = dataclasses.replace(robot, parallel_pairs=(ANKLE,), lower=lower, upper=upper)
    model, (transmission,) = actuators_of(robot)
    assert model.torque_limit[rows[0]] == pytest.approx(transmission.rated(*robot.torque_limit[rows]))
    world = World(robot)
    host = type(host)(world, kinematics)
    host.enable()
    yield host, rows
    world.close()


def test_a_robot_with_a_parallel_wrist_holds_it_and_moves_it(wrist):
    host, rows = wrist
    world, start = host.world, host.world.position.copy()
    for cycle in range(400):
        host.command.position[rows] = start[rows] + np.array([0.3, -0.2]) * min(1.0, cycle / 200)
        host.cycle()
    np.testing.assert_allclose(world.position[rows] - start[rows], [0.3, -0.2], atol=0.02)
    others = np.delete(np.arange(len(start)), rows)
    np.testing.assert_allclose(world.position[others], start[others], atol=0.01)


@pytest.mark.parametrize("broken", [0, 1])
def test_where_one_of_two_actuators_fails_the_other_brakes_too(wrist, broken):
    host, rows = wrist
    drives = host.world.drives
    drives.fail(rows[broken], DriveError.ENCODER)
    host.cycle()
    assert drives.brakes[rows].all(), "a joint without torque behind an open brake"
    assert (drives.state[rows] == State.FAULT).all()
    assert drives.error[rows[broken]] == DriveError.ENCODER
    assert drives.error[rows[1 - broken]] == DriveError.INTERNAL
    others = np.delete(np.arange(len(drives)), rows)
    assert (drives.state[others] == State.OPERATION_ENABLED).all()


def test_a_pairs_loops_cannot_close_on_the_motors(robot):
    row = robot.index(ANKLE.roll)
    actuators = tuple(Actuator(servo="motor" if j == row else "joint") for j in range(len(robot.joints)))
    wrong = dataclasses.replace(robot, parallel_pairs=(ANKLE,), actuators=actuators)
    with pytest.raises(ValueError, match=r"actuators\.arm_right_7_joint\.servo: got motor; expected joint"):
        actuators_of(wrong)
