"""Whole-body control by the daemon, from a test, or from any program that can call it: `pytest examples`."""

import numpy as np
import pytest

from handrail import messages as m
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics

TALOS = robots.load("talos_upper")
KINEMATICS = Kinematics(TALOS)


def hand(plant):
    """Where the right tool's tip really is, m."""
    joints = plant.truth().joints
    return KINEMATICS.frame(np.array([joints[joint] for joint in TALOS.joints]), "tool_right_tip").translation


def test_the_hand_follows_what_is_streamed(robot, plant):
    start = hand(plant)
    stream = m.PoseStream(task="hand", stale=1.0)
    action = robot.daemon.start(m.WholeBody(compound="right_hand", references=[stream]), m.TimeEnd(after=2.0))
    goal = tuple((start + np.array([0.0, 0.05, 0.05])).tolist())
    robot.daemon.call(m.StreamPose(id=action, task="hand", position=goal))
    assert robot.daemon.wait_end(action).outcome == "time"
    assert hand(plant) == pytest.approx(goal, abs=5e-3)
