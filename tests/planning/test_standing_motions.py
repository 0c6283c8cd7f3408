"""TALOS on its feet plans where it stands in the world: soles held, balanced, judged by pinocchio on a free base."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pinocchio as pin
import pytest

from engines.planning.plan import Infeasible, Plan
from engines.planning.planners import Planners
from handrail.messages import Base, CentreOfMassGoal, Foot, FrameGoal, JointsGoal, PlanMotion, Pose, WholeBody
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics

HERE = pin.SE3(pin.utils.rotate("z", 0.7), np.array([1.0, 2.0, 1.0]))
"""the base in the world"""
_STILL = (0.0, 0.0, 0.0)
BASE = Base(
    time_ns=0, pose_in_world=Pose(position=(1.0, 2.0, 1.0), orientation=(0.0, 0.0, math.sin(0.35), math.cos(0.35))),
    linear_velocity=_STILL, angular_velocity=_STILL, position_deviation=0.0, orientation_deviation=0.0, source="feet",
    feet=[Foot(name=name, holds=True, force=(0.0, 0.0, 450.0)) for name in ("right", "left")],
)  # fmt: skip


class Truth:
    """What pinocchio says of TALOS whose right sole stays where it was."""

    def __init__(self):
        self.description = robots.load("talos")
        self.home = self.description.home_position("ready")
        self.kinematics = Kinematics(self.description)
        self.sole = HERE * self.kinematics.frame(self.home, "right_sole_link")
        self.free = pin.buildModelFromUrdf(str(self.description.urdf), pin.JointModelFreeFlyer())
        self.data = self.free.createData()

    def positions(self, plan: Plan) -> np.ndarray:
        (segment,) = plan.segments
        whole = np.repeat(self.home[None], len(segment.times), axis=0)
        whole[:, self.description.index(plan.joints)] = segment.positions
        return whole

    def base(self, position: np.ndarray) -> pin.SE3:
        return self.sole * self.kinematics.frame(position, "right_sole_link").inverse()

    def frame(self, position: np.ndarray, name: str) -> pin.SE3:
        return self.base(position) * self.kinematics.frame(position, name)

    def centre(self, position: np.ndarray) -> np.ndarray:
        """(3,) m, of the whole mass in the world."""
        q = pin.neutral(self.free)
        q[:7] = pin.SE3ToXYZQUAT(self.base(position))
        for joint, x in zip(self.description.joints, position, strict=True):
            q[self.free.idx_qs[self.free.getJointId(joint)]] = x
        return np.array(pin.centerOfMass(self.free, self.data, q))


@pytest.fixture(scope="module")
def truth() -> Truth:
    return Truth()


@pytest.fixture(scope="module")
def planners(truth) -> Planners:
    return Planners(truth.description)


def _goal(truth: Truth, *by: float) -> FrameGoal:
    """The right hand, by so many m along the base's axes from where it is."""
    place = truth.frame(truth.home, "grasp_right").translation + HERE.rotation @ np.array(by)
    return FrameGoal(pose=Pose(position=tuple(place.tolist())), angle=math.pi)


def test_an_arm_reaches_a_place_in_the_world_from_where_the_robot_stands(planners, truth):
    goal = _goal(truth, 0.1, 0.0, 0.1)
    plan = planners.motion(PlanMotion(goals=[goal], arm="right"), [], truth.home, base=BASE)
    end = truth.frame(truth.positions(plan)[-1], "grasp_right").translation
    assert np.linalg.norm(end - goal.pose.position) < 2e-4
    assert plan.base_at_end is None
    assert not isinstance(plan.motion(plan.segments[0]), WholeBody)


def test_the_whole_body_goes_down_on_feet_that_stay_with_its_mass_over_them(planners, truth):
    goal, joints = _goal(truth, 0.2, 0.0, -0.35), list(truth.description.joints)
    plan = planners.motion(PlanMotion(goals=[goal], arm="right", joints=joints), [], truth.home, base=BASE)
    positions = truth.positions(plan)
    assert np.linalg.norm(truth.frame(positions[-1], "grasp_right").translation - goal.pose.position) < 2e-4
    left = truth.frame(truth.home, "left_sole_link")
    middle = (left.translation + truth.sole.translation)[:2] / 2.0
    start = np.linalg.norm(truth.centre(truth.home)[:2] - middle)
    for position in positions:
        assert np.linalg.norm(pin.log6(left.actInv(truth.frame(position, "left_sole_link"))).vector) < 0.005
        assert np.linalg.norm(truth.centre(position)[:2] - middle) < max(start, 0.015) + 1e-3
    down = truth.base(positions[-1]).translation
    assert plan.base_at_end is not None
    assert np.linalg.norm(down - plan.base_at_end.position) < 1e-6
    assert down[2] < 0.99, "no arm reaches so far from where it stood"
    motion = plan.motion(plan.segments[0])
    assert isinstance(motion, WholeBody)
    assert motion.compound == "follow"


def test_the_centre_of_mass_goes_down_over_feet_that_stay(planners, truth):
    before, joints = truth.centre(truth.home), list(truth.description.joints)
    goal = CentreOfMassGoal(position=tuple((before - [0.0, 0.0, 0.04]).tolist()), across=0.02)
    plan = planners.motion(PlanMotion(goals=[goal], joints=joints), [], truth.home, base=BASE)
    positions = truth.positions(plan)
    assert truth.centre(positions[-1])[2] == pytest.approx(before[2] - 0.04, abs=2e-4)
    left = truth.frame(truth.home, "left_sole_link")
    assert max(np.linalg.norm(pin.log6(left.actInv(truth.frame(q, "left_sole_link"))).vector) for q in positions) < 5e-3


def test_what_would_fall_over_is_refused_by_the_balance(planners, truth):
    heavy = truth.home.copy()
    heavy[truth.description.index(["leg_right_5_joint", "leg_left_5_joint"])] += 0.5
    goals = [JointsGoal(positions={"arm_right_4_joint": -1.2})]
    with pytest.raises(Infeasible, match="where the robot stands: balance on the feet"):
        planners.motion(PlanMotion(goals=goals, arm="right"), [], heavy, base=BASE)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"source": "inertial"}, "base: got inertial"),
        ({"source": "none", "problem": "no foot was felt"}, "no foot was felt"),
        ({"feet": [msgspec.structs.replace(BASE.feet[0], holds=False), BASE.feet[1]]}, "no hold of foot right"),
    ],
)
def test_nothing_is_planned_for_a_robot_of_which_nobody_knows_how_it_stands(planners, truth, changes, words):
    call = PlanMotion(goals=[JointsGoal(positions={"arm_right_4_joint": -1.2})], arm="right")
    with pytest.raises(ValueError, match=words):
        planners.motion(call, [], truth.home, base=msgspec.structs.replace(BASE, **changes))


def test_a_robot_that_hangs_moves_a_leg_as_a_robot_on_a_held_base_does(planners, truth):
    hanging = msgspec.structs.replace(BASE, source="still")
    call = PlanMotion(goals=[JointsGoal(positions={"leg_right_4_joint": 1.0})], joints=["leg_right"])
    plan = planners.motion(call, [], truth.home, base=hanging)
    assert plan.compound == ""
    assert plan.segments[0].positions[-1, plan.joints.index("leg_right_4_joint")] == pytest.approx(1.0)
