"""A tool goes with an object's joint though the nearest postures end at a post: random trees lead elsewhere; on feet, too."""

from __future__ import annotations

import math
from dataclasses import replace

import coal
import numpy as np
import pinocchio as pin
import pytest

from affordance_templates import catalogue
from affordance_templates.instance import Instance
from engines.planning.collision.obstacles import Obstacle
from engines.planning.motion_planner import MotionPlanner
from engines.planning.timing.timing import Limits
from engines.planning.waiting import Cancelled
from handrail.messages import Along, FrameGoal, PlanMotion, Pose, WholeBody
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics

HINGE = np.array([0.55, -0.35, 0.30])
UP = np.array([0.0, 0.0, 0.12])
SIZE = (0.026, 0.034, 0.032)


def planner_of(name: str, **more: bool) -> MotionPlanner:
    description = robots.load(name)
    limits = Limits(0.7 * description.velocity_limit, 0.5 * description.acceleration_limit)
    return MotionPlanner(description, Kinematics(description), limits, **more)


@pytest.fixture(scope="module")
def held(description):
    """TALOS' upper body with its tool in a wheel: planner, wheel, all joints."""
    planner, home = planner_of("talos_upper"), description.home_position("ready")
    pose = Pose(position=tuple(HINGE.tolist()))
    wheel = Instance("wheel_1", catalogue.load("wheel"), pose, joint_state={"hinge": 0.3})
    turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, -1.0]), np.array([1.0, 0.0, 0.0])).coeffs()
    deep = Pose(position=(0.02, 0.0, -0.1), orientation=tuple(turn.tolist()))
    goal = FrameGoal(instance="wheel_1", pose=deep, about="z", angle=0.1)
    plan = planner.plan(planner.read(PlanMotion(goals=[goal], arm="right", ignore=["wheel_1"]), [wheel]), home)
    position = home.copy()
    position[description.index(plan.joints)] = plan.segments[-1].positions[-1]
    return planner, wheel, position


def asked(held, place):
    planner, wheel, _ = held
    along = Along(instance="wheel_1", joint="hinge", by=-2.0, about="z")
    call = PlanMotion(along=along, arm="right", joints=["arm_right", "torso"])
    post = Obstacle("post", coal.Box(*SIZE), pin.SE3(np.eye(3), np.array(place)))
    return replace(planner.read(call, [wheel]), seen=[post])


BY_THE_ELBOW = (0.317, -0.425, 0.407)


def test_a_post_where_following_ends_is_gone_around_and_the_tool_stays_on_its_arc(held, description, kinematics):
    planner, _, position = held
    told = list[str]()
    plan = planner.plan(asked(held, BY_THE_ELBOW), position, progress=told.append)
    assert any("branches tried" in words for words in told), "the nearest postures must meet the post"
    assert plan.clearance > 0.0095
    radius = [math.hypot(*(kinematics.frame(position, "tool_right_tip").translation - HINGE)[1:])]
    for row in plan.segments[0].positions[::4]:
        whole = position.copy()
        whole[description.index(plan.joints)] = row
        radius.append(math.hypot(*(kinematics.frame(whole, "tool_right_tip").translation - HINGE)[1:]))
    assert np.ptp(radius) < 2e-3
    again = planner.plan(asked(held, BY_THE_ELBOW), position)
    assert np.array_equal(again.segments[0].positions, plan.segments[0].positions), "the same question, the same answer"


def test_it_is_cancelled_while_branches_are_tried(held):
    planner, _, position = held
    told = list[str]()
    with pytest.raises(Cancelled):
        planner.plan(
            asked(held, BY_THE_ELBOW), position, progress=told.append,
            cancelled=lambda: bool(told) and "branches tried" in told[-1],
        )  # fmt: skip


def test_on_feet_the_whole_body_goes_with_a_joint_and_its_base_goes_as_planned():
    planner = planner_of("talos", standing=True)
    description = robots.load("talos")
    home, kinematics = description.home_position("ready"), Kinematics(description)
    hand = kinematics.frame(home, "grasp_right").translation
    wheel = Instance("wheel_1", catalogue.load("wheel"), Pose(position=tuple((hand + UP).tolist())))
    along = Along(instance="wheel_1", joint="hinge", by=0.9)
    call = PlanMotion(along=along, arm="right", joints=list(description.joints), ignore=["wheel_1"])
    plan = planner.plan(planner.read(call, [wheel], home), home)
    (segment,) = plan.segments
    assert segment.base is not None and isinstance(plan.motion(segment), WholeBody)
    end = home.copy()
    end[description.index(plan.joints)] = segment.positions[-1]
    sole = kinematics.frame(home, "right_sole_link")
    base = sole * kinematics.frame(end, "right_sole_link").inverse()
    assert base.translation == pytest.approx(segment.base.positions[-1], abs=1e-6)
    centre, start = hand + UP, kinematics.frame(home, "grasp_right").translation
    turned = centre + pin.utils.rotate("x", 0.9) @ (start - centre)
    assert base.act(kinematics.frame(end, "grasp_right").translation) == pytest.approx(turned, abs=1e-3)
