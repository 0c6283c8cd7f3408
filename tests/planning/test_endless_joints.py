"""An arm whose joints turn without end: the shortest way round is gone, all of it checked."""

from __future__ import annotations

import dataclasses
import xml.etree.ElementTree as ET

import coal
import msgspec
import numpy as np
import pinocchio as pin
import pytest

from engines.planning.collision.connect import Connector
from engines.planning.collision.margins import Margins
from engines.planning.collision.obstacles import Obstacle
from engines.planning.collision.sweep import lines
from engines.planning.collision.world import World
from engines.planning.motion_planner import MotionPlanner
from engines.planning.plan import Plan
from engines.planning.timing.timing import Limits
from handrail.messages import FrameGoal, JointsGoal, KeyFrame, PlanMotion, PlanPreview, Pose
from handrail.robot import library as robots
from handrail.robot.description import RobotDescription
from handrail.robot.kinematics import Kinematics

ENDLESS = ("joint1", "joint6")


@pytest.fixture(scope="module")
def description(tmp_path_factory) -> RobotDescription:
    """Z1, its first and its last joint without limits: a robot's file has none such, since drives' frames count no turns."""
    limited = robots.load("z1")
    tree = ET.parse(limited.urdf)
    for joint in tree.getroot().findall("joint"):
        if joint.get("name") in ENDLESS:
            joint.set("type", "continuous")
    file = tmp_path_factory.mktemp("endless") / "z1.urdf"
    tree.write(file)
    lower, upper, rows = limited.lower.copy(), limited.upper.copy(), limited.index(ENDLESS)
    lower[rows], upper[rows] = -np.inf, np.inf
    return dataclasses.replace(limited, urdf=file, lower=lower, upper=upper)


@pytest.fixture(scope="module")
def planner(description) -> MotionPlanner:
    limits = Limits(0.5 * description.velocity_limit, 0.5 * description.acceleration_limit)
    return MotionPlanner(description, Kinematics(description), limits)


@pytest.fixture
def planned(planner, description):
    """(start of the first joint, call's fields) → the plan, and the first joint's way."""

    def plan(begin: float, **call) -> tuple[Plan, np.ndarray]:
        start = description.home_position("ready").copy()
        start[description.index("joint1")] = begin
        found = planner.plan(planner.read(PlanMotion(**call), []), start)
        column = found.joints.index("joint1")
        return found, np.concatenate([segment.positions[:, column] for segment in found.segments])

    return plan


@pytest.mark.parametrize(
    ("begin", "wanted", "end"),
    [(2.9, -2.9, 2 * np.pi - 2.9), (-2.9, 2.9, 2.9 - 2 * np.pi), (12.6, 0.5, 0.5 + 4 * np.pi), (0.2, 0.6, 0.6)],
)
def test_a_joint_without_end_goes_the_shortest_way_round(planned, begin, wanted, end):
    plan, way = planned(begin, goals=[JointsGoal(positions={"joint1": wanted})])
    assert way[0] == begin
    assert way[-1] == pytest.approx(end, abs=1e-6)
    assert np.ptp(way) == pytest.approx(abs(end - begin), abs=1e-3), "it turned back on its way"
    assert np.isfinite(plan.limit_margin)


def test_key_frames_are_said_in_the_turn_that_the_one_before_them_ends_in(planned):
    goals = [JointsGoal(positions={"joint1": -2.9})]
    _, way = planned(0.0, through=[KeyFrame(goals=[JointsGoal(positions={"joint1": 2.9})])], goals=goals)
    assert way[-1] == pytest.approx(2 * np.pi - 2.9, abs=1e-6)


def test_a_reach_behind_it_does_not_unwind_what_it_has_turned(planned, description):
    there = description.home_position("ready").copy()
    there[description.index("joint1")] = -3.0
    tip = next(iter(description.arms.values())).tip
    place = Kinematics(description).frame(there, tip)
    x, y, z = place.translation.tolist()
    orientation = tuple(pin.Quaternion(place.rotation).coeffs().tolist())
    plan, way = planned(3.0, goals=[FrameGoal(pose=Pose(position=(x, y, z), orientation=orientation))])
    assert np.ptp(way) < 1.0
    end = there.copy()
    end[description.index(plan.joints)] = plan.segments[-1].positions[-1]
    assert np.linalg.norm(Kinematics(description).frame(end, tip).translation - place.translation) < 2e-4


def test_a_way_around_is_found_where_a_joint_has_no_limits_to_draw_from(planner, description):
    mechanism, home = planner.mechanism, description.home_position("ready")
    start, goal = (planner.configuration("position", home) for _ in range(2))
    row = mechanism.coordinate[mechanism.row("joint1")]
    start[row], goal[row] = -0.9, 0.9
    data = mechanism.model.createData()
    pin.framesForwardKinematics(mechanism.model, data, planner.configuration("position", home))
    tip = data.oMf[mechanism.frame_id(next(iter(description.arms.values())).tip)].translation
    post = Obstacle("post", coal.Box(0.05, 0.05, 2.0), pin.SE3(np.eye(3), np.array([tip[0], tip[1], 0.0])))
    world = World(mechanism, [post], description.allowed_collision_pairs)
    connector = Connector(world, margins=Margins(0.005, 0.01))
    assert connector.sweep.meeting(lines(np.array([start, goal])), connector.floors) is not None
    way = connector.way(start, goal)
    assert connector.sweep.meeting(lines(way), connector.floors) is None
    assert np.array_equal(way[[0, -1]], [start, goal])


def test_what_clients_are_told_of_it_is_the_same_in_json_and_messagepack(planned):
    plan, _ = planned(2.9, goals=[JointsGoal(positions={"joint1": -2.9})])
    told = plan.preview(True)
    assert msgspec.json.decode(msgspec.json.encode(told), type=PlanPreview) == told
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(told), type=PlanPreview) == told
