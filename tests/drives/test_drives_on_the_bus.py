"""Host and emulated drives with nothing between them but their frames: identities, parameters, devices, another family, replays."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator

import numpy as np
import pytest

from hal.can import frames
from hal.drives.fields import ENTITY, HEAD, Role
from hal.drives.lifecycle import DriveError, State
from hal.drives.parameter_client import ParameterClient, ParameterError
from hal.drives.parameters import PROTOCOL_VERSION, Parameter
from hal.drives.protocol import LimbProtocol
from hal.hardware import Goal, Hardware
from hal.joint import JointCommand, Mode
from hal.plant.bus_node import BusNode
from hal.plant.world import World
from handrail.robot import library as robots
from handrail.robot.description import RobotDescription


class Line:
    """A port whose other end is a plant: it steps one period at every Sync."""

    def __init__(self, description: RobotDescription):
        self.world = World(description)
        self.node = BusNode(self.world)
        self.counters = np.zeros((len(description.channels), 3), np.int64)
        self.refused = self.lost = 0
        self.stuck = False
        self.frozen: np.ndarray | None = None
        self.heard = frames.empty(0)
        self._steps = description.period_ns // 1_000_000
        self._waiting: list[np.ndarray] = []

    def send(self, records: np.ndarray) -> None:
        records = records.copy()
        if self.stuck:  # the same command over and over, and Sync
            self.frozen = records if self.frozen is None else self.frozen
            records = self.frozen
        self.heard = records
        syncs, _ = self.node.receive(records)
        self.world.advance(syncs * self._steps)
        answers = self.node.answer() if syncs else self.node.replies()
        assert len(self.node.senders[: len(answers)]) == len(answers)
        copy = answers.copy()
        copy["time_ns"] = self.world.time_ns
        self._waiting.append(copy)

    def receive(self, timeout_s: float = 0.0) -> np.ndarray:
        waiting, self._waiting = self._waiting, []
        return np.concatenate(waiting) if waiting else frames.empty(0)

    def fileno(self) -> int:
        return -1

    def close(self) -> None:
        self.world.close()


class InParts(Line):
    """In lock-step: each cycle's answers come in two datagrams, and behind the second the word that the cycle is over."""

    def __init__(self, description: RobotDescription):
        super().__init__(description)
        self.ticks = 0
        self._parts: list[np.ndarray] = []

    def send(self, records: np.ndarray) -> None:
        super().send(records)
        answers = super().receive()
        self._parts += [answers[:5], answers[5:]]

    def receive(self, timeout_s: float = 0.0) -> np.ndarray:
        if not self._parts:
            return frames.empty(0)
        self.ticks += len(self._parts) % 2 == 1
        return self._parts.pop(0)


class Host:
    """Hardware on a line, cycle by cycle."""

    def __init__(self, description: RobotDescription, line: type[Line] = Line):
        self.description = description
        self.line, self.protocol = line(description), LimbProtocol(description)
        self.hardware = Hardware(description, self.line, self.protocol)
        self.command = JointCommand(len(description.joints))
        self.cycles = 0

    def run(self, cycles: int, wait_s: float = 0.0) -> None:
        for _ in range(cycles):
            self.cycles += 1
            self.hardware.write(self.command, self.cycles)
            self.hardware.read(wait_s)

    def enable(self) -> None:
        self.run(3)
        state, command = self.hardware.state, self.command
        command.position[:], command.mode[:] = state.position, Mode.IMPEDANCE
        command.stiffness[:], command.damping[:] = self.description.stiffness, self.description.quick_stop_damping
        self.hardware.goal = Goal.OPERATIONAL
        self.run(12)


@contextlib.contextmanager
def _host(description: RobotDescription, line: type[Line] = Line) -> Iterator[Host]:
    made = Host(description, line)
    yield made
    made.hardware.close()


@pytest.fixture(scope="module")
def talos() -> RobotDescription:
    return robots.load("talos_upper")


@pytest.fixture
def host(talos: RobotDescription) -> Iterator[Host]:
    with _host(talos) as made:
        yield made


