"""What a frame's path leaves of the joints' limits, whatever axes it is said in."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from daemon.controllers.frame_room import frame_room
from daemon.controllers.references import LinePath
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics


def test_a_path_said_in_other_axes_leaves_as_much_room_as_the_same_one_said_in_the_bases() -> None:
    description = robots.load("talos_upper")
    kinematics, arm = Kinematics(description), description.arms["right"]
    rows, position = description.index(arm.joints), description.home_position("ready")
    limits = np.array((description.acceleration_limit[rows], description.jerk_limit[rows]))
    axes = pin.utils.rotate("z", 1.2)
    start = kinematics.frame(position, arm.tip)
    way = pin.SE3(pin.exp3(np.array([0.3, 0.0, 0.2])), np.array([0.12, -0.05, 0.08]))
    goal = pin.SE3(start.rotation @ way.rotation, start.translation + way.translation)

    def room(turn: np.ndarray, **more: np.ndarray) -> tuple[float, float]:
        there = pin.SE3(turn @ goal.rotation, turn @ goal.translation)
        path = LinePath(turn @ start.rotation, turn @ start.translation, there, 0.4)
        return frame_room(path, 0.1, kinematics, arm.tip, rows, position, limits, **more)

    here = room(np.eye(3))
    assert room(axes.T, axes=axes) == pytest.approx(here)
    assert room(axes.T) != pytest.approx(here, rel=0.01), "they matter"
