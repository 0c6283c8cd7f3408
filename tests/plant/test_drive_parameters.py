"""Single values of an emulated drive: what reading and writing them does, and when it is refused."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from hal.drives.lifecycle import INTERNAL_LIMIT, WARNING, DriveError, State
from hal.drives.parameters import DICTIONARY, PROTOCOL_VERSION, Parameter, ParameterResult
from hal.joint import Mode
from hal.plant.actuator import Actuators
from hal.plant.drive_node import AMBIENT, BUS_VOLTAGE, DriveNodes
from hal.plant.world import World
from handrail.robot.description import Actuator

OK, OUT_OF_RANGE = ParameterResult.OK, ParameterResult.OUT_OF_RANGE
ROW = 3
"""arm_right_4_joint: 70 N·m, −2.23..0.003 rad"""


@pytest.fixture
def drives(robot) -> DriveNodes:
    nodes = DriveNodes(robot, Actuators.of(robot))
    nodes.actuators.relax(np.zeros(len(nodes)))
    return nodes


def test_every_readable_entry_of_the_dictionary_can_be_read_and_every_writable_one_written_back(drives):
    for parameter, entry in DICTIONARY.items():
        if not entry.readable:
            with pytest.raises(KeyError):
                drives.read_parameter(ROW, parameter)
            continue
        value = float(np.float32(drives.read_parameter(ROW, parameter)))  # as the bus carries it
        expected = OK if entry.writable else ParameterResult.READ_ONLY
        assert drives.write_parameter(ROW, parameter, value) is expected, parameter
        assert drives.read_parameter(ROW, parameter) == pytest.approx(value, rel=1e-6)


def test_a_drive_says_who_it_is(drives):
    serials = {drives.read_parameter(row, Parameter.SERIAL) for row in range(len(drives))}
    assert len(serials) == len(drives)
    assert all(float(np.float32(serial)) == serial for serial in serials)
    assert drives.read_parameter(ROW, Parameter.PROTOCOL_VERSION) == PROTOCOL_VERSION
    assert drives.read_parameter(ROW, Parameter.MOTOR_TEMPERATURE) == AMBIENT
    assert drives.read_parameter(ROW, Parameter.BUS_VOLTAGE) == BUS_VOLTAGE


@pytest.mark.parametrize(
    ("parameter", "good", "bad"),
    [
        (Parameter.TORQUE_KP, 30.0, -1.0),
        (Parameter.TORQUE_KD, 0.1, 5.0),
        (Parameter.OBSERVER_HZ, 0.0, 1000.0),
        (Parameter.POSITION_KP, 12.0, -1.0),
        (Parameter.CURRENT_LIMIT, 9.0, 1000.0),
        (Parameter.TORQUE_LIMIT, 21.0, 70.1),
        (Parameter.VELOCITY_LIMIT, 0.5, 0.0),
        (Parameter.POSITION_LOWER, -1.0, 0.5),
        (Parameter.POSITION_UPPER, -0.5, 0.1),
        (Parameter.TEMPERATURE_WARNING, 60.0, 95.0),
        (Parameter.TEMPERATURE_LIMIT, 85.0, 200.0),
        (Parameter.ENCODER_OFFSET, 0.01, 100.0),
        (Parameter.TORQUE_OFFSET, -0.5, 71.0),
        (Parameter.INJECT_ERROR, 4.0, 0.0),
        (Parameter.INJECT_ERROR, 4.0, 99.0),
    ],
)
def test_what_is_out_of_range_is_refused_and_changes_nothing(drives, parameter, good, bad):
    readable = DICTIONARY[parameter].readable
    before = drives.read_parameter(ROW, parameter) if readable else None
    for value in (bad, float("nan"), float("inf")):
        assert drives.write_parameter(ROW, parameter, value) is OUT_OF_RANGE
    if readable:
        assert drives.read_parameter(ROW, parameter) == before
    assert drives.error[ROW] == DriveError.NONE
    assert drives.write_parameter(ROW, parameter, good) is OK
    if readable:
        assert drives.read_parameter(ROW, parameter) == pytest.approx(good)
        others = [row for row in range(len(drives)) if row != ROW]
        assert good not in [drives.read_parameter(row, parameter) for row in others]


def test_an_index_that_is_not_in_the_dictionary_is_unknown(drives):
    assert drives.write_parameter(ROW, 0x66, 1.0) is ParameterResult.UNKNOWN
    with pytest.raises(KeyError, match="0x66: unknown"):
        drives.read_parameter(ROW, 0x66)


def test_an_injected_error_faults_the_drive(host):
    host.enable()
    drives = host.world.drives
    assert drives.write_parameter(ROW, Parameter.INJECT_ERROR, float(DriveError.ENCODER)) is OK
    assert drives.state[ROW] == State.FAULT
    assert drives.error[ROW] == DriveError.ENCODER
    assert drives.brakes[ROW]


def test_tuning_and_calibration_wait_until_the_drive_is_out_of_operation(host):
    host.enable()
    drives = host.world.drives
    for parameter in (
        Parameter.TORQUE_KP,
        Parameter.OBSERVER_HZ,
        Parameter.POSITION_KP,
        Parameter.POSITION_KD,
        Parameter.POSITION_KI,
        Parameter.ENCODER_OFFSET,
        Parameter.TORQUE_OFFSET,
        Parameter.CALIBRATE,
    ):
        assert drives.write_parameter(ROW, parameter, 0.01) is ParameterResult.WRONG_STATE
    assert drives.write_parameter(ROW, Parameter.TORQUE_LIMIT, 30.0) is OK


def test_no_parameter_that_is_written_in_operation_moves_the_joint(host):
    host.command.mode[:] = Mode.POSITION
    host.enable()
    host.cycle(200)
    world, drives = host.world, host.world.drives
    before = world.position.copy()
    elbow = float(before[ROW])
    for parameter, value in ((Parameter.POSITION_KP, 1e9), (Parameter.POSITION_KI, 1e9), (Parameter.POSITION_KD, 1e9)):
        assert drives.write_parameter(ROW, parameter, value) is ParameterResult.WRONG_STATE
    upper = float(drives.actuators.upper[ROW])
    for parameter, value in ((Parameter.POSITION_UPPER, elbow - 0.2), (Parameter.POSITION_LOWER, (elbow + upper) / 2)):
        assert drives.write_parameter(ROW, parameter, value) is ParameterResult.WRONG_STATE
    host.cycle(50)
    np.testing.assert_allclose(world.position, before, atol=2e-3)


def test_an_encoder_that_was_mounted_askew_is_calibrated_and_then_reads_right(robot):
    actuators = list(robot.actuators)
    actuators[ROW] = Actuator(encoder_offset=0.2)
    world = World(dataclasses.replace(robot, actuators=tuple(actuators)))
    try:
        drives, reading = world.drives, world.drives.actuators.measured_position
        world.advance(5)
        true = world.position[ROW]
        assert reading[ROW] - true == pytest.approx(0.2, abs=1e-4)
        assert drives.write_parameter(ROW, Parameter.CALIBRATE, float(true)) is OK
        assert drives.read_parameter(ROW, Parameter.ENCODER_OFFSET) == pytest.approx(-0.2, abs=1e-4)
        world.advance(5)
        np.testing.assert_allclose(reading, world.position, atol=1e-4)
        assert abs(drives.actuators.measured_velocity[ROW]) < 0.01  # it did not look like a movement
    finally:
        world.close()


def test_a_narrower_torque_limit_acts_and_the_statusword_says_so(host):
    host.enable()
    drives = host.world.drives
    needed = abs(drives.actuators.goal[ROW])
    assert needed > 4.0
    assert not drives.flags[ROW] & INTERNAL_LIMIT
    assert drives.write_parameter(ROW, Parameter.TORQUE_LIMIT, needed / 2) is OK
    host.cycle(10)
    assert abs(drives.actuators.goal[ROW]) == pytest.approx(needed / 2)
    assert drives.flags[ROW] & INTERNAL_LIMIT


def test_a_hot_motor_warns_then_gives_less_and_too_hot_a_one_faults(host):
    host.enable()
    drives = host.world.drives
    drives.temperature[ROW] = 81.0
    host.cycle()
    assert drives.flags[ROW] & WARNING
    assert not drives.flags[ROW - 1] & WARNING
    host.command.mode[ROW], host.command.stiffness[ROW] = Mode.TORQUE, 0.0
    limit = host.world.description.torque_limit[ROW]
    drives.temperature[ROW] = 80.0 + 15.0 * 0.9  # nine tenths of the way from warning to limit
    host.kinematics = _Push(host.kinematics, ROW, 2 * limit)
    host.cycle()
    assert abs(drives.actuators.goal[ROW]) == pytest.approx(0.1 * limit, rel=0.02)
    drives.temperature[ROW] = 95.5
    host.cycle()
    assert drives.state[ROW] == State.FAULT
    assert drives.error[ROW] == DriveError.OVERTEMPERATURE


class _Push:
    """A model whose gravity wants one joint to push."""

    def __init__(self, kinematics, row: int, torque: float):
        self._kinematics, self._row, self._torque = kinematics, row, torque

    def gravity(self, position):
        found = self._kinematics.gravity(position)
        found[self._row] = -self._torque
        return found


def test_a_motor_heats_up_with_its_current_and_cools_without(host):
    host.enable()
    drives = host.world.drives
    host.cycle(1)
    row = int(np.argmax(np.abs(drives.actuators.current / drives.actuators.current_limit)))
    before = drives.temperature.copy()
    host.cycle(500)
    assert drives.temperature[row] > before[row]
    drives.switch_off()
    drives.temperature[:] = 60.0
    host.world.advance(200)
    assert (drives.temperature < 60.0).all()


def test_drives_without_voltage_fault(host):
    host.enable()
    drives = host.world.drives
    drives.bus_voltage[ROW] = 20.0
    host.world.step()
    assert drives.state[ROW] == State.FAULT
    assert drives.error[ROW] == DriveError.UNDERVOLTAGE
    assert drives.brakes[ROW]
    assert drives.state[ROW + 1] == State.OPERATION_ENABLED


@pytest.mark.parametrize(("torque", "moves"), [(6.0, False), (-6.0, False), (14.0, True)])
def test_a_joints_friction_holds_it_until_the_torque_is_larger(robot, kinematics, host, torque, moves):
    torso = robot.index("torso_1_joint")  # upright: gravity does not turn it
    actuators = list(robot.actuators)
    actuators[torso] = Actuator(friction=10.0)
    world = World(dataclasses.replace(robot, actuators=tuple(actuators)))
    try:
        host = type(host)(world, kinematics)
        host.enable()
        start = world.position[torso]
        host.command.mode[torso] = Mode.TORQUE
        host.kinematics = _Push(kinematics, torso, -torque)
        host.cycle(150)
        assert (abs(world.position[torso] - start) > 0.01) == moves
        assert world.drives.actuators.spring_torque[torso] == pytest.approx(torque, rel=0.1)
    finally:
        world.close()


def test_modes_change_under_load_without_a_jerk(host):
    host.enable()
    world, drives = host.world, host.world.drives
    host.cycle(100)
    start, rated = world.position.copy(), world.description.torque_limit
    for mode in (Mode.POSITION, Mode.IMPEDANCE, Mode.TORQUE, Mode.IMPEDANCE):
        goal = drives.actuators.goal.copy()
        host.command.mode[:] = mode
        host.command.torque[:] = 0.0 if mode == Mode.POSITION else host.kinematics.gravity(world.position)
        drives.command(host.command)
        world.step()
        assert (np.abs(drives.actuators.goal - goal) / rated).max() < 0.015
        if mode == Mode.POSITION:
            for _ in range(200):
                drives.command(host.command)
                world.advance(2)
        else:
            host.cycle(50)
        np.testing.assert_allclose(world.position, start, atol=0.01)
