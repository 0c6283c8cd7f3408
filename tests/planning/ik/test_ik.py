"""Questions to the IK engine as planners ask them, and its answers judged by forward kinematics that it does not use."""

from __future__ import annotations

import math

import coal
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engines.planning.collision.obstacles import Obstacle
from engines.planning.collision.world import World
from engines.planning.ik.checker import ANGLE, LENGTH, Checker
from engines.planning.ik.constraints import (
    Balance,
    BodyDistance,
    CentreOfMass,
    Clearance,
    Direction,
    Gaze,
    JointLimits,
    Orientation,
    PointDistance,
    Pose,
    Position,
    Posture,
)
from engines.planning.plan import Infeasible
from handrail.robot import library as robots

TIP, LEFT = "tool_right_tip", "tool_left_tip"
FOOT = ((0.1, 0.05, 0.0), (0.1, -0.05, 0.0), (-0.1, -0.05, 0.0), (-0.1, 0.05, 0.0))
FEET = ("left_sole_link", "right_sole_link")
SPARE = robots.load("talos_upper").allowed_collision_pairs


def table_at(x, y, z):
    return Obstacle("table", coal.Box(0.2, 0.2, 0.2), pin.SE3(np.eye(3), np.array([x, y, z])))


@pytest.mark.parametrize("robot", ["talos_upper", "panda", "ur5", "tiago_pro"])
@settings(max_examples=12, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1))
def test_any_pose_that_a_configuration_has_is_found_again_within_limits(robot, seed, arms, message):
    arm = arms[robot]
    generator = np.random.default_rng(seed)
    goal = arm.tool_at(arm.random(generator))
    constraint = Pose(frame=arm.tool, target=message(pin.SE3(goal)))
    answer = arm.solver.solve([constraint], arm.random(generator), starts=40)
    answer.require()
    found = arm.tool_at(answer.q)
    assert np.linalg.norm(found[:3, 3] - goal[:3, 3]) < 3**0.5 * LENGTH + 1e-6  # LENGTH along each of the goal's axes
    assert np.linalg.norm(pin.log3(found[:3, :3].T @ goal[:3, :3])) < ANGLE + 1e-6
    mechanism = arm.mechanism
    assert (answer.q[mechanism.q_rows] >= mechanism.lower[mechanism.v_rows]).all()
    assert (answer.q[mechanism.q_rows] <= mechanism.upper[mechanism.v_rows]).all()


@settings(max_examples=25, deadline=None, derandomize=True)
@given(
    position=st.tuples(*[st.floats(-3.0, 3.0)] * 3), quaternion=st.tuples(*[st.floats(-1.0, 1.0)] * 4),
    angle=st.floats(0.0, math.pi),
)  # fmt: skip
def test_whatever_is_asked_the_answer_keeps_it_or_says_truly_what_it_misses(
    position, quaternion, angle, solver, upper, ready, placed
):
    length = math.hypot(*quaternion)
    unit = tuple(x / length for x in quaternion) if length > 1e-3 else (0.0, 0.0, 0.0, 1.0)
    constraints = [Position.at(TIP, position), Orientation(frame=TIP, target=unit, angle=angle)]
    answer = solver.solve(constraints, ready, starts=3)
    tip = placed(upper, answer.q, TIP)
    off = np.abs(tip.translation - position)
    x, y, z, w = unit
    turned = np.linalg.norm(pin.log3(pin.Quaternion(w, x, y, z).toRotationMatrix().T @ tip.rotation))
    kept = off.max() <= LENGTH and turned <= angle + ANGLE
    assert answer.feasible == kept
    for violation in answer.violations:
        true = turned - angle if violation.unit == "rad" else off["xyz".index(violation.what)]
        assert violation.by == pytest.approx(true, abs=1e-6)
    rows = upper.q_rows
    assert (answer.q[rows] >= upper.lower - 1e-9).all()
    assert (answer.q[rows] <= upper.upper + 1e-9).all()


def test_a_humanoid_reaches_with_its_feet_where_they_are_and_its_weight_over_them(
    whole_body, humanoid, standing, placed, message
):
    feet = [Pose(frame=foot, target=message(placed(humanoid, standing, foot))) for foot in FEET]
    balance = Balance(contacts=dict.fromkeys(FEET, FOOT), margin=0.02)
    corners = [placed(humanoid, standing, foot).act(np.array(corner))[:2] for foot in FEET for corner in FOOT]
    low, high = np.min(corners, axis=0) + 0.02, np.max(corners, axis=0) - 0.02
    hand = placed(humanoid, standing, "gripper_right_base_link")
    moved = 0
    for offset in ([0.3, 0.0, 0.2], [0.35, 0.0, -0.3], [0.1, -0.3, 0.3], [0.45, 0.1, 0.0]):
        goal = Position.at("gripper_right_base_link", hand.translation + offset)
        answer = whole_body.solve([*feet, balance, goal], standing).require()
        assert (
            np.abs(placed(humanoid, answer.q, "gripper_right_base_link").translation - hand.translation - offset).max()
            < LENGTH
        )
        for foot in FEET:
            apart = placed(humanoid, answer.q, foot).inverse() * placed(humanoid, standing, foot)
            assert np.abs(pin.log6(apart).vector).max() < ANGLE
        com = pin.centerOfMass(humanoid.model, humanoid.model.createData(), answer.q)[:2]
        assert (com > low - LENGTH).all()
        assert (com < high + LENGTH).all()
        moved += np.abs(answer.q[:3] - standing[:3]).max() > 0.01
    assert moved >= 2, "the base is free"


