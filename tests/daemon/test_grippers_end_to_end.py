"""A gripper from the call to its fingers and back, over the bus; judged by the plant's ground truth."""

from collections.abc import Callable

import pytest

from handrail import messages as m
from handrail.topics import RefusedError

pytestmark = [pytest.mark.handrail(robot="talos_upper_grippers"), pytest.mark.timeout(120)]

HAND, JOINT = "gripper_right", "gripper_right_joint"


def wait_for(robot, what: Callable[[], bool], why: str, seconds: float = 3.0) -> None:
    """Until something is so, at most so many s of the plant's time."""
    until = robot.plant.time_ns + seconds * 1e9
    while not what():
        assert robot.plant.time_ns < until, why
        robot.plant.wait(0.02)


def hand(robot) -> m.GripperState:
    """What the server told last."""
    states = next(event for event in reversed(robot.daemon.events) if isinstance(event, m.DeviceStates))
    return next(gripper for gripper in states.grippers if gripper.name == HAND)


def test_a_gripper_goes_where_it_is_sent_and_a_stop_stops_it_on_its_way(robot):
    robot.daemon.call(m.CommandGripper(gripper=HAND, position=-0.5))
    wait_for(robot, lambda: abs(robot.position(JOINT) + 0.5) < 0.02, "the fingers did not get there")
    wait_for(robot, lambda: abs(hand(robot).position + 0.5) < 0.02, "nobody was told")
    assert hand(robot).state == "operation_enabled"
    robot.daemon.call(m.CommandGripper(gripper=HAND, position=0.0, velocity=0.2))
    wait_for(robot, lambda: robot.position(JOINT) > -0.4, "the fingers did not set out")
    robot.daemon.call(m.Stop(reason="test"))
    robot.plant.wait(0.1)
    stopped = robot.position(JOINT)
    robot.plant.wait(0.5)
    assert robot.position(JOINT) == pytest.approx(stopped, abs=0.005)
    assert stopped < -0.1
    assert hand(robot).state == "switch_on_disabled"
    with pytest.raises(RefusedError, match="operator stop"):
        robot.daemon.call(m.CommandGripper(gripper=HAND, position=0.0))


def test_a_gripper_whose_cable_is_cut_stops_by_itself_and_nothing_else_and_is_named(robot):
    robot.daemon.call(m.CommandGripper(gripper=HAND, position=-0.9, velocity=0.3))
    wait_for(robot, lambda: robot.position(JOINT) < -0.1, "the fingers did not set out")
    with robot.bus.cut(HAND):
        status = robot.daemon.wait_status(
            lambda status: any(device.problem for device in status.devices), "the gripper is missed"
        )
        assert {device.name: device.problem for device in status.devices if device.problem} == {HAND: "does not answer"}
        assert status.enabled
        assert robot.move("head_1_joint", 0.1, 0.4) == "done"
        stopped = robot.position(JOINT)
        assert stopped > -0.5, "its own watchdog did not stop it"
        with pytest.raises(RefusedError, match="does not answer"):
            robot.daemon.call(m.CommandGripper(gripper=HAND, position=0.0))
    robot.daemon.wait_status(lambda status: not any(device.problem for device in status.devices), "it is back")
    robot.plant.wait(0.3)
    assert robot.position(JOINT) == pytest.approx(stopped, abs=0.01), "it went on with an old order"
    robot.daemon.call(m.CommandGripper(gripper=HAND, position=-0.8))
    wait_for(robot, lambda: abs(robot.position(JOINT) + 0.8) < 0.02, "it does not work again")
