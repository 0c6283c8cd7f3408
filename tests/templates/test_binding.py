"""Templates bound to robots' hands: where the tip goes, mirrored or not, both hands in time, and that arms can be there."""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from affordance_templates import catalogue
from affordance_templates.binding import bind, bind_together, schedule
from affordance_templates.instance import Instance
from affordance_templates.placement import to_message, turn_about
from affordance_templates.template import Sync
from engines.planning.goals import GoalReader
from engines.planning.ik.mechanism import Mechanism
from engines.planning.ik.solver import Solver
from handrail.messages import Pose
from handrail.robot import library as robots
from handrail.robot.description import Palm, RobotDescription
from handrail.robot.kinematics import Kinematics

UP = np.array([0.0, 0.0, 1.0])


def instance_of(template: str, position, yaw: float = 0.0, **parameters: float) -> Instance:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn_about(UP, yaw), position
    return Instance("it", catalogue.load(template), to_message(pose), parameters)


@functools.cache
def robot(name: str) -> tuple[RobotDescription, Solver, np.ndarray]:
    description = robots.load(name)
    mechanism = Mechanism.of(Kinematics(description))
    home = dict(zip(description.joints, description.home_position("ready"), strict=True))
    return description, Solver(mechanism), mechanism.configuration(np.array([home[j] for j in mechanism.joints]))


def unreachable(name: str, bound) -> list[str]:
    """Waypoints that no posture of the arm has, whatever stands in the way."""
    description, solver, home = robot(name)
    reader = GoalReader(description, solver.mechanism, {}, "", bound.arm.joints)
    start, missed = home, []
    for each in bound.waypoints:
        constraints = reader.constraints([each.goal()], each.waypoint.name)
        answer = solver.solve(constraints, home, start=start, moving=bound.arm.joints, starts=30)
        if answer.feasible:
            start = answer.q
        else:
            missed.append(f"{bound.trajectory.name}.{each.waypoint.name}: {answer.violations[0]}")
    return missed


TALOS = {  # where the right hand meets it, m; the left hand at the mirror image
    "box": (0.50, -0.32, 0.10),
    "button_panel": (0.55, -0.35, 0.20),
    "cap": (0.42, -0.30, 0.00),
    "cylinder": (0.50, -0.32, 0.10),
    "door": (0.50, 0.10, 0.15),
    "drill": (0.50, -0.30, 0.10),
    "lever_valve": (0.50, -0.30, 0.15),
    "wheel": (0.55, -0.35, 0.30),
}
PANDA = {
    "box": (0.55, 0.00, 0.45),
    "button_panel": (0.55, 0.00, 0.45),
    "cap": (0.50, 0.00, 0.20),
    "cylinder": (0.55, 0.00, 0.45),
    "door": (0.60, 0.25, 0.40),
    "drill": (0.50, 0.00, 0.30),
    "lever_valve": (0.60, 0.00, 0.40),
    "wheel": (0.60, 0.00, 0.40),
}


@pytest.mark.parametrize("template", list(TALOS))
@pytest.mark.parametrize(
    ("name", "arm", "side"), [("talos_upper", "right", 1), ("talos_upper", "left", -1), ("panda", "arm", 1)]
)
def test_an_arm_can_be_at_every_waypoint(template, name, arm, side):
    x, y, z = (PANDA if name == "panda" else TALOS)[template]
    parameters = {"width": 0.5, "hinge_side": side} if template == "door" else {}
    instance = instance_of(template, (x, side * y, z), **parameters)
    for trajectory, found in instance.resolve().trajectories.items():
        if found.hand in ("hand", "twisting"):
            assert unreachable(name, bind(instance, trajectory, robot(name)[0], {found.hand: arm})) == []


@pytest.mark.parametrize(
    ("template", "sync", "hands", "position"),
    [
        ("box", "carry", {"right": "right", "left": "left"}, (0.50, 0.0, 0.10)),
        ("cap", "open", {"twisting": "right", "holding": "left"}, (0.40, 0.0, 0.0)),
        ("cap", "open", {"twisting": "left", "holding": "right"}, (0.40, 0.0, 0.0)),
    ],
)
def test_two_arms_can_be_at_the_waypoints_of_two_hands(template, sync, hands, position):
    description = robot("talos_upper")[0]
    instance = instance_of(template, position, **({"width": 0.3} if template == "box" else {"hold_from": 180}))
    for bound in bind_together(instance, sync, description, hands).values():
        assert unreachable("talos_upper", bound) == []


def test_the_tip_points_where_the_waypoint_says_and_is_a_palm_away_from_it():
    description, *_ = robot("panda")
    instance = instance_of("box", (0.5, 0.1, 0.3), yaw=math.pi / 2)
    around = bind(instance, "grasp", description, {}).waypoints[1]
    assert -around.tip_in_world[:3, 2] == pytest.approx([0, 1, 0]), "the box is turned by 90°"
    assert around.tip_in_world[:3, 3] == pytest.approx([0.5, 0.1 - 0.03 + 0.02, 0.3])
    arm = dataclasses.replace(description.arms["arm"], palm=Palm(position=(0, 0, 0.05), rpy=(0, 0, math.pi / 2)))
    other = dataclasses.replace(description, arms={"arm": arm})
    offset = bind(instance, "grasp", other, {}).waypoints[1]
    assert offset.tip_in_world[:3, 3] == pytest.approx([0.5, 0.1 - 0.01 + 0.05, 0.3])
    assert abs(offset.tip_in_world[:3, 0] @ around.tip_in_world[:3, 1]) == pytest.approx(1)


