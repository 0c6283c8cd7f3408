"""Drives live by CiA 402, and by their own clock when nobody speaks to them."""

from __future__ import annotations

import numpy as np
import pytest

from hal.can import frames
from hal.drives.lifecycle import CONTROLWORD, Command, DriveError, State, controlword_towards, decode_statusword
from hal.drives.protocol import LimbProtocol
from hal.joint import JointState, Mode
from hal.plant.bus_node import BusNode
from hal.plant.drive_kernels import QUICK_STOP_RATE


def _all(host, command: Command) -> np.ndarray:
    return np.full(len(host.world.drives), CONTROLWORD[command], np.uint8)


def test_a_robot_stands_still_behind_closed_brakes(host):
    start = host.world.position.copy()
    host.world.advance(500)
    assert host.world.drives.brakes.all()
    np.testing.assert_allclose(host.world.position, start, atol=1e-4)


def test_set_points_are_ignored_until_operation_is_enabled(host):
    world, drives = host.world, host.world.drives
    start = world.position.copy()
    host.command.position[:] += 0.3
    for goal in (State.SWITCH_ON_DISABLED, State.READY_TO_SWITCH_ON, State.SWITCHED_ON):
        drives.control(controlword_towards(goal, drives.state))
        assert (drives.state == goal).all()
        host.cycle(20)
        assert drives.brakes.all()
        assert not drives.actuators.powered.any()
    np.testing.assert_allclose(world.position, start, atol=1e-4)


def test_a_brake_opens_only_after_a_command_and_nothing_drops(host):
    world, drives = host.world, host.world.drives
    start = world.position.copy()
    while (drives.state != State.OPERATION_ENABLED).any():
        drives.control(controlword_towards(State.OPERATION_ENABLED, drives.state))
        world.step()
    world.advance(10)
    assert drives.brakes.all()  # enabled, but nobody has said what to do
    largest = 0.0
    for _ in range(200):
        host.cycle()
        largest = max(largest, np.abs(world.position - start).max())
    assert not drives.brakes.any()
    assert largest < 1e-3


def test_silence_leads_to_hold_then_quick_stop_then_brake(host):
    host.enable()
    world, drives = host.world, host.world.drives
    host.cycle(50)
    holding = world.position.copy()
    quick_stop = brake = None
    for step in range(1, 1200):
        world.step()
        if quick_stop is None and (drives.state == State.QUICK_STOP_ACTIVE).all():
            quick_stop = step
            np.testing.assert_allclose(world.position, holding, atol=0.01)  # 20 missed cycles were held through
        if brake is None and drives.brakes.all():
            brake = step
            break
    # 20 cycles of 2 ms may be missed; the last command came 2 ms before the first step that is counted here, and the step
    # that begins 41 ms after it is the first without permission.
    assert quick_stop == 41 - 2 + 1
    assert brake is not None
    assert brake - quick_stop == 250
    assert (drives.error == DriveError.WATCHDOG).all()
    assert (drives.state == State.QUICK_STOP_ACTIVE).all()


def test_a_quick_stop_holds_softly_about_the_load_so_that_nothing_drops(host):
    host.enable()
    host.cycle(100)
    world, drives = host.world, host.world.drives
    drives.control(_all(host, Command.QUICK_STOP))
    assert (drives.state == State.QUICK_STOP_ACTIVE).all()
    assert (drives.error == DriveError.NONE).all()  # asked for, not failed
    moved, load = world.position.copy(), drives.actuators.measured_torque.copy()
    began = drives.actuators.measured_position.copy()
    assert np.abs(load).max() > 5.0
    for _ in range(1000):
        world.step()
        if drives.brakes.any():
            break
        way = drives.actuators.measured_position - began
        held = world.description.quick_stop_damping * (drives.actuators.measured_velocity + QUICK_STOP_RATE * way)
        np.testing.assert_allclose(drives.actuators.goal, load - held, atol=1e-9)
    assert drives.brakes.all()
    assert np.abs(world.position - moved).max() < 5e-3
    world.advance(100)
    resting = world.position.copy()
    world.advance(200)
    np.testing.assert_allclose(world.position, resting, atol=1e-4)


def test_a_quick_stopped_drive_moves_again_only_when_it_is_enabled_anew(host):
    host.enable()
    drives = host.world.drives
    host.world.advance(1200)
    host.cycle(10)
    for command in (Command.ENABLE_OPERATION, Command.SWITCH_ON, Command.SHUTDOWN):
        drives.control(_all(host, command))
        assert (drives.state == State.QUICK_STOP_ACTIVE).all()
    drives.control(_all(host, Command.DISABLE_VOLTAGE))
    assert (drives.state == State.SWITCH_ON_DISABLED).all()
    assert (drives.error == DriveError.WATCHDOG).all()  # why it stopped can still be read
    host.command.position[:] = host.world.position
    host.enable()
    assert (drives.error == DriveError.NONE).all()


