"""What cameras see is kept clear of: not the robot itself, nor what is placed, and nothing that is old."""

from __future__ import annotations

from dataclasses import replace

import coal
import numpy as np
import pinocchio as pin
import pytest

from engines.planning.collision.margins import Margins
from engines.planning.collision.obstacles import obstacles_of
from engines.planning.collision.point_distance import PointDistance
from engines.planning.collision.seen import RESOLUTION, Eyes
from engines.planning.collision.sweep import Sweep, lines
from engines.planning.collision.world import World
from engines.planning.ik.constraints import Clearance, Position
from engines.planning.ik.solver import Solver
from engines.planning.plan import Infeasible
from engines.planning.planners import Planners
from engines.planning.timing.timing import Limits
from engines.planning.verifier import Verifier
from handrail import cloud
from handrail.messages import FrameGoal, PlanMotion, Pose

NOW = 20_000_000_000
PLACEMENT = pin.SE3(pin.rpy.rpyToMatrix(0.4, -0.7, 1.1), np.array([0.3, -0.2, 0.1]))


@pytest.fixture(scope="module")
def eyes(mechanism):
    return Eyes(mechanism)


@pytest.fixture(scope="module")
def board():
    """(n, 3) points every 1 cm on an upright board to the right of the chest, in front of the hand."""
    y, z = np.meshgrid(np.arange(-0.5, -0.2, 0.01), np.arange(-0.1, 0.3, 0.01))
    return np.column_stack([np.full(y.size, 0.45), y.ravel(), z.ravel()])


def picture(points, *, camera="head", age=0.4):
    return cloud.pack(camera, NOW - int(age * 1e9), points, None, (0.1, 0.0, 0.5))


SHAPES = [coal.Box(0.2, 0.1, 0.3), coal.Sphere(0.1), coal.Capsule(0.05, 0.2), coal.Cylinder(0.08, 0.2)]


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: type(shape).__name__)
def test_points_near_a_solid_are_those_that_coal_finds_near(shape):
    points = PLACEMENT.translation + np.random.default_rng(1).uniform(-0.2, 0.2, (400, 3))
    ball = coal.Sphere(1e-6)
    found = PointDistance(shape).within(points, PLACEMENT, 0.03)
    for point, near in zip(points, found, strict=True):
        result = coal.DistanceResult()
        here = coal.Transform3s(np.eye(3), point)
        apart = coal.distance(
            shape,
            coal.Transform3s(PLACEMENT.rotation, PLACEMENT.translation),
            ball,
            here,
            coal.DistanceRequest(),
            result,
        )
        # At edges and corners the distance to the faces' planes is less than that to the solid.
        assert near or apart > 0.03 - 1e-5
        assert not near or apart < 0.03 * np.sqrt(3.0) + 1e-5
    assert 20 < found.sum() < 380


def test_points_on_a_link_are_the_links(eyes, mechanism, ready):
    data, scratch = mechanism.model.createData(), mechanism.geometry.createData()
    pin.updateGeometryPlacements(mechanism.model, data, mechanism.geometry, scratch, ready)
    corners = [
        scratch.oMg[k].act(point)
        for k, body in enumerate(mechanism.geometry.geometryObjects)
        if isinstance(body.geometry, coal.ConvexBase)
        for point in body.geometry.points()[::7]
    ]
    beside = np.array([[0.6, -0.3, 0.2]])
    found = eyes.solids([picture(np.vstack([corners, beside]))], NOW, ready)
    assert [camera.points for camera in found.cameras] == [1]
    (block,) = found.obstacles
    assert np.abs(block.geometry.toBoxes()[0][:3] - beside[0]).max() <= RESOLUTION


def test_the_newest_cloud_of_each_camera_counts_and_its_age_is_told(eyes, ready, board):
    clouds = [
        picture(board + 9.0, age=0.9),
        picture(board, age=0.4),
        picture(board[:5] + np.array([0.3, 0.0, 0.0]), camera="wrist", age=1.2),
        picture(board, camera="asleep", age=60.0),
    ]
    found = eyes.solids(clouds, NOW, ready)
    assert found.words == (
        f"asleep: left out, 60.0 s old, at most 5 s counts; head: {len(board)} points, 0.4 s old; wrist: 5 points, 1.2 s old"
    )
    assert {obstacle.label for obstacle in found.obstacles} == {"what head saw 0.4 s ago", "what wrist saw 1.2 s ago"}
    torn = picture(board)
    torn.points = b"torn"
    assert "head: left out, not readable: points" in eyes.solids([torn], NOW, ready).words
    assert eyes.solids([], NOW, ready).words == "no camera sees anything"