def test_hand_poses_are_the_robots_own_and_a_rigid_tool_takes_any(template_of, cabinet_text):
    box = instance_of("box", (0.5, 0, 0.3))
    fingers = [each.fingers for each in bind(box, "grasp", robot("panda")[0], {}).waypoints]
    assert fingers == [{"panda_finger_joint1": 0.04}, {"panda_finger_joint1": 0.04}, {"panda_finger_joint1": 0.0}, {}]
    assert bind(box, "grasp", robot("talos_upper")[0], {"hand": "left"}).waypoints[0].fingers == {}
    pinching = template_of(cabinet_text.replace("hand_pose: closed", "hand_pose: pinched"))
    with pytest.raises(ValueError, match="no 'pinched'; expected one of open, closed"):
        bind(Instance("it", pinching, Pose()), "open", robot("panda")[0], {})


def test_the_other_sides_hand_does_the_mirror_image(cabinet):
    description, *_ = robot("talos_upper")
    instance = Instance("it", cabinet, Pose(position=(0.5, 0.0, 0.2)))
    right, left = (bind(instance, "open", description, {"opening": side}) for side in ("right", "left"))
    assert (right.mirrored, left.mirrored) == (False, True)
    handle = instance.resolve().frame("handle")[:3, 3] + [0.5, 0, 0.2]
    one, other = right.waypoints[0].tip_in_world, left.waypoints[0].tip_in_world
    assert one[:3, 3] - handle == pytest.approx([-0.1, 0.03, 0])
    assert other[:3, 3] - handle == pytest.approx([-0.1, -0.03, 0])
    for each in (*right.waypoints, *left.waypoints):
        assert np.linalg.det(each.tip_in_world[:3, :3]) == pytest.approx(1)
    assert left.waypoints[2].force_in_world == pytest.approx(right.waypoints[2].force_in_world), "the handle goes down"
    assert not bind(instance, "open", description, {"opening": "left"}, mirrored=False).mirrored


def test_a_goal_has_the_waypoints_tolerance_and_what_turns_freely(cabinet):
    instance = Instance("it", cabinet, Pose())
    waypoints = bind(instance, "open", robot("panda")[0], {}).waypoints
    grasp, away = waypoints[1].goal(), waypoints[4].goal()
    assert grasp.below == grasp.above == pytest.approx((0.01, 0.04, 0.01))
    assert (grasp.about, grasp.angle) == ("", pytest.approx(math.radians(5)))
    assert (away.about, away.angle) == ("z", pytest.approx(math.radians(2)))


@pytest.mark.parametrize(
    ("template", "trajectory", "hands", "says"),
    [
        ("box", "fly", {}, "trajectory: got 'fly'; expected one of grasp"),
        ("box", "grasp", {}, r"hands\['hand'\]: got none; expected one of right, left"),
        ("box", "grasp", {"hand": "third"}, "got third; expected one of right, left"),
    ],
)
def test_what_can_not_be_bound_is_refused_with_what_was_expected(template, trajectory, hands, says):
    with pytest.raises(ValueError, match=says):
        bind(instance_of(template, (0.5, 0, 0)), trajectory, robot("talos_upper")[0], hands)


def test_one_arm_can_not_be_two_hands():
    cap = instance_of("cap", (0.4, 0, 0))
    with pytest.raises(ValueError, match="both right; expected an arm each"):
        bind_together(cap, "open", robot("talos_upper")[0], {"twisting": "right", "holding": "right"})
    with pytest.raises(ValueError, match="both arm; expected an arm each"):
        bind_together(cap, "open", robot("panda")[0], {})


def test_hands_wait_for_each_other_at_the_points_of_a_sync():
    sync = Sync("both", ("a", "b"), ({"a": 1, "b": 0}, {"a": 2, "b": 2}))
    times = schedule(sync, {"a": [1.0, 1.0, 1.0, 1.0], "b": [5.0, 1.0, 0.5]})
    assert times == {"a": [1.0, 5.0, 6.5, 7.5], "b": [5.0, 6.0, 6.5]}


@given(
    a=st.lists(st.floats(0, 100), min_size=4, max_size=8),
    b=st.lists(st.floats(0, 100), min_size=4, max_size=8),
    steps=st.lists(st.tuples(st.integers(1, 2), st.integers(1, 2)), max_size=2),
)
@settings(max_examples=40, deadline=None)
def test_nobody_is_early_and_those_who_meet_meet(a, b, steps):
    points, at = [], [-1, -1]
    for first, second in steps:
        at = [at[0] + first, at[1] + second]
        points.append({"a": at[0], "b": at[1]})
    times = schedule(Sync("both", ("a", "b"), tuple(points)), {"a": a, "b": b})
    for name, least in (("a", a), ("b", b)):
        taken = np.diff([0.0, *times[name]])
        assert (taken >= np.array(least) - 1e-9).all()
    for point in points:
        assert times["a"][point["a"]] == times["b"][point["b"]]


@pytest.mark.parametrize("given_", [{"a": [1.0]}, {"a": [1.0], "b": [-1.0]}, {"a": [math.nan], "b": [1.0]}])
def test_durations_that_are_none_are_refused(given_):
    with pytest.raises(ValueError, match="expected seconds of 0 or more"):
        schedule(Sync("both", ("a", "b"), ()), given_)
