"""Twenty seeded wheels: every plan reaches, points, keeps limits and clearances, judged by pinocchio and not by the solver."""

from __future__ import annotations

import itertools

import coal
import numpy as np
import pinocchio as pin
import pytest

from engines.planning.constraints import CLEARANCE, LIMIT_MARGIN
from engines.planning.strokes.manipulation import VELOCITY_SHARE
from engines.planning.timing.timing import Knots, accelerations, peak_velocities
from handrail.messages import PoseErrorEnd

ENGAGE_RADIUS = 0.10
WAYPOINTS = ["approach", "standoff", "engage", "turn", "release", "withdraw"]


def tips_in_wheel(kinematics, wheel_in_world, positions, frame):
    """(k, 3) tip and (k, 3) pointing direction, in the wheel's frame, by pinocchio."""
    tips = [wheel_in_world.inverse() * kinematics.frame(position, frame) for position in positions]
    return np.array([tip.translation for tip in tips]), np.array([-tip.rotation[:, 2] for tip in tips])


def test_every_wheel_within_ten_centimetres_and_twenty_degrees_is_planned(seeded_plans):
    assert [[segment.name for segment in plan.segments] for _, plan in seeded_plans] == [WAYPOINTS] * 20


def test_the_tip_follows_line_and_circle_within_two_millimetres(seeded_plans, kinematics, description, whole, in_world):
    for wheel, plan in seeded_plans:
        tip = description.arms[plan.arm].tip
        for name in ("standoff", "engage", "turn", "release", "withdraw"):
            q = plan.segment(name).positions[::6]
            position, axis = tips_in_wheel(kinematics, in_world(wheel), whole(plan, q), tip)
            assert np.abs(np.hypot(position[:, 1], position[:, 2]) - ENGAGE_RADIUS).max() < 0.002, name
            assert np.arccos(np.clip(axis[:, 0], -1, 1)).max() < 0.05, name
            if name in ("turn", "release"):
                assert np.abs(position[:, 0] - 0.02).max() < 0.002
            if name in ("standoff", "engage", "withdraw"):
                angle = np.unwrap(np.arctan2(position[:, 2], position[:, 1]))
                assert np.ptp(angle) * ENGAGE_RADIUS < 0.004, "straight in and out, at one angle"
        end, _ = tips_in_wheel(kinematics, in_world(wheel), whole(plan, plan.segments[-1].positions[-1:]), tip)
        assert end[0, 0] == pytest.approx(-0.08, abs=0.002)


def test_the_turn_ends_where_the_outputs_say_and_the_entry_is_clear_of_every_spoke(
    seeded_plans, kinematics, description, whole, in_world
):
    for wheel, plan in seeded_plans:
        tip = description.arms[plan.arm].tip
        ends = plan.segment("turn").positions[[0, -1]]
        position, _ = tips_in_wheel(kinematics, in_world(wheel), whole(plan, ends), tip)
        angles = np.arctan2(position[:, 2], position[:, 1])
        expected = np.array([plan.outputs["entry_angle"], plan.outputs["end_angle"]])
        assert np.abs(np.angle(np.exp(1j * (angles - expected)))).max() < 0.02
        assert plan.outputs["end_angle"] == pytest.approx(plan.outputs["arc_centre"] + np.deg2rad(60))
        spokes = np.pi / 2 * np.arange(4)
        gaps = np.abs(np.angle(np.exp(1j * (spokes - plan.outputs["entry_angle"]))))
        assert gaps.min() >= np.arcsin(0.022 / ENGAGE_RADIUS) + np.deg2rad(20) - 1e-9


def test_joint_limits_are_kept_with_a_margin(seeded_plans, description):
    for _, plan in seeded_plans:
        rows = description.index(plan.joints)
        q = np.vstack([segment.positions for segment in plan.segments])
        margin = np.minimum(q - description.lower[rows], description.upper[rows] - q).min()
        assert margin >= LIMIT_MARGIN.bound - 1e-3
        assert plan.limit_margin == pytest.approx(margin, abs=0.01)


def test_velocities_and_accelerations_stay_within_limits_and_segments_begin_and_end_at_rest(
    seeded_plans, description, planner
):
    for _, plan in seeded_plans:
        rows = description.index(plan.joints)
        for segment in plan.segments:
            knots = Knots(segment.times, segment.positions, segment.velocities)
            assert (peak_velocities(knots) <= VELOCITY_SHARE * description.velocity_limit[rows] + 1e-6).all()
            assert (np.abs(accelerations(knots)) <= planner.limits.acceleration[rows] * 1.001).all()
            assert not segment.velocities[[0, -1]].any()
            assert segment.times[0] == 0.0
            assert (np.diff(segment.times) > 0).all()
            assert np.diff(segment.times).max() < 0.05


