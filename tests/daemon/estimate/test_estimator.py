"""The base's estimate, judged by the plant."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pinocchio as pin
import pytest

from daemon.state.estimator import HOLDS, BaseEstimator, BaseSource, BaseState, Trouble, can_estimate
from daemon.state.invariant_filter import GRAVITY
from hal.device import DeviceState
from hal.joint import JointState
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics
from tests.daemon.estimate.conftest import ENABLED_MS, Run

LANDED, STANDS = 100, 400
"""cycles after which it is on its feet, on its brakes; and by its drives"""
NEAR, TILT = 0.003, math.radians(0.2)
"""m, rad"""
WEIGHT = 911.0
"""N"""


def _away(state: BaseState, tape, cycle: int) -> tuple[float, float]:
    """(m, rad): position and orientation from the plant's."""
    turned = abs(float(np.dot(state.pose[3:], tape.orientation[cycle])))
    return float(np.linalg.norm(state.pose[:3] - tape.position[cycle])), 2.0 * math.acos(min(1.0, turned))


def _disagreements(run: Run, first: int = 0) -> int:
    """Cycles: the longest time for which a foot's flag said what was not the case, feet that hardly touch the floor aside."""
    flags = np.array([state.contact for state in run.states()], bool)
    force = np.array(run.tape.force)
    wrong = (flags & (force == 0.0)) | (~flags & (force > HOLDS * WEIGHT))
    longest = 0
    for foot in range(flags.shape[1]):
        now = 0
        for cycle in range(first, len(wrong)):
            now = now + 1 if wrong[cycle, foot] else 0
            longest = max(longest, now)
    return longest


def test_the_base_is_where_the_plant_has_it_while_it_lands_is_pushed_from_foot_to_foot_sways_and_falls(played):
    force, position = np.array(played.tape.force), np.array(played.tape.position)
    assert ((force[LANDED:] == 0.0).sum(axis=0) > 10).all(), "each foot leaves the floor"
    assert np.ptp(position[LANDED:, 0]) > 0.05, "it sways"
    away = [_away(state, played.tape, cycle) for cycle, state in enumerate(played.states())]
    place, turned = np.max(away[LANDED:], axis=0)
    assert place < NEAR
    assert turned < TILT
    assert np.max([place for place, _ in away]) < 2 * NEAR, "and while it falls"


def test_deviations_are_what_errors_are(played):
    for cycle in range(LANDED, len(played.memory), 50):
        state = played.states()[cycle]
        place, turned = _away(state, played.tape, cycle)
        assert place < 3 * state.sigma[0] < 0.05
        assert turned < 3 * state.sigma[1] < 0.1


def test_the_twist_is_the_plants_and_better_than_the_difference_of_positions(played):
    told = np.array([state.twist for state in played.states()])[LANDED:]
    true = np.array(played.tape.twist)[LANDED:]
    error = np.sqrt(((told - true) ** 2).mean(axis=0))
    assert (error[:3] < 0.01).all()
    assert (error[3:] < 0.01).all()
    assert np.abs(true[:, 1]).max() > 0.05, "it moves"


def test_contacts_are_the_plants_but_for_three_cycles_of_make_and_break(played):
    assert _disagreements(played) <= 3
    forces = np.array([state.force[:, 2] for state in played.states()])[LANDED:]
    assert np.abs(forces - np.array(played.tape.force)[LANDED:]).mean() < 0.01 * WEIGHT


