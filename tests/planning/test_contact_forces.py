"""Feet slip or tip where no forces of the ground can carry the robot, and nowhere else; a plan that needs such is refused."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from engines.planning.motion_planner import MotionPlanner
from engines.planning.plan import Infeasible, Plan, Segment
from engines.planning.timing.contact_forces import FRICTION, borne, figures, least
from engines.planning.timing.timing import Limits
from handrail.messages import JointsGoal, PlanMotion
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics

WEIGHT = 900.0
FEET = robots.load("talos").feet
SOLES = [pin.SE3(np.eye(3), np.array([0.0, y, 0.0])) for y in (-0.085, 0.085)]


def whole(force, at) -> pin.Force:
    """(6,) about the origin, of a force through a point."""
    return pin.Force(np.asarray(force, float), np.cross(at, force))


def told(forces) -> set[tuple[str, str]]:
    return {(figure.constraint, figure.what) for figure in figures(FEET, forces) if figure.by > 1e-4}


@pytest.mark.parametrize(
    ("force", "at", "missed"),
    [
        ((0.0, 0.0, WEIGHT), (0.0, 0.0, 0.0), set()),
        ((0.3 * WEIGHT, 0.0, WEIGHT), (0.0, 0.0, 0.0), set()),
        ((0.6 * WEIGHT, 0.0, WEIGHT), (0.0, 0.0, 0.0), {("friction cone", "right foot"), ("friction cone", "left foot")}),
        ((0.0, 0.0, WEIGHT), (0.095, 0.0, 0.0), {("centre of pressure", f"{side} foot, x") for side in ("right", "left")}),
        ((0.0, 0.0, WEIGHT), (0.0, 0.09, 0.0), set()),  # only with the other foot unloaded more than least forces do
        ((0.0, 0.0, WEIGHT), (0.0, 0.16, 0.0), {("load of the feet", "right foot")}),
        ((0.0, 0.0, -10.0), (0.0, 0.0, 0.0), {("load of the feet", "right foot"), ("load of the feet", "left foot")}),
    ],
    ids=["stands", "leans on friction", "slips", "tips over its toes", "on one foot", "beyond one foot", "flies"],
)  # fmt: skip
def test_what_the_ground_can_not_give_is_told_by_foot_and_figure(force, at, missed):
    forces = borne(FEET, SOLES, whole(force, at))
    carried = sum((sole.act(each).vector for sole, each in zip(SOLES, forces, strict=True)), np.zeros(6))
    assert carried == pytest.approx(whole(force, at).vector, abs=1e-6 * WEIGHT), "whatever is told, they carry it"
    assert missed <= told(forces) and bool(missed) == bool(told(forces))


def test_the_least_forces_are_given_up_only_where_a_foot_would_slip_or_tip():
    inside, outside = (whole((0.0, 0.0, WEIGHT), (0.0, y, 0.0)) for y in (0.02, 0.09))
    for each, wanted in zip(borne(FEET, SOLES, inside), least(FEET, SOLES, inside), strict=True):
        assert each.vector == pytest.approx(wanted.vector)
    assert ("centre of pressure", "right foot, y") in told(least(FEET, SOLES, outside))
    assert told(borne(FEET, SOLES, outside)) == set()


@pytest.fixture(scope="module")
def standing():
    description = robots.load("talos")
    limits = Limits(0.7 * description.velocity_limit, 0.5 * description.acceleration_limit)
    return description, MotionPlanner(description, Kinematics(description), limits, standing=True)


ARMS = ("arm_right_1_joint", "arm_left_1_joint")


def swung(home, joints, rows, swing, seconds: float) -> Plan:
    """There and back by `swing` rad."""
    times = np.linspace(0.0, seconds, 41)
    u = times / seconds
    share = np.sin(math.pi * u) ** 2
    slope = math.pi / seconds * np.sin(2.0 * math.pi * u)
    slope[[0, -1]] = 0.0
    segment = Segment("swing", times, home[rows] + np.outer(share, swing), np.outer(slope, swing))
    return Plan("plan", "swing", "", joints, (segment,), {}, home[rows], 0.0, 0.0)


def test_a_stroke_of_arms_alone_is_held_to_what_the_ground_and_the_legs_bear(standing):
    description, planner = standing
    home, joints = description.home_position("ready"), tuple(each for each in description.joints if each in ARMS)
    rows, swing = description.index(joints), np.full(len(joints), 0.3)
    planner.check_stand(swung(home, joints, rows, swing, 4.0), home)
    ground = "friction|centre of pressure|load of the feet|force of a foot|torque limits"
    with pytest.raises(Infeasible, match=f"swing: ({ground})"):
        planner.check_stand(swung(home, joints, rows, swing, 0.12), home)
    weak = description.torque_limit.copy()
    weak[description.index(["leg_right_4_joint"])] = 1.0
    limits = Limits(0.7 * description.velocity_limit, 0.5 * description.acceleration_limit)
    lame = MotionPlanner(replace(description, torque_limit=weak), Kinematics(description), limits, standing=True)
    with pytest.raises(Infeasible, match=r"swing: torque limits \(leg_right_4_joint\) is .* N·m at"):
        lame.check_stand(swung(home, joints, rows, swing, 4.0), home)


def test_arms_that_swing_so_hard_that_a_foot_slips_are_told_by_foot_time_value_and_limit(standing):
    """The same swing eight times as slow passes."""
    description, planner = standing
    home = description.home_position("ready")
    joints = tuple(joint for joint in description.joints if joint in (*ARMS, "torso_2_joint"))
    rows = description.index(joints)
    question = planner.read(PlanMotion(goals=[JointsGoal(positions={ARMS[0]: 0.0})], joints=list(joints)), [], home)
    verifier, at = planner.scene(question).verifier, planner.configuration("home", home)
    swing = np.array([0.15 if joint == "torso_2_joint" else 0.0 for joint in joints])
    fast = Limits(np.full(len(rows), 99.0), np.full(len(rows), 9999.0))

    def found(seconds: float):
        plan, torque = swung(home, joints, rows, swing, seconds), np.full(len(rows), 1e6)
        return verifier.violations(plan, fast, at, torque=torque, feet=planner.feet)

    ground = ("friction", "centre of pressure", "load of the feet", "force of a foot")
    assert not [each for each in found(2.0) if each.measure.constraint.startswith(ground)]
    missed = [each for each in found(0.25) if each.measure.constraint.startswith(ground)]
    assert missed
    worst = missed[0]
    assert worst.segment == "swing" and 0.0 <= worst.time <= 0.25
    assert "right foot" in worst.measure.what or "left foot" in worst.measure.what
    error = str(worst.error())
    assert f"swing: {worst.measure.constraint} ({worst.measure.what}) is " in error
    assert " at " in error and " allowed, missed by " in error


def test_friction_is_that_of_the_compound_task_that_follows_plans(standing):
    description, _ = standing
    text = (description.folder / "compound_tasks" / "follow.yaml").read_text()
    assert f"friction: {FRICTION}" in text
    for foot in description.feet:
        length, width = foot.size
        assert f"half_length: {length / 2 - 0.01:g}, half_width: {width / 2 - 0.01:g}" in text
