"""What a frame's path leaves of the joints' limits, whatever axes it is said in."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from daemon.controllers.frame_room import frame_room, point_room
from daemon.controllers.references import MAX_RATE_CHANGE, HermitePath, LinePath
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


def test_knots_along_a_line_leave_no_more_room_than_the_line_itself_and_not_much_less() -> None:
    description = robots.load("talos_upper")
    kinematics, arm = Kinematics(description), description.arms["right"]
    rows, position = description.index(arm.joints), description.home_position("ready")
    limits = np.array((description.acceleration_limit[rows], description.jerk_limit[rows]))
    start, shift = kinematics.frame(position, arm.tip), np.array([0.35, 0.0, 0.0])
    line = LinePath(start.rotation, start.translation, pin.SE3(start.rotation, start.translation + shift), 0.5)
    times = np.linspace(0.0, 0.5, 26)
    share, slope, _, _ = line.shares(times)
    path = HermitePath(times, start.translation + np.outer(share, shift), np.outer(slope, shift))
    place = (kinematics, arm.tip, rows, position, limits)
    by_line, by_knots = frame_room(line, 0.1, *place), point_room(path, 0.1, *place, axes=np.eye(3))
    assert by_knots[0] < 1.05 * by_line[0] < MAX_RATE_CHANGE, "and the line does leave less than all"
    assert by_knots[0] > 0.5 * by_line[0]
    assert point_room(path, 0.5, *place, axes=np.eye(3))[0] == MAX_RATE_CHANGE, "nothing of it is left"