def test_the_watchdog_interval_is_the_commands(host):
    host.enable()
    world, drives = host.world, host.world.drives
    drives.command(host.command, None, np.full(len(drives), 5, np.uint8))
    world.advance(11)
    assert (drives.state == State.OPERATION_ENABLED).all()
    world.advance(1)
    assert (drives.state == State.QUICK_STOP_ACTIVE).all()


def test_a_faulted_drive_closes_its_brake_and_needs_a_reset(host):
    host.enable()
    drives = host.world.drives
    drives.fail(3, DriveError.ENCODER)
    host.cycle(5)
    assert drives.state[3] == State.FAULT
    assert drives.brakes[3]
    assert not drives.brakes[4]
    drives.control(_all(host, Command.DISABLE_VOLTAGE))
    assert drives.state[3] == State.FAULT
    drives.control(_all(host, Command.FAULT_RESET))
    assert drives.state[3] == State.SWITCH_ON_DISABLED
    assert drives.error[3] == DriveError.ENCODER  # until it is enabled anew


def test_a_joint_that_runs_away_trips_its_drive(host):
    host.enable()
    world = host.world
    wrist = world.description.index("arm_right_7_joint")
    host.command.mode[wrist], host.command.stiffness[wrist] = Mode.TORQUE, 0.0
    for _ in range(200):
        host.command.torque[:] = host.kinematics.gravity(world.position)
        host.command.torque[wrist] = 8.0
        world.drives.command(host.command)
        world.step()
        if world.drives.state[wrist] == State.FAULT:
            break
    assert world.drives.error[wrist] == DriveError.OVERSPEED
    assert world.drives.brakes[wrist]


@pytest.fixture
def bus(host):
    protocol = LimbProtocol(host.world.description)
    return BusNode(host.world), protocol, frames.empty(protocol.frames_a_cycle)


def test_every_frame_to_a_limb_is_answered_once_by_each_of_its_drives(host, bus):
    node, protocol, out = bus
    state = JointState(len(host.world.drives))
    count = protocol.encode_control(_all(host, Command.SHUTDOWN), 77, out)
    node.receive(out[:count])
    host.world.advance(2)
    answers = node.answer()
    assert len(set(answers["can_id"].tolist())) == len(answers) == len(host.world.drives)
    assert protocol.decode_status(answers, len(answers), state) == (len(host.world.drives), 0)
    assert (decode_statusword(state.status) == State.READY_TO_SWITCH_ON).all()
    assert (state.sequence == 77).all()
    np.testing.assert_allclose(state.position, host.world.position, atol=1e-5)  # encoders have 19 bits a turn
    assert len(node.answer()) == 0


def test_only_the_limb_that_was_addressed_answers(host, bus):
    node, protocol, out = bus
    protocol.encode_control(_all(host, Command.SHUTDOWN), 1, out)
    node.receive(out[2:3])  # torso and head
    answers = node.answer()
    assert len(answers) == 4
    assert (host.world.drives.state == State.READY_TO_SWITCH_ON).sum() == 4


def test_a_frame_with_a_bad_crc_is_ignored_counted_and_not_answered(host, bus):
    node, protocol, out = bus
    count = protocol.encode_control(_all(host, Command.SHUTDOWN), 1, out)
    out["data"][:, 0] ^= 1
    node.receive(out[:count])
    host.world.advance(2)
    assert len(node.answer()) == 0
    assert node.refused == count
    assert (host.world.drives.state == State.SWITCH_ON_DISABLED).all()


def test_commands_over_the_bus_move_the_robot(host, bus):
    node, protocol, out = bus
    host.enable()
    world = host.world
    elbow = world.description.index("arm_right_4_joint")
    goal = world.position[elbow] + 0.2
    for cycle in range(500):
        host.command.position[elbow] = goal - 0.2 * max(0.0, 1 - cycle / 250)
        host.command.torque[:] = host.kinematics.gravity(world.position)
        count = protocol.encode_commands(host.command, cycle, 20, out)
        syncs, holds = node.receive(out[: count + protocol.encode_sync(cycle, out[count:])])
        assert (syncs, holds) == (1, 0)
        world.advance(2)
        node.answer()
    assert world.position[elbow] == pytest.approx(goal, abs=0.01)
