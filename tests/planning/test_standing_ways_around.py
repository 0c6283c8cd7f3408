"""TALOS on its feet moves its whole body around a post that the optimised way meets: feet, balance and clearance hold all along."""

from __future__ import annotations

import math
from dataclasses import replace

import coal
import numpy as np
import pinocchio as pin
import pytest

from engines.planning.collision.obstacles import Obstacle
from engines.planning.held_ways import HeldConnector
from engines.planning.motion_planner import MotionPlanner
from engines.planning.timing.timing import Limits
from engines.planning.waiting import Cancelled
from handrail.messages import FrameGoal, KeyFrame, PlanMotion, Pose
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics


@pytest.fixture(scope="module")
def description():
    return robots.load("talos")


@pytest.fixture(scope="module")
def planner(description):
    limits = Limits(0.7 * description.velocity_limit, 0.5 * description.acceleration_limit)
    return MotionPlanner(description, Kinematics(description), limits, standing=True)


@pytest.fixture(scope="module")
def question(description, planner):
    home = description.home_position("ready")
    hand = Kinematics(description).frame(home, "grasp_right").translation
    beyond, end = (FrameGoal(pose=Pose(position=tuple((hand + by).tolist())), angle=math.pi) for by in (BY, ON))
    call = PlanMotion(goals=[end], through=[KeyFrame(goals=[beyond])], arm="right", joints=list(description.joints))
    asked = planner.read(call, [], home)
    sole = Kinematics(description).frame(home, "right_sole_link")
    between = sole.actInv(hand + POST)
    return replace(asked, seen=[Obstacle("post", coal.Box(*SIZE), pin.SE3(np.eye(3), between))])


ON = np.array([0.15, 0.3, -0.1])
BY, POST, SIZE = np.array([0.05, 0.35, 0.0]), np.array([0.0, 0.17, 0.0]), (0.05, 0.05, 0.3)


def test_a_way_around_is_found_on_held_feet_from_key_frame_to_key_frame(description, planner, question):
    home, told = description.home_position("ready"), list[str]()
    plan = planner.plan(question, home, progress=told.append)
    assert any("what is held" in words for words in told), "the optimised way must meet the post"
    assert [segment.name for segment in plan.segments] == ["through 1", "goals"]
    assert plan.key_times == (pytest.approx(plan.segments[0].duration),)
    assert plan.clearance > 0.0095
    assert plan.base_at_end is not None
    kinematics = Kinematics(description)
    hand = kinematics.frame(home, "grasp_right").translation
    before = None
    for segment, by in zip(plan.segments, (BY, ON), strict=True):
        whole = home.copy()
        whole[description.index(plan.joints)] = segment.positions[-1]
        base = kinematics.frame(home, "right_sole_link") * kinematics.frame(whole, "right_sole_link").inverse()
        assert base.act(kinematics.frame(whole, "grasp_right").translation) == pytest.approx(hand + by, abs=1e-3)
        assert segment.base is not None and segment.base.positions[-1] == pytest.approx(base.translation, abs=1e-6)
        assert before is None or segment.base.positions[0] == pytest.approx(before, abs=1e-6)
        before = segment.base.positions[-1]
    first = kinematics.frame(home, "right_sole_link").actInv(kinematics.frame(home, "left_sole_link"))
    for row in np.vstack([segment.positions for segment in plan.segments]):
        whole = home.copy()
        whole[description.index(plan.joints)] = row
        now = kinematics.frame(whole, "right_sole_link").actInv(kinematics.frame(whole, "left_sole_link"))
        assert np.abs(pin.log6(first.actInv(now)).vector).max() < 0.005


def test_it_is_cancelled_on_the_way(description, planner, question):
    start, scene = planner.configuration("start", description.home_position("ready")), planner.scene(question)
    floors = scene.margins.floors(scene.world)
    ways = HeldConnector(planner.solver, scene.sweep, floors, question.stands, cancelled=lambda: True)
    with pytest.raises(Cancelled):
        ways.way(start, start + 0.01)
