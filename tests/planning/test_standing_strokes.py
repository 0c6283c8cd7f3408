"""Strokes at a template's instance by a robot on a free base: TALOS, where it stands or hangs in the world."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pinocchio as pin
import pytest

from affordance_templates import template_file
from affordance_templates.instance import Instance
from engines.planning.plan import Infeasible
from engines.planning.planners import Planners
from handrail.messages import Base, Foot, Pose
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics

HERE = pin.SE3(pin.utils.rotate("z", 0.7), np.array([1.0, 2.0, 1.0]))
"""the base in the world"""
TURN = (0.0, 0.0, math.sin(0.35), math.cos(0.35))
_STILL = (0.0, 0.0, 0.0)
BASE = Base(
    time_ns=0, pose_in_world=Pose(position=(1.0, 2.0, 1.0), orientation=TURN), linear_velocity=_STILL,
    angular_velocity=_STILL, position_deviation=0.0, orientation_deviation=0.0, source="feet",
    feet=[Foot(name=name, holds=True, force=(0.0, 0.0, 450.0)) for name in ("right", "left")],
)  # fmt: skip
KNOB = """
title: Knob
parameters: {}
objects:
  body: {shapes: [{kind: box, size: [0.02, 0.02, 0.02]}]}
trajectories:
  point:
    waypoints:
      - {name: before, approach: free, position: [-0.15, 0, 0], axis: [1, 0, 0]}
      - {name: near, approach: straight, position: [-0.12, 0, 0], axis: [1, 0, 0], speed: 0.1}
"""


@pytest.fixture(scope="module")
def planners() -> Planners:
    return Planners(robots.load("talos"))


@pytest.fixture(scope="module")
def home() -> np.ndarray:
    return np.asarray(robots.load("talos").home_position("ready"))


@pytest.fixture(scope="module")
def knob(tmp_path_factory, home) -> Instance:
    """Ahead of the right hand, its x as the base's."""
    file = tmp_path_factory.mktemp("templates") / "knob.yaml"
    file.write_text(KNOB)
    hand = Kinematics(robots.load("talos")).frame(home, "grasp_right").translation
    place = HERE.act(hand + np.array([0.25, 0.0, 0.05]))
    return Instance("knob_1", template_file.read(file), Pose(position=tuple(place.tolist()), orientation=TURN))


@pytest.mark.parametrize("source", ["feet", "still"])
def test_a_stroke_goes_to_where_the_instance_is_in_the_world_from_where_the_robot_is(source, planners, home, knob):
    base = msgspec.structs.replace(BASE, source=source)
    plan = planners.plan(knob, "point", "right", home, base=base)
    description = robots.load("talos")
    end = home.copy()
    end[description.index(plan.joints)] = plan.segments[-1].positions[-1]
    tip = HERE * Kinematics(description).frame(end, "grasp_right")
    wanted = np.array(knob.pose_in_world.position) - 0.12 * HERE.rotation[:, 0]
    assert np.linalg.norm(tip.translation - wanted) < 0.003
    assert planners.rank(knob, home, arms=["right"], base=base)[0].share == 1.0


def test_from_elsewhere_the_same_instance_is_out_of_reach(planners, home, knob):
    away = msgspec.structs.replace(BASE, pose_in_world=Pose(position=(0.0, 2.0, 1.0), orientation=TURN))
    with pytest.raises(Infeasible, match="reach of the tool's tip"):
        planners.plan(knob, "point", "right", home, base=away)


def test_a_stroke_keeps_the_balance_of_a_robot_that_stands(planners, home, knob):
    heavy = home.copy()
    heavy[robots.load("talos").index(["leg_right_5_joint", "leg_left_5_joint"])] += 0.5
    with pytest.raises(Infeasible, match="before: balance on the feet"):
        planners.plan(knob, "point", "right", heavy, base=BASE)
    assert planners.plan(knob, "point", "right", heavy, base=msgspec.structs.replace(BASE, source="still")).segments


def test_a_stroke_of_a_robot_of_which_nobody_knows_how_it_stands_is_refused(planners, home, knob):
    falling = msgspec.structs.replace(BASE, source="none", problem="no foot was felt")
    for ask in (
        lambda: planners.plan(knob, "point", "right", home, base=falling),
        lambda: planners.rank(knob, home, base=falling),
    ):
        with pytest.raises(ValueError, match=r"base: got none \(no foot was felt\)"):
            ask()
