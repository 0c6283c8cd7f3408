"""The strokes after the first: back along the circle, on the same arc and posture branch; retries; other arms."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

from affordance_templates.joint_estimate import joint_after_push
from engines.planning.collision.bodies import CollisionScene
from engines.planning.collision.obstacles import obstacles_of
from engines.planning.constraints import CLEARANCE, SELF_CLEARANCE
from engines.planning.ik.mechanism import Mechanism
from engines.planning.plan import Infeasible
from handrail.robot.guarding import Guarding


def after(plan, position, description, segment=None, share=1.0):
    """Where the robot is commanded when it has run a plan, or a share of one of its segments."""
    stopped = plan.segments[-1] if segment is None else plan.segment(segment)
    position = position.copy()
    position[description.index(plan.joints)] = stopped.positions[round(share * (len(stopped.times) - 1))]
    return position


def turned(wheel, plan):
    resolved = wheel.resolve()
    entry = resolved.trajectories["turn"].entry
    angle = joint_after_push(resolved.joints["hinge"], entry, plan.outputs["entry_angle"], plan.outputs["end_angle"])
    return dataclasses.replace(wheel, joint_state={"hinge": angle})


def test_strokes_on_one_arc_turn_the_wheel_by_285_degrees_within_four(seeded_plans, planner, description):
    for placed, first in seeded_plans[::10]:
        wheel, plan, position = placed, first, description.home_position("ready")
        for _ in range(3):
            position = after(plan, position, description)
            wheel = turned(wheel, plan)
            plan = planner.plan(wheel, "turn", "right", position, arc=first.outputs["arc_centre"])
            assert [s.name for s in plan.segments] == ["return", "engage", "turn", "release", "withdraw"]
            assert np.abs(plan.segments[0].positions[0] - position[description.index(plan.joints)]).max() < 1e-6
            for one, other in itertools.pairwise(plan.segments):
                assert np.abs(one.positions[-1] - other.positions[0]).max() < 1e-6
            same_place = plan.segment("turn").positions[-1] - first.segment("turn").positions[-1]
            assert np.abs(same_place).max() < 0.25, "still the same branch"
        assert turned(wheel, plan).joint_state["hinge"] > np.deg2rad(285)


def test_the_return_stays_in_front_of_the_wheel(seeded_plans, planner, description, kinematics, in_world, whole):
    wheel, plan = seeded_plans[0]
    position = after(plan, description.home_position("ready"), description)
    second = planner.plan(turned(wheel, plan), "turn", "right", position, arc=plan.outputs["arc_centre"])
    for q in whole(second, second.segment("return").positions[::5]):
        tip = (in_world(wheel).inverse() * kinematics.frame(q, "tool_right_tip")).translation
        assert tip[0] == pytest.approx(-0.08, abs=0.003)
        assert np.hypot(tip[1], tip[2]) == pytest.approx(0.10, abs=0.003)


def test_a_retry_draws_back_first_and_enters_later_on_the_arc(nominal_wheel, nominal_plan, planner, description):
    home, plan = description.home_position("ready"), nominal_plan
    tripped = after(plan, home, description, "engage", 0.7)
    shift = np.deg2rad(12)
    retry = planner.plan(nominal_wheel, "turn", "right", tripped, arc=plan.outputs["arc_centre"], entry_shift=shift)
    assert [s.name for s in retry.segments] == ["retreat", "return", "engage", "turn", "release", "withdraw"]
    assert retry.outputs["arc_centre"] == plan.outputs["arc_centre"]
    assert retry.outputs["entry_angle"] >= plan.outputs["entry_angle"] + shift - 1e-9
    with pytest.raises(Infeasible, match="entry"):
        planner.plan(
            nominal_wheel, "turn", "right", tripped, arc=plan.outputs["arc_centre"], entry_shift=np.deg2rad(125)
        )


def test_the_approach_leads_around_what_stands_in_the_straight_line(wheel_at, planner, description, kinematics):
    wheel = wheel_at([0.5524, -0.2599, 0.2288], [0.3142, -0.1318, -0.0537])
    start = description.home_position("ready")
    rows = description.index(description.arms["right"].joints)
    start[rows] = [0.004, -0.127, 1.099, -0.109, -0.221, -0.693, 0.029, -1.27, -0.469]
    arm = description.arms["right"]
    scene = CollisionScene(Mechanism.of(kinematics), description, arm, obstacles_of(wheel), wheel.name)
    approach = planner.plan(wheel, "turn", "right", start).segments[0].positions
    share = np.linspace(0.0, 1.0, 60)[:, None]
    positions = np.repeat(start[None], 60, axis=0)
    positions[:, rows] = (1 - share) * approach[0] + share * approach[-1]
    straight = min(scene.to_obstacles(positions, tool_may_touch=False).distance, scene.to_self(positions).distance)
    assert straight < 0.01
    positions = np.repeat(start[None], len(approach), axis=0)
    positions[:, rows] = approach
    assert scene.to_obstacles(positions, tool_may_touch=False).distance >= CLEARANCE.bound - 1e-3
    assert scene.to_self(positions).distance >= SELF_CLEARANCE.bound - 1e-3


def test_a_stroke_keeps_what_the_robots_own_guard_wants(nominal_wheel, kinematics, description):
    """m: the guard's margin is in the robot's file, and so the daemon and the planner have it from one place."""
    wary = dataclasses.replace(description, guard=Guarding(margin=0.05))
    scenes = [
        CollisionScene(Mechanism.of(kinematics), robot, robot.arms["right"], obstacles_of(nominal_wheel), "it")
        for robot in (description, wary)
    ]
    home = description.home_position("ready")[None]
    assert scenes[0].to_self(home).distance == scenes[1].to_self(home).distance
    usual, more = (scene.itself.slack(scene.to_self(home).distance) for scene in scenes)
    assert usual - more == pytest.approx(0.05 - description.guard.margin)
    between = scenes[1].margins.floors(scenes[1].world) - scenes[0].margins.floors(scenes[0].world)
    assert between[scenes[0].world.of_itself] == pytest.approx(0.05 - description.guard.margin)
    assert not between[~scenes[0].world.of_itself].any()


def test_with_an_arc_given_but_the_arm_elsewhere_it_comes_in_anew_on_that_arc(
    nominal_wheel, nominal_plan, planner, description
):
    home, plan = description.home_position("ready"), nominal_plan
    again = planner.plan(nominal_wheel, "turn", "right", home, arc=plan.outputs["arc_centre"])
    assert again.segments[0].name == "approach"
    assert again.outputs["arc_centre"] == plan.outputs["arc_centre"]


def test_the_left_arm_turns_a_wheel_on_its_own_side(wheel_at, planner, description):
    plan = planner.plan(
        wheel_at(np.array([0.55, 0.35, 0.30]), np.zeros(3)), "turn", "left", description.home_position("ready")
    )
    assert plan.joints == description.arms["left"].joints
    assert plan.segment("turn").path_force.frame == "tool_left_tip"


def test_a_first_stroke_leaves_the_wheel_before_it_comes_in_anew(seeded_plans, planner, description):
    for placed, interrupted in seeded_plans[::5]:
        position = after(interrupted, description.home_position("ready"), description, "turn", 0.6)
        plan = planner.plan(placed, "turn", "right", position)
        assert [segment.name for segment in plan.segments[:2]] == ["retreat", "approach"]
        assert np.abs(plan.segments[0].positions[0] - position[description.index(plan.joints)]).max() < 1e-6
        for one, other in itertools.pairwise(plan.segments):
            assert np.abs(one.positions[-1] - other.positions[0]).max() < 1e-6
