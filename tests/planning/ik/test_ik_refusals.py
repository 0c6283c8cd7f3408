"""Questions that can't be meant are refused before anything moves: field, value, and what was expected."""

from __future__ import annotations

import math

import numpy as np
import pytest

from engines.planning.collision.world import World
from engines.planning.ik.constraints import (
    Balance,
    BodyDistance,
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
from engines.planning.ik.mechanism import Mechanism
from handrail.messages import Pose as PoseMessage

NAN, INF = math.nan, math.inf
TIP = "tool_right_tip"


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Position.at(TIP, [NAN, 0, 0]), r"Position: lower, upper: got .*nan"),
        (lambda: Position(frame=TIP, lower=(0, 0, 1), upper=(0, 0, 0.5), name="grasp"), "grasp: lower, upper"),
        (lambda: Position(frame=TIP, lower=(INF, 0, 0), upper=(INF, 0, 0)), "bounds that some number keeps"),
        (lambda: Position(frame=TIP, lower=(0, 0, 0), upper=(0, 0, 0), point=(INF, 0, 0)), "point: .*finite"),
        (lambda: Pose(frame=TIP, target=PoseMessage(position=(0.0, NAN, 0.0))), "target: got .*nan.* finite"),
        (lambda: Pose(frame=TIP, target=PoseMessage(orientation=(0.0,) * 4)), "target: .*unit quaternion"),
        (lambda: Orientation(frame=TIP, target=(0, 0, 0, 1), angle=-0.1), "angle: got -0.1; expected an angle from 0"),
        (lambda: Orientation(frame=TIP, target=(0, 0, 0, 2.0)), "unit quaternion"),
        (lambda: Direction(frame=TIP, axis=(0, 0, 0), direction=(1, 0, 0)), "axis: .*longer than 0"),
        (lambda: Direction(frame=TIP, axis=(0, 0, 1), direction=(NAN, 0, 0)), "direction: .*finite"),
        (lambda: Gaze(frame=TIP, target=(1, 0, 0)), "cone: got 0.0; expected a half-angle above 0"),
        (lambda: PointDistance(frame=TIP, other="", lower=0.2, upper=0.1), "lower, upper"),
        (lambda: PointDistance(frame=TIP, other="", lower=-2.0, upper=-1.0), "upper: got -1.0; expected 0 or more"),
        (lambda: Balance(contacts={"": [(0, 0, 0), (1, 0, 0)]}), "contacts: .*3 points"),
        (lambda: Posture(coefficients={"torso_1_joint": 0.0}), "coefficients: .*factor other than 0"),
        (lambda: JointLimits(margin=-0.1), "margin: got -0.1"),
        (lambda: JointLimits(priority=-1), "priority: got -1"),
        (lambda: JointLimits(window=(2.0, 1.0)), "window: .*not after"),
    ],
)
def test_a_constraint_that_can_not_be_meant_is_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()


@pytest.mark.parametrize(
    ("constraint", "words"),
    [
        (Position.at("tool_rihgt_tip", [0, 0, 0]), "frame: got 'tool_rihgt_tip'; expected one like tool_right_tip"),
        (Position.at(TIP, [0, 0, 0], in_frame="moon", name="reach"), "reach: frame: got 'moon'"),
        (Posture(coefficients={"arm_3": 1.0}), "joint: got 'arm_3'; expected one"),
        (JointLimits(margin=9.0), "margin: got 9.0; expected at most .*half of what"),
        (
            Balance(contacts={"": [(0, 0, 0), (1, 0, 0), (2, 0, 0)]}),
            "balance: contacts: .*expected points that span an area",
        ),
    ],
)
def test_a_constraint_that_does_not_fit_the_robot_is_refused(constraint, words, solver, ready):
    with pytest.raises(ValueError, match=words):
        solver.solve([constraint], ready)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"nominal": np.zeros(3)}, r"nominal: got shape \(3,\); expected \(18,\)"),
        ({"nominal": np.full(18, np.nan)}, "nominal: got nan in row 0; expected finite"),
        ({"start": np.full(18, np.inf)}, "start: got inf"),
        ({"starts": 0}, "starts: got 0; expected 1 or more"),
        ({"moving": ["elbow"]}, "moving: joint: got 'elbow'"),
        ({"moving": []}, "moving: got .*expected a joint"),
        ({"weights": {"torso_1_joint": 0.0}}, r"weights\['torso_1_joint'\]: got 0.0; expected a finite number above 0"),
        ({"weights": {"elbow": 1.0}}, "weights: joint: got 'elbow'"),
    ],
)
def test_a_question_of_the_wrong_form_is_refused(more, words, solver, ready):
    with pytest.raises(ValueError, match=words):
        solver.solve([], **({"nominal": ready} | more))


def test_a_scene_of_another_robot_and_a_link_without_a_shape_are_refused(solver, upper, humanoid, ready):
    with pytest.raises(ValueError, match="scene: got one of another mechanism"):
        solver.solve([Clearance(scene=World(humanoid))], ready)
    with pytest.raises(ValueError, match=f"link: got '{TIP}'; expected one with a shape"):
        solver.solve([BodyDistance(scene=World(upper), link=TIP, other="head_2_link")], ready)


def test_a_joint_of_several_degrees_of_freedom_is_refused():
    import pinocchio as pin

    model = pin.Model()
    model.addJoint(
        model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "hinge"),
        pin.JointModelSpherical(),
        pin.SE3.Identity(),
        "ball",
    )
    with pytest.raises(ValueError, match=r"joint ball: .*several degrees of freedom"):
        Mechanism(model)