def test_what_may_be_either_way_is_left_nearest_to_nominal(solver, upper, ready, placed):
    there = placed(upper, ready, TIP).translation
    free = solver.solve([Position(frame=TIP, lower=(-9, -9, there[2] + 0.1), upper=(9, 9, 9))], ready).require()
    tip = placed(upper, free.q, TIP).translation
    assert tip[2] == pytest.approx(there[2] + 0.1, abs=LENGTH), "no further than need be"
    exact = solver.solve([Position.at(TIP, tip)], ready).require()
    assert free.cost <= exact.cost * 1.001
    assert solver.solve([], ready).cost == 0.0


def test_joints_that_count_more_move_less(solver, upper, ready, placed):
    goal = Position.at(TIP, placed(upper, ready, TIP).translation + np.array([0.1, 0.1, 0.1]))
    torso = [upper.q_rows[upper.joints.index(joint)] for joint in ("torso_1_joint", "torso_2_joint")]
    willing = solver.solve([goal], ready).require()
    stiff = solver.solve([goal], ready, weights={"torso_1_joint": 100.0, "torso_2_joint": 100.0}).require()
    assert np.abs(stiff.q - ready)[torso].max() < 0.1 * np.abs(willing.q - ready)[torso].max()
    arm = [joint for joint in upper.joints if joint.startswith("arm_right")]
    still = solver.solve([goal], ready, moving=arm).require()
    elsewhere = [row for row, joint in zip(upper.q_rows, upper.joints, strict=True) if joint not in arm]
    assert np.array_equal(still.q[elsewhere], ready[elsewhere])


def test_gaze_direction_and_relative_constraints_hold_together(solver, upper, ready, placed):
    target = np.array([0.6, -0.2, 0.1])
    constraints = [
        Gaze(frame="head_2_link", target=tuple(target), axis=(1.0, 0.0, 0.0), cone=0.05),
        Direction(frame=TIP, axis=(0.0, 0.0, -1.0), direction=(1.0, 0.0, 0.0)),
        Position.at(TIP, target),
        PointDistance(frame=TIP, other=LEFT, lower=0.3, upper=0.35),
        Posture(coefficients={"arm_left_4_joint": 1.0, "arm_right_4_joint": -1.0}),
        JointLimits(margin=0.1),
        CentreOfMass(lower=(-9, -0.02, -9), upper=(9, 0.02, 9)),
    ]
    q = solver.solve(constraints, ready, starts=10).require().q
    head, tip, left = (placed(upper, q, name) for name in ("head_2_link", TIP, LEFT))
    sight = target - head.translation
    assert head.rotation[:, 0] @ sight / np.linalg.norm(sight) > math.cos(0.05 + ANGLE)
    assert tip.rotation[:, 2] @ [-1.0, 0.0, 0.0] > math.cos(ANGLE)
    assert 0.3 - LENGTH < np.linalg.norm(tip.translation - left.translation) < 0.35 + LENGTH
    angles = dict(zip(upper.joints, q[upper.q_rows], strict=True))
    assert angles["arm_left_4_joint"] == pytest.approx(angles["arm_right_4_joint"], abs=ANGLE)
    assert (q[upper.q_rows] >= upper.lower + 0.1 - 1e-9).all()
    assert abs(pin.centerOfMass(upper.model, upper.model.createData(), q)[1]) < 0.02 + LENGTH


def test_a_goal_relative_to_a_frame_that_moves_goes_with_it(solver, upper, ready, placed, message):
    between = pin.SE3(pin.rpy.rpyToMatrix(0.2, 0.3, -0.4), np.array([0.25, 0.0, -0.1]))
    q = solver.solve([Pose(frame=TIP, in_frame=LEFT, target=message(between))], ready, starts=20).require().q
    found = placed(upper, q, LEFT).inverse() * placed(upper, q, TIP)
    assert np.abs(pin.log6(found.inverse() * between).vector).max() < ANGLE


def test_the_arm_keeps_clear_of_a_table_that_its_nominal_way_would_touch(solver, upper, ready, placed):
    there = placed(upper, ready, "arm_right_5_link").translation
    scene = World(upper, [table_at(*(there - [0.0, 0.0, 0.1]))], SPARE)
    clearance = Clearance(scene=scene, at_least=0.03)
    touching = Checker(upper).violations([clearance], ready)
    assert touching
    assert "table" in touching[0].what
    answer = solver.solve([clearance], ready, starts=10).require()
    geometry, data = scene.geometry, scene.geometry.createData()
    pin.computeDistances(upper.model, upper.model.createData(), geometry, data, answer.q)
    assert min(result.min_distance for result in data.distanceResults) > 0.03 - LENGTH