def test_without_foot_sensors_the_joints_tell_the_contacts(run):
    ankles = [run.row["ankle_right_ft"], run.row["ankle_left_ft"]]

    def spoil() -> None:
        run.devices.age[ankles], run.devices.values[ankles] = 1000, 0.0

    run.play(spoil=spoil)
    assert _disagreements(run, STANDS) <= 40
    forces = np.array([state.force[:, 2] for state in run.states()])[STANDS:]
    truth = np.array(run.tape.force)[STANDS:]
    assert (truth == 0.0).any(), "a foot leaves the floor"
    assert np.abs(forces - truth).mean() < 0.05 * WEIGHT
    before = np.array([state.contact for state in run.states()])[: ENABLED_MS // 2]
    assert not before.any(), "brakes bear what springs do not"
    start, end = (np.array([*run.states()[at].pose[:3]]) - run.tape.position[at] for at in (STANDS, 650))
    assert np.linalg.norm(end - start) < 0.01, "from where the drives took over"


def test_an_imu_that_falls_silent_is_told_with_reason_and_time_and_taken_up_again_where_the_robot_was(run):
    imu = run.row["torso_imu"]
    run.play(0, 480)
    assert run.state.source[0] == BaseSource.FEET

    def silent() -> None:
        run.devices.age[imu] = 11

    run.play(480, 520, silent)
    assert (run.state.source[0], run.state.trouble[0]) == (BaseSource.NONE, Trouble.IMU_SILENT)
    assert run.state.since_ns[0] == run.tape.time_ns[480]
    assert run.state.contact.tolist() == [1, 1], "what the feet feel is known all the same"
    run.play(520, 550)
    assert run.state.source[0] == BaseSource.FEET
    assert run.state.since_ns[0] < run.tape.time_ns[530]
    place, turned = _away(run.state, run.tape, 549)
    assert turned < 3 * run.state.sigma[1], "it sways: gravity is not all that is felt"
    run.play(550, 650)
    gone_on = float(np.linalg.norm(run.tape.position[520] - run.tape.position[480]))
    place, turned = _away(run.state, run.tape, 649)
    assert place < gone_on + 0.003, "how far it went meanwhile nobody knows"
    assert turned < 0.01


def test_an_imu_that_measures_no_numbers_is_told_and_leaves_none_in_the_estimate(run):
    def nonsense() -> None:
        run.devices.values[run.row["torso_imu"], 8] = np.nan

    run.play(0, 150)
    run.play(150, 160, nonsense)
    assert (run.state.source[0], run.state.trouble[0]) == (BaseSource.NONE, Trouble.IMU_NOT_FINITE)
    run.play(160, 220)
    assert run.state.source[0] == BaseSource.FEET
    assert np.isfinite(run.state.memory.view(float)[:21]).all()
    place, turned = _away(run.state, run.tape, 219)
    assert place < 0.01
    assert turned < 3 * run.state.sigma[1]


@pytest.mark.parametrize(
    ("joint", "source"), [("leg_left_4_joint", BaseSource.FEET), ("torso_1_joint", BaseSource.NONE)]
)
def test_a_leg_whose_drive_is_silent_carries_no_estimate_and_a_torso_takes_it_away(run, standing, joint, source):
    row = standing.description.index(joint)

    def silent() -> None:
        run.joints.age[row] = 100
        run.joints.position[row] = 0.0

    run.play(0, 450)
    run.play(450, 550, silent)
    assert run.state.source[0] == source
    if source is BaseSource.FEET:
        assert max(_away(run.state, run.tape, 549)) < 0.01
    else:
        assert run.state.trouble[0] == Trouble.JOINT_SILENT


def test_a_robot_that_hangs_still_does_not_drift_though_its_accelerometer_is_off(standing):
    joints, devices = JointState(len(standing.description.joints)), DeviceState(len(standing.description.devices))
    joints.age[:] = devices.age[:] = 0
    joints.position[:] = standing.description.home_position()
    estimator = BaseEstimator(standing, joints, devices, 0.002)
    devices.values[0, 7:10] = 0.02, -0.01, -GRAVITY - 0.02  # its frame is mounted upside down
    for cycle in range(5000):
        estimator.update(cycle * 2_000_000)
    assert estimator.state.source[0] == BaseSource.STILL
    assert estimator.state.contact.tolist() == [0, 0]
    assert np.linalg.norm(estimator.state.pose[:3]) < 0.005
    assert np.linalg.norm(estimator.state.twist) < 0.005


def test_a_torso_that_swings_with_the_imu_on_it_does_not_move_the_base(standing):
    robot, model = standing.description, standing.model
    joints, devices = JointState(len(robot.joints)), DeviceState(len(robot.devices))
    joints.age[:] = devices.age[:] = 0
    joints.position[:] = robot.home_position()
    estimator, data = BaseEstimator(standing, joints, devices, 0.002), model.createData()
    rows, frame = robot.index(["torso_1_joint", "torso_2_joint"]), standing.frame_id("imu_link")
    columns, swing, speed = standing.index_v[rows], np.array([0.3, 0.15]), 2.0 * math.pi * 0.5
    velocity, acceleration = np.zeros(model.nv), np.zeros(model.nv)
    worst = np.zeros(3)
    for cycle in range(1500):
        phase = speed * max(0, cycle - 300) * 0.002
        joints.position[rows] = swing * (1.0 - math.cos(phase)) / 2
        joints.velocity[rows] = velocity[columns] = swing * speed * math.sin(phase) / 2
        acceleration[columns] = swing * speed**2 * math.cos(phase) / 2 if cycle > 300 else 0.0
        pin.forwardKinematics(model, data, standing.configuration(joints.position), velocity, acceleration)
        pin.updateFramePlacement(model, data, frame)
        rotation = data.oMf[frame].rotation
        devices.values[0, 4:7] = pin.getFrameVelocity(model, data, frame, pin.LOCAL).angular
        felt = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL).linear
        devices.values[0, 7:10] = felt + rotation.T @ [0.0, 0.0, GRAVITY]
        estimator.update(cycle * 2_000_000)
        base = estimator.state
        away = np.linalg.norm(base.pose[:3]), np.linalg.norm(base.pose[3:6]), np.linalg.norm(base.twist)
        worst = np.maximum(worst, away if cycle > 300 else 0.0)
    assert (worst < (0.003, 0.003, 0.02)).all()
    assert estimator.state.source[0] == BaseSource.STILL


