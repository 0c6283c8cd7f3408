"""TALOS on its feet plans with its whole body and follows the plan; the plant judges where hand and feet are."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from daemon.exchange import ActionState, Answer, Outcome
from engines.planning.planners import Planners
from handrail.messages import Base, Foot, FrameGoal, PlanMotion, Pose, WholeBody


def _running(bench) -> bool:
    return ActionState.RUNNING in bench.snapshot()["actions"]["state"]


def test_a_hand_goes_down_where_no_arm_reaches_from_a_stand_and_the_feet_stay(standing, robot) -> None:
    bench = standing()
    assert bench.begin(WholeBody(compound="stand")) is Answer.ACCEPTED
    bench.run(150)
    bench.cancel()
    while _running(bench):
        bench.run(10)
    loop, soles = bench.loop, bench.soles()
    x, y, z, *turn = loop.robot.base.pose.tolist()
    feet = [Foot(name=foot.name, holds=True, force=(0.0, 0.0, 450.0)) for foot in robot.feet]
    none = (0.0, 0.0, 0.0)
    base = Base(
        time_ns=0, pose_in_world=Pose(position=(x, y, z), orientation=tuple(turn)), linear_velocity=none,
        angular_velocity=none, position_deviation=0.0, orientation_deviation=0.0, source="feet", feet=feet,
    )  # fmt: skip
    tip = pin.XYZQUATToSE3(np.array([x, y, z, *turn])) * loop.robot.kinematics.frame(
        loop.written.position, "grasp_right"
    )
    place = tuple((tip.translation + np.array([0.15, -0.05, -0.3])).tolist())
    goal = FrameGoal(pose=Pose(position=place), angle=math.pi)
    question = PlanMotion(goals=[goal], arm="right", joints=list(robot.joints))
    plan = Planners(robot).motion(question, [], loop.written.position.copy(), base=base)
    (segment,) = plan.segments
    assert bench.begin(plan.motion(segment)) is Answer.ACCEPTED
    slipped = 0.0

    def look() -> None:
        nonlocal slipped
        slipped = max(slipped, float(np.abs(bench.soles() - soles).max()))

    while _running(bench):
        bench.run(10, look)
    link, offset, _ = bench.world.robot.frame("grasp_right")
    _, at, orientation, *_ = bench.world.robot.link_motion(link)
    hand = pin.XYZQUATToSE3(np.array([*at, *orientation])).act(offset)
    assert Outcome.DONE in bench.snapshot()["actions"]["outcome"]
    assert np.linalg.norm(hand - place) < 0.02
    assert slipped < 0.002
    assert bench.tilt() < np.radians(2.0)
