"""Goal after goal in one compiled call: joints are where pinocchio has them, misses are what the checker measures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from engines.planning.ik.checker import ANGLE, LENGTH, Checker
from engines.planning.ik.constraints import Balance, Direction, JointLimits, Orientation, Position
from engines.planning.ik.follower import COLD, Follower
from engines.planning.ik.mechanism import flat
from engines.planning.ik.tree import place, tree_of

TOOL = "arm_right_tool_link"
HERE = (0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def tiago(arms):
    """A prismatic joint, then seven that turn."""
    return arms["tiago_pro"].mechanism


@pytest.fixture(scope="module")
def line(tiago, placed):
    """(k, 12) goals on 20 cm, turned by 0.4 rad about what they point along, and the posture that is at the first."""
    q = tiago.within_limits(pin.neutral(tiago.model))
    q[tiago.q_rows[1:]] = [0.3, 0.6, 0.2, -1.2, 0.3, 0.4, 0.2]
    first = placed(tiago, tiago.within_limits(q), TOOL)
    goals = [
        first * pin.SE3(pin.exp3(np.array([0.0, 0.0, 0.4 * s])), np.array([0.0, 0.1 * s, -0.2 * s]))
        for s in np.linspace(0.0, 1.0, 21)
    ]
    return np.array([flat(goal) for goal in goals]), tiago.within_limits(q)[tiago.q_rows]


@pytest.fixture(scope="module")
def said_at(message):
    """(goal (12,), constraint in the world) → the constraint as the goal carries it."""

    def said(goal, constraint):
        carried = pin.SE3(goal[:9].reshape(3, 3).T, goal[9:])
        if isinstance(constraint, Position):
            return replace(constraint, box=message(carried))
        return replace(constraint, direction=tuple(carried.rotation @ constraint.direction))

    return said


def test_joints_are_where_pinocchio_has_them_and_move_as_it_says(tiago):
    tree = tree_of(tiago, tiago.joints)
    data, generator = tiago.model.createData(), np.random.default_rng(0)
    placement, jacobian = np.zeros((tiago.model.njoints, 12)), np.zeros((tiago.nv, 6))
    for _ in range(20):
        q = tiago.within_limits(tiago.configuration(generator.uniform(-2.0, 2.0, len(tiago.joints))))
        pin.computeJointJacobians(tiago.model, data, q)
        place(tree, q[tiago.q_rows], placement, jacobian)
        for joint in tree.joints.tolist():
            assert np.allclose(placement[joint], flat(data.oMi[joint]), atol=1e-12)
        assert np.allclose(jacobian[tree.velocities], data.J.T[tree.velocities], atol=1e-12)


def test_every_goal_on_a_line_is_met_next_to_the_one_before_and_the_checker_agrees(tiago, line, said_at):
    goals, posture = line
    constraints = [
        Position.at(TOOL, HERE),
        Direction(frame=TOOL, axis=(0.0, 0.0, 1.0), direction=(0.0, 0.0, 1.0)),
        JointLimits(margin=0.02),
    ]
    found = Follower(tiago, constraints, tiago.joints).solve(posture[None], goals, posture)
    assert np.abs(np.diff(found.q, axis=0)).max() < 0.2
    checker = Checker(tiago)
    for goal, q, missed in zip(goals, found.q, found.missed, strict=True):
        said = [said_at(goal, one) for one in constraints[:2]] + constraints[2:]
        assert checker.violations(said, tiago.configuration(q)) == ()
        assert (missed[:2] < [LENGTH, ANGLE]).all()


def test_what_is_out_of_reach_is_missed_by_as_much_as_the_checker_says_within_limits(tiago, line, said_at):
    goals, posture = line
    far = goals[:1].copy()
    far[:, 9:] += [3.0, 0.0, 0.5]
    there = Position.at(TOOL, HERE)
    along = Direction(frame=TOOL, axis=(0.0, 0.0, 1.0), direction=(0.0, 0.0, 1.0))
    follower = Follower(tiago, [there, along, JointLimits(margin=0.02)], tiago.joints)
    found = follower.solve(posture[None], far, posture, COLD)
    measures = Checker(tiago).measures(
        [said_at(far[0], one) for one in (there, along)], tiago.configuration(found.q[0])
    )
    assert found.missed[0, 0] > 1.5
    assert found.missed[0, 0] == pytest.approx(np.linalg.norm([m.by for m in measures if m.unit == "m"]), abs=1e-9)
    assert found.missed[0, 1] == pytest.approx(measures[-1].by, abs=1e-9)
    assert ((found.q >= follower.lower) & (found.q <= follower.upper)).all()


def test_what_it_cannot_follow_is_refused_by_name(tiago, humanoid):
    at = Position.at(TOOL, HERE)
    with pytest.raises(ValueError, match=r"moving: got arm_right_1_joint without torso_lift_joint, on which it hangs"):
        Follower(tiago, [at], tiago.joints[1:])
    with pytest.raises(ValueError, match=r"moving: got torso_lift_joint; expected arm_right_1_joint as well"):
        Follower(tiago, [at], tiago.joints[:1])
    with pytest.raises(ValueError, match=r"moving: .*joint: got 'elbow'"):
        Follower(tiago, [at], ["elbow"])
    with pytest.raises(ValueError, match=r"free base"):
        Follower(humanoid, [Orientation(frame="torso_2_link", target=(0.0, 0.0, 0.0, 1.0))], humanoid.joints)
    stand = Balance(contacts={TOOL: ((0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.0, 0.1, 0.0))})
    with pytest.raises(ValueError, match=r"got Balance; expected one of frames or joints"):
        Follower(tiago, [stand], tiago.joints)
    with pytest.raises(ValueError, match=r"palm: got bounds; expected what is kept exactly"):
        Follower(tiago, [at, Position.at(TOOL, HERE, tolerance=0.01, name="palm")], tiago.joints)
    with pytest.raises(ValueError, match=r"weights\['torso_lift_joint'\]: got -1.0"):
        Follower(tiago, [at], tiago.joints, {"torso_lift_joint": -1.0})