def test_a_robot_that_falls_with_no_foot_on_the_ground_says_that_errors_grow(played):
    states = played.states()
    assert states[2].source[0] == BaseSource.INERTIAL
    assert states[12].sigma[0] > states[2].sigma[0]


def test_an_estimate_begins_where_the_robot_is_at_rest_alone(run):
    def shaken() -> None:
        run.devices.values[run.row["torso_imu"], 7:10] = 0.0, 3.0, -12.0

    run.play(0, 5, shaken)
    assert (run.state.source[0], run.state.trouble[0]) == (BaseSource.NONE, Trouble.NOT_AT_REST)
    run.play(150, 160)
    assert run.state.trouble[0] == Trouble.NONE


def test_cycles_that_were_missed_are_gone_through_by_their_time(run):
    """As on a wall clock that is overrun: every third cycle does not happen, in the fall and while it is pushed."""
    for cycle in range(STANDS):
        if cycle % 3:
            run.play(cycle, cycle + 1)
    place, turned = _away(run.state, run.tape, STANDS - 1)
    assert place < 0.01
    assert turned < 0.01


def test_the_same_tape_gives_the_same_bits(run, played):
    run.play(0, 400)
    np.testing.assert_array_equal(run.memory, played.memory[:400])


@pytest.mark.parametrize("name", ["talos_upper", "panda", "z1"])
def test_a_robot_on_a_fixed_base_has_no_estimator(name):
    robot = robots.load(name)
    assert not can_estimate(robot)
    with pytest.raises(ValueError, match="expected a free base, an inertial sensor"):
        BaseEstimator(Kinematics(robot), JointState(1), DeviceState(1), 0.002)
    fixed = BaseState()
    assert fixed.source[0] == BaseSource.FIXED
    np.testing.assert_array_equal(fixed.pose, [0, 0, 0, 0, 0, 0, 1])


def test_a_free_robot_without_feet_has_none_either(standing):
    assert not can_estimate(dataclasses.replace(standing.description, feet=()))