def test_the_robot_may_keep_another_clearance_from_itself_than_from_a_table(solver, upper, ready, placed):
    there = placed(upper, ready, "arm_right_5_link").translation
    scene = World(upper, [table_at(*(there - [0.0, 0.0, 0.1]))], SPARE)
    of_itself = Checker(upper).measures([Clearance(scene=World(upper, (), SPARE), at_least=0.0)], ready)[0].value
    wide = Clearance(scene=scene, at_least=0.03, itself=of_itself + 0.02)
    q = solver.solve([wide], ready, starts=10).require().q
    data = scene.geometry.createData()
    pin.computeDistances(upper.model, upper.model.createData(), scene.geometry, data, q)
    distances = np.array([result.min_distance for result in data.distanceResults])
    assert distances[~scene.of_itself].min() > 0.03 - LENGTH
    assert distances[scene.of_itself].min() > of_itself + 0.02 - LENGTH
    (measured,) = Checker(upper).measures([wide], q)
    floors = np.where(scene.of_itself, of_itself + 0.02, 0.03)
    assert measured.value - measured.lower == pytest.approx((distances - floors).min(), abs=1e-9)


def test_two_links_keep_a_distance_between_bounds(solver, upper, ready):
    scene = World(upper, (), SPARE)
    between = BodyDistance(scene=scene, link="arm_right_5_link", other="arm_left_5_link", lower=0.1, upper=0.12)
    assert Checker(upper).violations([between], ready)
    q = solver.solve([between], ready, starts=10).require().q
    (measured,) = Checker(upper).measures([between], q)
    assert 0.1 - LENGTH < measured.value < 0.12 + LENGTH


def test_out_of_reach_the_report_names_the_constraint_and_what_is_missing_in_metres(solver, upper, ready, placed):
    answer = solver.solve([Position.at(TIP, [3.0, 0.0, 0.3], name="the button")], ready)
    assert not answer.feasible
    worst = answer.violations[0]
    assert (worst.constraint, worst.what, worst.unit) == ("the button", "x", "m")
    assert worst.by == pytest.approx(3.0 - placed(upper, answer.q, TIP).translation[0])
    assert 1.5 < worst.by < 2.5, "stretched out towards it"
    with pytest.raises(Infeasible, match=r"reach: the button \(x\) is .* missed by") as caught:
        answer.require("reach")
    assert caught.value.by == worst.by


def test_a_goal_inside_an_obstacle_is_told_so(solver, upper, ready):
    scene = World(upper, [table_at(0.6, -0.2, 0.0)], SPARE)
    goal = Position.at(TIP, [0.6, -0.2, 0.05], name="grasp")
    answer = solver.solve([goal, Clearance(scene=scene, at_least=0.01)], ready, starts=2)
    first = answer.violations[0]
    assert first.constraint == "grasp"
    assert "inside" in first.what
    assert "table" in first.what
    assert first.by == pytest.approx(0.05, abs=1e-6)


def test_relaxing_gives_up_the_least_important_first_and_says_how_much(solver, upper, ready, placed):
    far = placed(upper, ready, TIP).translation + np.array([0.9, 0.0, 0.0])
    level = Direction(frame=TIP, axis=(0.0, 0.0, -1.0), direction=(1.0, 0.0, 0.0), name="level")
    reach = Position.at(TIP, far, name="reach", priority=2)
    assert not solver.solve([level, reach], ready).feasible
    assert not solver.solve([level, Position.at(TIP, far, name="reach")], ready, relax=True).feasible, (
        "none may give way"
    )
    answer = solver.solve([level, reach], ready, relax=True).require()
    assert {one.constraint for one in answer.given} == {"reach"}
    tip = placed(upper, answer.q, TIP)
    assert tip.rotation[:, 2] @ [-1.0, 0.0, 0.0] > math.cos(ANGLE), "what may not give way is kept"
    gave = np.zeros(3)
    for one in answer.given:
        gave["xyz".index(one.what)] = one.by
    assert np.allclose(gave, np.abs(tip.translation - far), atol=LENGTH)
    # Both may give way: the direction, of lower rank than the place, is only given up as well where that is of use.
    both = solver.solve(
        [Direction(frame=TIP, axis=(0.0, 0.0, -1.0), direction=(1.0, 0.0, 0.0), priority=3), reach], ready, relax=True
    )
    assert np.linalg.norm(placed(upper, both.require().q, TIP).translation - far) <= np.linalg.norm(gave) + LENGTH


def test_the_same_question_has_the_same_answer_whatever_was_asked_before(solver, upper, ready, placed):
    goal = [Position.at(TIP, placed(upper, ready, TIP).translation + np.array([0.2, 0.1, 0.2]))]
    first = solver.solve(goal, ready)
    solver.solve([Position.at(TIP, [3.0, 0.0, 0.0])], ready)
    assert np.array_equal(solver.solve(goal, ready).q, first.q)