def test_segments_last_at_least_what_their_waypoints_ask_for(seeded_plans):
    for wheel, plan in seeded_plans:
        for waypoint in wheel.resolve().trajectories["turn"].waypoints:
            assert plan.segment(waypoint.name).duration >= waypoint.duration - 1e-6


def test_segments_follow_each_other_without_a_gap_from_where_the_robot_is_commanded(seeded_plans, description):
    for _, plan in seeded_plans:
        home = description.home_position("ready")[description.index(plan.joints)]
        assert np.abs(plan.segments[0].positions[0] - home).max() < 1e-6
        assert np.abs(plan.start - home).max() < 1e-6
        for before, after in itertools.pairwise(plan.segments):
            assert np.abs(before.positions[-1] - after.positions[0]).max() < 1e-6


def real_wheel(in_world, angle):
    """The wheel's own solids, turned by `angle`: 24 pieces of rim, 4 spokes (not the planner's body of revolution)."""
    solids = []
    for i in range(24):
        a = 2 * np.pi * (i + 0.5) / 24 + angle
        rotation = pin.rpy.rpyToMatrix(a, 0, 0)  # its z turned from the hinge's zero along the rim
        centre = np.array([0, 0.15 * np.cos(a), 0.15 * np.sin(a)])
        solids.append((coal.Capsule(0.012, 2 * 0.15 * np.sin(np.pi / 24)), in_world * pin.SE3(rotation, centre)))
    for i in range(4):
        a = np.pi / 2 * i + angle
        rotation = pin.rpy.rpyToMatrix(a - np.pi / 2, 0, 0)
        centre = np.array([0, 0.075 * np.cos(a), 0.075 * np.sin(a)])
        solids.append((coal.Capsule(0.010, 0.13), in_world * pin.SE3(rotation, centre)))
    return solids


def test_all_but_the_tool_keeps_its_distance_from_the_real_wheel(
    seeded_plans, kinematics, description, whole, in_world
):
    model = kinematics.model
    robot = pin.buildGeomFromUrdf(model, str(description.urdf), pin.COLLISION)
    for wheel, plan in seeded_plans[::4]:
        geometry = pin.GeometryModel()
        moving = []
        for body in robot.geometryObjects:
            link = model.frames[body.parentFrame].name
            if link.startswith(("arm_right", "wrist_right", "torso", "head")):
                if isinstance(body.geometry, coal.BVHModelBase):
                    body.geometry.buildConvexHull(True, "Qt")
                    body.geometry = body.geometry.convex
                moving.append(geometry.addGeometryObject(body))
        for number, (solid, where) in enumerate(real_wheel(in_world(wheel), 0.4)):
            behind = geometry.addGeometryObject(pin.GeometryObject(f"wheel_{number}", 0, 0, where, solid))
            for body in moving:
                geometry.addCollisionPair(pin.CollisionPair(body, behind))
        data = geometry.createData()
        smallest = np.inf
        for segment in plan.segments:
            for position in whole(plan, segment.positions[::10]):
                index = pin.computeDistances(model, kinematics.data, geometry, data, kinematics.configuration(position))
                smallest = min(smallest, data.distanceResults[index].min_distance)
        assert smallest >= CLEARANCE.bound
        assert smallest >= plan.clearance - 1e-3, "the plan must not promise more than there is"


def test_engaging_is_guarded_along_the_hinge_and_turning_has_a_path_force(seeded_plans, in_world):
    for wheel, plan in seeded_plans:
        guards = {segment.name: segment.ends for segment in plan.segments if segment.ends}
        assert list(guards) == ["engage"]
        (guard,) = guards["engage"]
        assert isinstance(guard, PoseErrorEnd)
        assert (guard.frame, guard.position) == ("tool_right_tip", 0.02)
        assert np.array(guard.axis) @ in_world(wheel).rotation[:, 0] > 0.999
        forces = {segment.name: segment.path_force for segment in plan.segments if segment.path_force}
        assert list(forces) == ["turn"]
        assert (forces["turn"].gain, forces["turn"].limit) == (1500.0, 60.0)
