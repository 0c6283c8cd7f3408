"""Hands, who commands, what losing the link would do, and when a plan may be executed: without a screen."""

from __future__ import annotations

import pytest

from handrail.messages import DeviceStates, EngineSnapshot, GetRobot, GripperState, LeaseState
from handrail.robot import library
from tablet_client.models import arrivals
from tablet_client.models.command import commanders, if_lost
from tablet_client.models.hands import Hands, spans
from tablet_client.models.situation import Situation


@pytest.fixture
def situation(robot) -> Situation:
    """Attached, with a fresh plan that nobody asks about."""
    made = Situation("tcp://somewhere:47800")
    made.take(arrivals.Attached(robot.answer(GetRobot()), robot.status()))
    made.take(arrivals.EngineAttached(EngineSnapshot(instances=[], plans=[robot.plan()], run=None, prompts=[])))
    return made


def test_a_fresh_plan_of_an_enabled_robot_can_be_executed(situation):
    assert situation.why_not_execute() == ""


def test_a_plan_that_can_not_be_executed_says_why(situation, robot):
    situation.take(robot.status(enabled=False))
    assert situation.why_not_execute() == "not_enabled"
    situation.take(robot.status(enabled=False, stopped=True))
    assert situation.why_not_execute() == "stopped"
    situation.take(robot.status())
    situation.take(robot.running())
    assert (situation.why_not_execute(), situation.why_not_jog()) == ("program_runs", "program_runs")
    situation.take(robot.running(status="paused"))
    assert (situation.why_not_execute(), situation.why_not_jog()) == ("", ""), "in a pause the robot is moved by hand"
    situation.take(robot.prompt())
    assert situation.why_not_execute() == "is_asked"
    situation.take(robot.plan(fresh=False, stale_causes=["instance_moved"]))
    assert situation.why_not_execute() == "stale_instance_moved"
    situation.take(arrivals.Unanswered(1, "gone"))
    assert situation.why_not_execute() == "no_engine"


def test_every_lease_is_told_with_its_owner(robot):
    leases = [
        LeaseState(part="arm_right", owner="engine", epoch=3),
        LeaseState(part="gripper_left", owner="anna", epoch=4),
    ]
    assert commanders(robot.status(leases=leases)) == [("arm_right", "engine"), ("gripper_left", "anna")]
    assert commanders(None) == []


@pytest.mark.parametrize(
    ("status", "run", "code"),
    [
        ({}, "running", "program_goes_on"),
        ({}, "paused", "program_waits"),
        ({"action": "a"}, "none", "motion_ends"),
        ({}, "none", "holds"),
        ({"enabled": False}, "running", "nothing_moves"),
        ({"stopped": True}, "running", "nothing_moves"),
    ],
)
def test_what_losing_the_link_would_do_depends_on_what_the_robot_does(robot, status, run, code):
    assert if_lost(robot.status(**status), run) == code


def test_a_gripper_goes_no_further_than_it_can_and_knows_its_poses_by_name():
    hands = Hands()
    hands.spans = spans(library.load("talos_upper_grippers"))
    assert set(hands.spans) == {"gripper_right", "gripper_left"}
    span = hands.spans["gripper_right"]
    assert span.poses["closed"] == -0.95 and span.poses["open"] == 0.0
    call = hands.call("gripper_right", 9.0)
    assert call is not None and call.position == span.high
    assert hands.call("gripper_middle", 0.0) is None


def test_where_hands_are_comes_with_the_devices():
    hands = Hands()
    state = GripperState(
        name="gripper_right", age=0, joint="gripper_right_joint", position=-0.4, velocity=0.0, effort=0.0,
        temperature=30.0, state="operation_enabled", holding=True,
    )  # fmt: skip
    hands.take(DeviceStates(time_ns=1, grippers=[state]))
    assert hands.states["gripper_right"].holding