def test_every_drive_says_within_a_tenth_of_a_second_which_version_it_speaks(host: Host) -> None:
    host.run(50)
    assert (host.hardware.protocol_version == PROTOCOL_VERSION).all()
    assert (host.hardware.firmware_version > 0).all()
    assert host.hardware.first_stranger() == -1
    host.run(1)
    requests = host.protocol.program.span(Role.PARAMETER_REQUEST)
    ids = {int(host.protocol.program.frames[f, HEAD]) & 0xFFFFFFFF for f in range(*requests)}
    assert ids and not ids & set(host.line.heard["can_id"].tolist()), "then nobody is asked any more"


def test_a_drive_of_another_version_is_a_stranger(host: Host, monkeypatch: pytest.MonkeyPatch) -> None:
    drives = host.line.world.drives
    read = drives.read_parameter
    monkeypatch.setattr(
        drives, "read_parameter", lambda row, index: 1.0 if (row, index) == (11, 1) else read(row, index)
    )
    host.run(50)
    assert host.hardware.first_stranger() == 11
    assert host.hardware.protocol_version[11] == 1.0


def test_parameters_are_read_and_written_over_the_bus_beside_a_host(host: Host) -> None:
    client = ParameterClient(host.line, host.protocol)
    row = host.description.index("arm_right_4_joint")
    assert client.read(row, Parameter.PROTOCOL_VERSION) == PROTOCOL_VERSION
    assert client.read(row, Parameter.TORQUE_LIMIT) == pytest.approx(host.description.torque_limit[row])
    lower = 0.5 * host.description.torque_limit[row]
    assert client.write(row, Parameter.TORQUE_LIMIT, lower) == pytest.approx(lower)
    with pytest.raises(ParameterError, match="arm_right_4_joint: protocol_version 3: it can only be read"):
        client.write(row, Parameter.PROTOCOL_VERSION, 3.0)
    with pytest.raises(ParameterError, match="arm_right_4_joint: torque_limit -5: out of range"):
        client.write(row, Parameter.TORQUE_LIMIT, -5.0)
    with pytest.raises(ParameterError, match="calibrate: can only be written"):
        client.read(row, Parameter.CALIBRATE)
    client.write(row, Parameter.INJECT_ERROR, float(DriveError.ENCODER))
    host.run(3)
    assert host.hardware.state.error[row] == DriveError.ENCODER


def test_calibration_is_refused_while_the_drive_is_in_operation(host: Host) -> None:
    client, row = ParameterClient(host.line, host.protocol), 3
    host.enable()
    assert host.hardware.operational
    with pytest.raises(ParameterError, match="not while the drive is in this state"):
        client.write(row, Parameter.CALIBRATE, 0.1)
    host.hardware.goal = Goal.INACTIVE
    host.run(5)
    client.write(row, Parameter.CALIBRATE, 0.1)
    host.run(2)
    assert host.hardware.state.position[row] == pytest.approx(0.1, abs=1e-3)


def test_commands_of_a_mailbox_that_is_stuck_do_not_feed_the_watchdogs(host: Host) -> None:
    host.enable()
    assert host.hardware.operational
    host.line.stuck = True
    host.run(host.description.watchdog_cycles + 3)
    drives = host.line.world.drives
    assert (drives.state == State.QUICK_STOP_ACTIVE).all() and (drives.error == DriveError.WATCHDOG).all()
    assert host.hardware.state.age.min() > host.description.watchdog_cycles, "and their answers are old too"


def test_a_limb_of_another_family_lives_beside_the_others(talos: RobotDescription) -> None:
    limbs = tuple(dataclasses.replace(limb, family="mit") if limb.name == "arm_left" else limb for limb in talos.limbs)
    with _host(dataclasses.replace(talos, limbs=limbs)) as host:
        host.enable()
        assert host.hardware.operational
        start = host.line.world.position.copy()
        host.command.position[host.description.index("arm_left_5_joint")] += 0.05
        host.run(300)
        moved = host.line.world.position - start
        assert moved[host.description.index("arm_left_5_joint")] > 0.02
        host.hardware.goal = Goal.INACTIVE
        host.run(3)
        assert (host.line.world.drives.state == State.SWITCH_ON_DISABLED).all()


def test_limbs_with_masters_live_as_others_do(talos: RobotDescription) -> None:
    limbs = tuple(dataclasses.replace(limb, answer="master") for limb in talos.limbs)
    with _host(dataclasses.replace(talos, limbs=limbs)) as host:
        host.enable()
        assert host.hardware.operational and (host.hardware.state.age == 0).all()
        assert host.hardware.state.position == pytest.approx(host.line.world.position, abs=1e-4)
        assert host.hardware.stale_replies == 0


