"""The motors' relay from the call to the drives and back, over the bus; judged by the plant's ground truth."""

import pytest
from typer.testing import CliRunner

from hal.drives.lifecycle import DriveError
from hal.robots import cli
from handrail import messages as m
from handrail.topics import RefusedError

pytestmark = [pytest.mark.handrail(robot="sea_bench"), pytest.mark.timeout(300)]

JOINTS = ("shoulder_joint", "elbow_joint")


@pytest.fixture
def relay(handrail_rig):
    """`handrail robot relay ...`, of the test's robot."""

    def run(*words: str):
        return CliRunner().invoke(cli.app, ["relay", *words, "--runtime", str(handrail_rig.folder)])

    return run


def test_an_open_relay_takes_the_drives_power_and_they_come_back_only_when_they_are_enabled_anew(robot, relay):
    with pytest.raises(RefusedError, match="the robot is enabled: Disable first"):
        robot.daemon.call(m.SwitchRelay(power="supply", closed=False))
    refused = relay("close", "--power", "suply")
    assert refused.exit_code == 1
    assert "sea_bench has no such power supply; field power, value suply, expected one such as supply" in refused.output
    refused = relay("open", "--power", "supply")
    assert refused.exit_code == 1 and "the robot is enabled: Disable first" in refused.output
    robot.plant.wait(0.2)
    robot.plant.wait_state(JOINTS, "operation_enabled")

    opened = relay("open", "--power", "supply", "--force")
    assert opened.exit_code == 0 and "supply: relay open" in opened.output
    robot.plant.wait_state(JOINTS, "fault")
    status = robot.daemon.wait_status(
        lambda status: not status.enabled and any(device.problem for device in status.devices), "the daemon goes on"
    )
    assert {drive.error for drive in status.drives} == {DriveError.UNDERVOLTAGE}
    assert [device.problem for device in status.devices] == ["its relay is open: the drives have no power"]
    robot.plant.wait(0.5)
    still = [robot.position(joint) for joint in JOINTS]

    closed = relay("close", "--power", "supply")
    assert closed.exit_code == 0 and "supply: relay closed" in closed.output
    robot.plant.wait(0.5)
    robot.plant.wait_state(JOINTS, "fault")
    assert [robot.position(joint) for joint in JOINTS] == pytest.approx(still, abs=1e-3), "the brakes hold"
    robot.daemon.call(m.Enable())
    robot.daemon.wait_status(lambda status: status.enabled, "it is enabled anew")
    robot.plant.wait_state(JOINTS, "operation_enabled")
    assert robot.move("elbow_joint", 0.1, 0.4) == "done"


def test_the_command_says_that_no_robot_is_up(tmp_path):
    nobody = CliRunner().invoke(cli.app, ["relay", "open", "--runtime", str(tmp_path)])
    assert nobody.exit_code == 1 and "no robot is up in" in nobody.output
