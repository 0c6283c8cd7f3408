"""Where the joint that is to move can't pass, the rest of the body gets out of the way, and comes back."""

from __future__ import annotations

from dataclasses import replace

import coal
import numpy as np
import pinocchio as pin
import pytest

from engines.planning.collision.obstacles import Obstacle
from engines.planning.motion_planner import MotionPlanner
from engines.planning.plan import Infeasible
from engines.planning.timing.timing import Limits
from handrail.messages import JointsGoal, PlanMotion

UPPER_ARM, TORSO = "arm_right_3_joint", ("torso_1_joint", "torso_2_joint")


def test_the_torso_makes_way_for_an_arm_that_alone_would_meet_a_post(description, kinematics):
    planner = MotionPlanner(
        description, kinematics, Limits(0.7 * description.velocity_limit, 0.5 * description.acceleration_limit)
    )
    start, between = (description.home_position("ready").copy() for _ in range(2))
    row = description.index(UPPER_ARM)
    start[row], between[row] = -0.6, 0.0
    tip = kinematics.frame(between, description.arms["right"].tip).translation.copy()
    post = Obstacle("post", coal.Box(0.06, 0.06, 0.06), pin.SE3(np.eye(3), tip))
    stays = dict(zip(TORSO, start[description.index(TORSO)].tolist(), strict=True))

    def plan(joints, goals):
        question = planner.read(PlanMotion(goals=goals, joints=joints), [])
        return planner.plan(replace(question, seen=[post]), start)

    with pytest.raises(Infeasible, match="no way around was found"):
        plan([UPPER_ARM], [JointsGoal(positions={UPPER_ARM: 0.6})])
    found = plan([UPPER_ARM, "torso"], [JointsGoal(positions={UPPER_ARM: 0.6} | stays)])
    way = np.vstack([segment.positions for segment in found.segments])
    torso = way[:, [found.joints.index(joint) for joint in TORSO]]
    assert np.ptp(torso, axis=0).max() > 0.1, "nothing but the torso can let it pass"
    assert np.abs(torso[-1] - torso[0]).max() < 1e-3, "and is where it was at the end"
    assert found.clearance > 0.0095