def test_points_on_an_instance_are_its_own(eyes, ready, wheel_at):
    wheel = wheel_at(np.array([0.55, -0.35, 0.30]), np.zeros(3))
    angles = np.linspace(0.0, 2.0 * np.pi, 200)
    rim = np.array([0.55, -0.35, 0.30]) + 0.15 * np.column_stack([0 * angles, np.cos(angles), np.sin(angles)])
    found = eyes.solids([picture(rim)], NOW, ready, obstacles_of(wheel))
    assert (found.obstacles, found.cameras[0].points) == ((), 0)
    assert eyes.solids([picture(rim)], NOW, ready).cameras[0].points == len(rim)


def test_what_is_seen_is_met_by_motions_and_avoided_by_inverse_kinematics(eyes, mechanism, ready, board, description):
    seen = eyes.solids([picture(board)], NOW, ready)
    world = World(
        mechanism, seen.obstacles, description.allowed_collision_pairs, moving=description.arms["right"].joints
    )
    beyond = Position.at("tool_right_tip", (0.6, -0.35, 0.1), name="reach")
    solver = Solver(mechanism)
    through = solver.solve([beyond], ready)
    assert through.feasible
    floors = Margins(itself=-np.inf, objects=0.02).floors(world)
    met = Sweep(world).meeting(lines(np.array([ready, through.q])), floors)
    assert met is not None
    assert met.between.endswith("and what head saw 0.4 s ago")
    short = Position.at("tool_right_tip", (0.4, -0.35, 0.1), name="near", tolerance=0.04)
    answer = solver.solve([short, Clearance(scene=world, at_least=0.03)], ready)
    assert answer.feasible
    data, scratch = mechanism.model.createData(), world.geometry.createData()
    pin.forwardKinematics(mechanism.model, data, answer.q)
    pin.updateGeometryPlacements(mechanism.model, data, world.geometry, scratch)
    pin.computeDistances(world.geometry, scratch)
    assert min(one.min_distance for one in scratch.distanceResults) >= 0.03 - 1e-4


def test_a_motion_keeps_clear_of_what_is_seen(ready, board, description):
    planner = Planners(description).motions
    home = description.home_position("ready")
    seen = planner.see([picture(board)], NOW, home, [])
    goal = FrameGoal(pose=Pose(position=(0.42, -0.35, 0.1)), angle=np.pi)
    question = planner.read(PlanMotion(goals=[goal], arm="right", clearance=0.02), [])
    world = World(planner.mechanism, seen.obstacles, description.allowed_collision_pairs, moving=question.moving)
    margins = Margins(0.02, 0.02)

    def missed(plan):
        limits = planner.limits_of(plan.joints, ready)
        found = Verifier(world, margins=margins).violations(plan, limits, ready)
        return {violation.measure.constraint for violation in found}

    assert missed(planner.plan(question, home)) == {"clearance"}, "what nobody sees is run into"
    around = FrameGoal(pose=Pose(position=(0.38, -0.35, 0.1)), angle=np.pi)
    heeding = replace(planner.read(PlanMotion(goals=[around], arm="right", clearance=0.02), []), seen=seen.obstacles)
    assert missed(planner.plan(heeding, home)) == set()
    with pytest.raises(Infeasible, match=r"what head saw 0\.4 s ago"):
        planner.plan(replace(question, seen=seen.obstacles), home)


def ball(centre, radius):
    """(n, 3) points about a place, 1 cm apart."""
    steps = np.arange(-radius, radius + 1e-9, 0.01)
    grid = np.array(np.meshgrid(steps, steps, steps)).reshape(3, -1).T
    return centre + grid[np.linalg.norm(grid, axis=1) <= radius]


def test_a_stroke_leads_its_arm_around_what_is_seen_and_touches_what_stands_where_it_works(
    eyes, ready, planner, nominal_wheel, nominal_plan, description, kinematics, whole, mechanism
):
    home, blind = description.home_position("ready"), nominal_plan
    approach, engage = blind.segment("approach"), blind.segment("engage")

    def tip(q):
        return kinematics.frame(whole(blind, q[None])[0], "tool_right_tip").translation

    on_the_way = tip(approach.positions[len(approach.times) // 2])
    there = ball(on_the_way, 0.03)
    where_it_works = ball(tip(engage.positions[-1]), 0.01)
    seen = eyes.solids([picture(np.vstack([there, where_it_works]))], NOW, ready)
    plan = planner.plan(nominal_wheel, "turn", "right", home, seen=seen.obstacles)
    rows = description.index(plan.joints)
    limits = Limits(planner.limits.velocity[rows], planner.limits.acceleration[rows])

    def missed(plan, points):
        world = World(
            mechanism, eyes.solids([picture(points)], NOW, ready).obstacles, description.allowed_collision_pairs,
            moving=plan.joints,
        )  # fmt: skip
        found = Verifier(world, margins=Margins(itself=-np.inf, objects=0.015)).violations(plan, limits, ready)
        return {violation.segment for violation in found}

    assert missed(blind, there) >= {"approach"}
    assert missed(plan, there) == set()
    touched = missed(plan, where_it_works)
    assert touched and touched <= {"engage", "turn", "release", "withdraw"}, "the tool may, there"