def test_devices_are_measured_and_a_gripper_stops_when_nobody_commands_it() -> None:
    with _host(robots.load("talos_upper_grippers")) as host:
        host.run(100)
        devices = {device.name: row for row, device in enumerate(host.description.devices)}
        families = {device.family for device in host.description.devices}
        assert {"imu", "force_torque", "gripper", "power"} <= families
        for row, device in enumerate(host.description.devices):
            every = int(host.protocol.every[row])
            assert host.hardware.devices.age[row] < max(every, 1), device.name
            assert 0 <= host.line.world.time_ns - host.hardware.devices.measured_ns[row] < every * 2_000_000 + 1
        imu = next(row for name, row in devices.items() if host.description.devices[row].family == "imu")
        assert np.linalg.norm(host.hardware.devices.values[imu, 7:10]) == pytest.approx(9.81, abs=0.1)
        grip = next(row for row, device in enumerate(host.description.devices) if device.family == "gripper")
        joint = host.description.devices[grip].joint
        lower, upper, _, effort = host.description.device_limits[joint]
        start = host.hardware.devices.values[grip, 0]
        goal = lower if abs(start - lower) > abs(start - upper) else upper
        host.hardware.device_command.values[grip, :4] = goal, 1.0, effort, 1.0
        host.hardware.device_command.commanded[grip] = True
        host.run(200)
        assert abs(host.hardware.devices.values[grip, 0] - start) > 0.05
        assert host.hardware.devices.values[grip, 4] == State.OPERATION_ENABLED
        host.hardware.device_command.commanded[grip] = False
        host.run(host.description.watchdog_cycles + 10)
        assert host.hardware.devices.values[grip, 4] != State.OPERATION_ENABLED


def test_another_processes_sync_does_not_make_the_answers_late_for_good(talos: RobotDescription) -> None:
    with _host(talos, InParts) as host:
        host.run(5, 0.1)
        host.hardware.read(0.1)  # before anybody was heard nothing is waited for: a half is left over
        host.run(5, 0.1)
        before = host.hardware.stale_replies
        host.line.ticks += 1
        host.run(20, 0.1)
        assert host.hardware.stale_replies == before
        assert host.hardware.state.age.max() == 0


def test_a_gripper_command_that_comes_late_does_not_undo_the_stop() -> None:
    with _host(robots.load("talos_upper_grippers")) as host:
        grip = next(row for row, device in enumerate(host.description.devices) if device.family == "gripper")
        program, node, gripper = host.protocol.program, host.line.node, host.line.world.devices.grippers[grip]
        head = next(
            int(program.frames[f, HEAD])
            for f in range(*program.span(Role.DEVICE_COMMAND))
            if program.frames[f, ENTITY] == grip
        )
        host.hardware.device_command.values[grip, :4] = gripper.upper, 1.0, 1.0, 1.0
        host.hardware.device_command.commanded[grip] = True
        host.run(20)
        heard = host.line.heard
        late = heard[(heard["can_id"] == head & 0xFFFFFFFF) & (heard["bus"] == head >> 48 & 0xFF)].copy()
        assert len(late) == 1 and gripper.state is State.OPERATION_ENABLED
        host.hardware.device_command.values[grip, 3] = 0.0
        host.run(4)
        assert gripper.state is not State.OPERATION_ENABLED
        node.receive(late)
        assert gripper.state is not State.OPERATION_ENABLED, "a frame from before the stop moved it"

        # A host that begins anew counts from anywhere, once the gripper has stopped waiting for the one before; as its first
        # frame may be a late one, it takes two.
        host.hardware.device_command.commanded[grip] = False
        host.run(host.description.watchdog_cycles + 5)
        node.receive(late)
        assert gripper.state is not State.OPERATION_ENABLED, "a frame from before the silence moved it"
        host.run(host.description.watchdog_cycles + 5)
        host.hardware.device_command.values[grip, 3] = 1.0
        host.hardware.device_command.commanded[grip] = True
        host.hardware._sequence = (int(late["data"][0, 8]) - 100) & 0xFF
        host.run(4)
        assert gripper.state is State.OPERATION_ENABLED
