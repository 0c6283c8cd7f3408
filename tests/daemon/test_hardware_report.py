"""The life of every drive and device in ros2_control's words."""

import numpy as np
import pytest

from daemon import exchange
from daemon.serving.hardware_report import components
from hal.device import SILENT_AFTER
from hal.drives.lifecycle import State, statusword
from handrail.robot import library as robots
from handrail.robot.description import RobotDescription


@pytest.fixture(scope="module")
def robot() -> RobotDescription:
    return robots.load("talos_upper_grippers")


@pytest.fixture
def snapshot(robot: RobotDescription) -> np.ndarray:
    made = np.zeros((), exchange.snapshot_dtype(robot))
    made["status"] = statusword(State.OPERATION_ENABLED)
    made["temperature"], made["protocol_version"], made["firmware_version"] = 31.5, 3.0, np.nan
    return made


def test_a_drives_life_follows_its_state_and_what_is_not_known_is_left_out(
    robot: RobotDescription, snapshot: np.ndarray
) -> None:
    snapshot["status"][1], snapshot["error"][1] = statusword(State.FAULT), 3
    snapshot["status"][2] = statusword(State.SWITCHED_ON)
    snapshot["age"][3] = 400
    channel = robot.channels[0].name
    drives = list(components(snapshot, robot, {channel: "error_passive"}))[: len(robot.joints)]
    assert [drive.name for drive in drives] == list(robot.joints)
    assert [drive.life for drive in drives[:5]] == ["active", "inactive", "inactive", "unconfigured", "active"]
    assert (drives[1].state, drives[1].error) == ("fault", 3)
    assert drives[1].problem.startswith("fault")
    assert (drives[3].state, drives[3].temperature, drives[3].age) == ("unknown", None, 400)
    assert (drives[0].temperature, drives[0].protocol_version, drives[0].firmware_version) == (31.5, 3, None)
    channels = {joint: limb.channel for limb in robot.limbs for joint in limb.joints}
    assert [drive.channel for drive in drives] == [channels[joint] for joint in robot.joints]
    assert {drive.bus_state for drive in drives if drive.channel == channel} == {"error_passive"}
    assert {drive.bus_state for drive in drives if drive.channel != channel} <= {""}


def test_grippers_live_as_their_drive_does_and_other_devices_by_answering(
    robot: RobotDescription, snapshot: np.ndarray
) -> None:
    names = [device.name for device in robot.devices]
    grippers = [row for row, device in enumerate(robot.devices) if device.family == "gripper"]
    snapshot["device_values"][grippers, 3] = 44.0
    snapshot["device_values"][grippers[0], 4] = State.OPERATION_ENABLED
    snapshot["device_values"][grippers[1], 4] = State.SWITCH_ON_DISABLED
    others = [row for row in range(len(names)) if row not in grippers]
    snapshot["device_age"][others[0]] = SILENT_AFTER + 1
    told = list(components(snapshot, robot, {}))[len(robot.joints) :]
    assert [part.name for part in told] == names
    assert (told[grippers[0]].life, told[grippers[0]].temperature) == ("active", 44.0)
    assert (told[grippers[1]].life, told[grippers[1]].state) == ("inactive", "switch_on_disabled")
    assert (told[others[0]].life, told[others[0]].problem) == ("unconfigured", "does not answer")
    assert {told[row].life for row in others[1:]} <= {"active"}


def test_without_a_loop_nothing_is_known_of_any_component(robot: RobotDescription) -> None:
    told = list(components(None, robot, {}))
    assert len(told) == len(robot.joints) + len(robot.devices)
    assert {part.life for part in told} == {"unknown"}
    assert {(part.age, part.temperature, part.protocol_version) for part in told} == {(None, None, None)}
