"""TALOS on its feet plans with its whole body and follows the plan; the plant judges where hand and feet are."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from daemon.exchange import ActionState, Answer, Outcome
from engines.planning.planners import Planners
from handrail.messages import Base, Foot, FrameGoal, KeyFrame, PlanMotion, Pose, WholeBody


def _running(bench) -> bool:
    return ActionState.RUNNING in bench.snapshot()["actions"]["state"]


def _base(bench, robot) -> Base:
    """As the daemon tells where it stands."""
    x, y, z, *turn = bench.loop.robot.base.pose.tolist()
    none = (0.0, 0.0, 0.0)
    return Base(
        time_ns=0, pose_in_world=Pose(position=(x, y, z), orientation=tuple(turn)), linear_velocity=none,
        angular_velocity=none, position_deviation=0.0, orientation_deviation=0.0, source="feet",
        feet=[Foot(name=foot.name, holds=True, force=(0.0, 0.0, 450.0)) for foot in robot.feet],
    )  # fmt: skip


def _hand(bench) -> np.ndarray:
    link, offset, _ = bench.world.robot.frame("grasp_right")
    _, at, orientation, *_ = bench.world.robot.link_motion(link)
    return pin.XYZQUATToSE3(np.array([*at, *orientation])).act(offset)


def _reach(place: np.ndarray) -> FrameGoal:
    return FrameGoal(pose=Pose(position=tuple(place.tolist())), angle=math.pi)


def test_a_hand_goes_down_where_no_arm_reaches_from_a_stand_and_up_again_and_the_feet_stay(standing, robot) -> None:
    """The base is down half-way: no line between its ends leads there, it goes the way that was planned for it."""
    bench = standing()
    assert bench.begin(WholeBody(compound="stand")) is Answer.ACCEPTED
    bench.run(150)
    bench.cancel()
    while _running(bench):
        bench.run(10)
    loop, soles, base = bench.loop, bench.soles(), _base(bench, robot)
    tip = pin.XYZQUATToSE3(loop.robot.base.pose) * loop.robot.kinematics.frame(loop.written.position, "grasp_right")
    low = tip.translation + np.array([0.15, -0.05, -0.3])
    end = tip.translation + np.array([0.1, 0.0, 0.05])
    question = PlanMotion(
        goals=[_reach(end)], through=[KeyFrame(goals=[_reach(low)])], arm="right", joints=list(robot.joints)
    )
    plan = Planners(robot).motion(question, [], loop.written.position.copy(), base=base)
    (segment,) = plan.segments
    assert bench.begin(plan.motion(segment)) is Answer.ACCEPTED
    assert segment.base is not None
    slipped, nearest, cycle, off = 0.0, math.inf, 0, list[float]()
    top = bench.world.truth().base_in_world.position[2]

    def look() -> None:
        nonlocal slipped, nearest, cycle
        cycle += 1
        height = np.interp(cycle * robot.period_ns / 1e9, segment.times, segment.base.positions[:, 2])
        off.append(bench.world.truth().base_in_world.position[2] - top - (height - segment.base.positions[0, 2]))
        slipped = max(slipped, float(np.abs(bench.soles() - soles).max()))
        nearest = min(nearest, float(np.linalg.norm(_hand(bench) - low)))

    while _running(bench):
        bench.run(10, look)
    assert Outcome.DONE in bench.snapshot()["actions"]["outcome"]
    assert np.linalg.norm(_hand(bench) - end) < 0.02
    assert nearest < 0.02, "it was down"
    assert np.ptp(segment.base.positions[:, 2]) > 0.02 > 10 * np.abs(off).max(), "the pelvis went as planned"
    assert slipped < 0.002
    assert bench.tilt() < np.radians(2.0)
