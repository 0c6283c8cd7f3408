"""Motions to goals: postures, reaches, looks, key frames, what is kept on the way; judged by pinocchio and coal alone."""

from __future__ import annotations

import dataclasses
import math

import coal
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from engines.planning.collision.margins import Margins
from engines.planning.collision.world import World
from engines.planning.ik.checker import ANGLE, LENGTH
from engines.planning.ik.report import Measure as Missed
from engines.planning.measures import TORQUE_SHARE
from engines.planning.motion_planner import MotionPlanner
from engines.planning.plan import Infeasible, Plan
from engines.planning.planners import Planners
from engines.planning.scene import Scene
from engines.planning.strokes.manipulation import VELOCITY_SHARE
from engines.planning.timing.timing import Knots, Limits, peak_velocities
from engines.planning.verifier import Verifier, Violation
from engines.planning.waiting import Cancelled
from handrail.messages import (
    Along,
    CentreOfMassGoal,
    FrameGoal,
    GazeGoal,
    JointsGoal,
    KeyFrame,
    PlanMotion,
    Pose,
    PostureGoal,
    RelationGoal,
)
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics

NOWHERE = Pose()
ANY = math.pi
FREE = (None, None, None)


class Bench:
    """A robot, its planner, and what pinocchio and coal say of a plan."""

    def __init__(self, robot: str):
        self.description = robots.load(robot)
        self.kinematics = Kinematics(self.description)
        self.planner: MotionPlanner = Planners(self.description).motions
        self.home = self.description.home_position("ready")
        self.arm = next(iter(self.description.arms))
        self.tip = self.description.arms[self.arm].tip

    def plan(self, instances=(), position=None, **call) -> Plan:
        question = self.planner.read(PlanMotion(**({"arm": self.arm} | call)), list(instances))
        return self.planner.plan(question, self.home if position is None else position)

    def positions(self, plan: Plan, spacing: int = 1) -> np.ndarray:
        """(k, n) all joints at the plan's knots."""
        knots = np.vstack(
            [segment.positions[::spacing] for segment in plan.segments] + [plan.segments[-1].positions[-1:]]
        )
        whole = np.repeat(self.home[None], len(knots), axis=0)
        whole[:, self.description.index(plan.joints)] = knots
        return whole

    def frame(self, position: np.ndarray, name: str = "") -> pin.SE3:
        return self.kinematics.frame(position, name or self.tip)

    def pose(self, position: np.ndarray) -> Pose:
        placement = self.frame(position)
        rotation = pin.Quaternion(placement.rotation).coeffs()
        return Pose(position=tuple(placement.translation.tolist()), orientation=tuple(rotation.tolist()))


_BENCHES: dict[str, Bench] = {}


def bench_of(robot: str) -> Bench:
    if robot not in _BENCHES:
        _BENCHES[robot] = Bench(robot)
    return _BENCHES[robot]


@pytest.fixture(scope="module")
def bench() -> Bench:
    return bench_of("talos_upper")


@pytest.mark.parametrize("robot", ["talos_upper", "panda", "z1"])
@settings(max_examples=4, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), exact=st.booleans())
def test_a_tool_goes_where_some_posture_has_it(robot, seed, exact):
    bench = bench_of(robot)
    generator, description = np.random.default_rng(seed), bench.description
    moving = description.index(description.arms[bench.arm].joints)
    there = bench.home.copy()
    low, high = description.lower[moving], description.upper[moving]
    there[moving] = np.clip(there[moving] + generator.uniform(-0.7, 0.7, len(moving)), low + 0.02, high - 0.02)
    goal = FrameGoal(pose=bench.pose(there), angle=0.0 if exact else ANY)
    plan = bench.plan(goals=[goal])
    positions = bench.positions(plan)
    assert np.abs(positions[0] - bench.home).max() < 1e-9
    end, wanted = bench.frame(positions[-1]), bench.frame(there)
    assert np.linalg.norm(end.translation - wanted.translation) < 3**0.5 * LENGTH + 1e-6
    if exact:
        assert np.linalg.norm(pin.log3(end.rotation.T @ wanted.rotation)) < ANGLE + 1e-6
    assert (positions >= description.lower - 1e-9).all()
    assert (positions <= description.upper + 1e-9).all()
    for segment in plan.segments:
        knots = Knots(segment.times, segment.positions, segment.velocities)
        assert (peak_velocities(knots) <= VELOCITY_SHARE * description.velocity_limit[moving] * 1.001 + 1e-9).all()
        assert not segment.velocities[[0, -1]].any()


def test_a_named_posture_is_gone_to_by_the_joints_that_may_move_and_no_others(bench):
    away = bench.plan(goals=[JointsGoal(positions={"arm_right_4_joint": -1.2, "arm_right_1_joint": 0.1})])
    position = bench.positions(away)[-1]
    assert position[bench.description.index("arm_right_4_joint")] == pytest.approx(-1.2, abs=ANGLE)
    back = bench.plan(goals=[PostureGoal(name="ready")], joints=["arm_right"], position=position)
    assert back.joints == bench.description.groups["arm_right"]
    home = bench.home[bench.description.index(back.joints)]
    assert np.abs(back.segments[-1].positions[-1] - home).max() < ANGLE


def test_a_reach_keeps_clear_of_an_instance_and_depends_on_its_version(bench, nominal_wheel, in_world):
    goal = FrameGoal(instance="wheel_1", feature="turn.approach", about="z", pose=NOWHERE)
    plan = bench.plan([nominal_wheel], goals=[goal], clearance=0.02)
    assert plan.made_from == {"wheel_1": nominal_wheel.version}
    tip = in_world(nominal_wheel).inverse() * bench.frame(bench.positions(plan)[-1])
    assert np.allclose(tip.translation, [-0.15, 0.10, 0.0], atol=2 * LENGTH)
    assert -tip.rotation[0, 2] > math.cos(2 * ANGLE), "the tool points into the wheel"
    model, description = bench.kinematics.model, bench.description
    robot = pin.buildGeomFromUrdf(model, str(description.urdf), pin.COLLISION)
    ring = coal.Cylinder(0.162, 0.024)  # what rim and spokes sweep
    turned = in_world(nominal_wheel) * pin.SE3(pin.rpy.rpyToMatrix(0, math.pi / 2, 0), np.zeros(3))
    wheel = robot.addGeometryObject(pin.GeometryObject("wheel", 0, 0, turned, ring))
    for number, body in enumerate(robot.geometryObjects[:-1]):
        if isinstance(body.geometry, coal.BVHModelBase):
            body.geometry.buildConvexHull(True, "Qt")
            body.geometry = body.geometry.convex
        if model.frames[body.parentFrame].name.startswith(("arm_right", "tool_right", "wrist_right")):
            robot.addCollisionPair(pin.CollisionPair(number, wheel))
    data, least = robot.createData(), np.inf
    for position in bench.positions(plan, 4):
        nearest = pin.computeDistances(
            model, bench.kinematics.data, robot, data, bench.kinematics.configuration(position)
        )
        least = min(least, data.distanceResults[nearest].min_distance)
    assert least >= 0.02 - LENGTH
    assert plan.clearance <= least + 1e-3, "no more is promised than there is"


def test_a_motion_ends_no_nearer_to_the_robot_itself_than_its_guard_lets_it_stand_whatever_is_asked_for(bench):
    inwards, guard = "arm_right_3_joint", bench.description.guard
    (row,) = bench.description.index([inwards])
    scene = Scene(World(bench.planner.mechanism, (), bench.description.allowed_collision_pairs), Margins(0.0, 0.0))

    def nearest(angle: float) -> float:
        position = bench.home.copy()
        position[row] = angle
        return scene.sweep.nearest(bench.planner.configuration("position", position)).distance

    start = bench.home[row]
    folded = next(angle for angle in np.linspace(start, bench.description.upper[row], 60) if nearest(angle) < 0.0)

    def angle_at(distance: float) -> float:
        return brentq(lambda angle: nearest(angle) - distance, start, folded)

    clear, near = angle_at(guard.planned + 0.004), angle_at(guard.planned - 0.004)
    plan = bench.plan(goals=[JointsGoal(positions={inwards: clear})], joints=[inwards], clearance=0.0)
    assert plan.clearance >= guard.planned - LENGTH
    with pytest.raises(Infeasible, match="clearance"):
        bench.plan(goals=[JointsGoal(positions={inwards: near})], joints=[inwards], clearance=0.0)


def test_a_goal_goes_with_its_instance_and_with_the_feature_that_it_is_said_in(bench, wheel_at):
    for rpy in ([0.0, 0.0, 0.0], [0.3, 0.0, 0.2]):
        wheel = wheel_at(np.array([0.55, -0.35, 0.3]), np.array(rpy), joint_state={"hinge": 0.4})
        place = pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array([0.55, -0.35, 0.3]))
        above = Pose(position=(-0.2, 0.0, 0.05))
        goal = FrameGoal(instance="wheel_1", feature="hinge", pose=above, angle=ANY)
        plan = bench.plan([wheel], goals=[goal])
        hinge = place * pin.SE3(pin.rpy.rpyToMatrix(0.4, 0, 0), np.zeros(3))
        tip = bench.frame(bench.positions(plan)[-1]).translation
        assert np.allclose(tip, hinge.act(np.array(above.position)), atol=2 * LENGTH)


def test_tolerances_are_used_only_as_far_as_need_be_and_a_free_axis_is_free(bench):
    here = bench.pose(bench.home)
    x, y, z = here.position
    goal = FrameGoal(pose=Pose(position=(x, y, z + 0.1)), below=(None, 0.02, 0.0), above=(None, 0.0, 0.0), angle=ANY)
    tip = bench.frame(bench.positions(bench.plan(goals=[goal]))[-1]).translation
    assert y - 0.02 - LENGTH <= tip[1] <= y + LENGTH
    assert tip[2] == pytest.approx(z + 0.1, abs=LENGTH)


def test_head_and_arm_meet_their_goals_at_once(bench):
    target = np.array([0.5, -0.3, 0.3])
    goals = [
        FrameGoal(pose=Pose(position=(0.4, -0.2, 0.3)), angle=ANY),
        GazeGoal(frame="head_2_link", target=tuple(target.tolist()), cone=0.05),
        RelationGoal(coefficients={"torso_1_joint": 1.0}),
    ]
    plan = bench.plan(goals=goals, joints=["torso", "head", "arm_right"])
    end = bench.positions(plan)[-1]
    head = bench.frame(end, "head_2_link")
    sight = target - head.translation
    assert head.rotation[:, 0] @ sight / np.linalg.norm(sight) > math.cos(0.05 + ANGLE)
    assert np.allclose(bench.frame(end).translation, [0.4, -0.2, 0.3], atol=2 * LENGTH)
    assert abs(end[bench.description.index("torso_1_joint")]) < ANGLE


def test_key_frames_are_passed_in_their_order_in_one_smooth_motion(bench):
    corners = [(0.3, -0.5, 0.3), (0.4, -0.4, 0.2)]
    through = [KeyFrame(goals=[FrameGoal(pose=Pose(position=corner), angle=ANY)]) for corner in corners]
    plan = bench.plan(goals=[FrameGoal(pose=Pose(position=(0.4, -0.1, 0.3)), angle=ANY)], through=through)
    assert len(plan.segments) == 1
    tips = np.array([bench.frame(position).translation for position in bench.positions(plan)])
    nearest = [int(np.linalg.norm(tips - corner, axis=1).argmin()) for corner in corners]
    assert all(np.linalg.norm(tips[n] - c) < 0.01 for n, c in zip(nearest, corners, strict=True))
    assert 0 < nearest[0] < nearest[1] < len(tips) - 1


def test_what_is_kept_is_kept_all_the_way(bench):
    here = bench.pose(bench.home)
    level = FrameGoal(pose=here, about="z", angle=0.15, below=FREE, above=FREE)
    goals = [FrameGoal(pose=Pose(position=(0.4, -0.2, 0.2)), angle=ANY)]
    plan = bench.plan(goals=goals, keep=[level])
    axis = bench.frame(bench.home).rotation[:, 2]
    tilts = [math.acos(min(1.0, axis @ bench.frame(q).rotation[:, 2])) for q in bench.positions(plan)]
    assert max(tilts) < 0.15 + 20 * ANGLE
    with pytest.raises(Infeasible) as caught:
        bench.plan(goals=[GazeGoal(frame=bench.tip, axis=(0, 0, -1), target=(0.3, -0.4, 9.0), cone=0.1)], keep=[level])
    assert caught.value.unit == "rad"


def test_the_whole_mass_goes_where_it_is_asked_to_while_a_hand_stays(bench):
    """Judged with the base's own mass, by pinocchio on a free base."""
    free = pin.buildModelFromUrdf(str(bench.description.urdf), pin.JointModelFreeFlyer())

    def centre(position: np.ndarray) -> np.ndarray:
        q = pin.neutral(free)
        for joint, x in zip(bench.description.joints, position, strict=True):
            q[free.idx_qs[free.getJointId(joint)]] = x
        return np.array(pin.centerOfMass(free, free.createData(), q))

    before, hand = centre(bench.home), bench.pose(bench.home)
    goal = CentreOfMassGoal(position=tuple((before + np.array([0.0, 0.02, 0.0])).tolist()), height=None)
    stays = FrameGoal(frame=bench.tip, pose=hand, angle=0.02)
    plan = bench.plan(goals=[goal, stays], keep=[stays], joints=["torso", "arm_right", "arm_left"])
    ways = bench.positions(plan)
    assert np.abs((centre(ways[-1]) - before)[:2] - [0.0, 0.02]).max() < 2 * LENGTH
    assert max(np.linalg.norm(bench.frame(q).translation - hand.position) for q in ways) < 20 * LENGTH
    with pytest.raises(Infeasible, match=r"goals\[0\] \(centre of mass\) \(z\)"):
        bench.plan(goals=[CentreOfMassGoal(position=(0.0, 0.0, 3.0), across=None)])


@pytest.fixture(scope="module")
def engaged(bench, wheel_at):
    """A wheel, and all joints where the tool is in it."""
    wheel = wheel_at(np.array([0.55, -0.35, 0.3]), np.zeros(3), joint_state={"hinge": 0.3})
    deep = FrameGoal(instance="wheel_1", pose=Pose(position=(0.02, 0.0, -0.1)), about="z", angle=0.1)
    deep.pose.orientation = tuple(pin.Quaternion.FromTwoVectors(np.array([0, 0, -1.0]), np.array([1.0, 0, 0])).coeffs())
    return wheel, bench.positions(bench.plan([wheel], goals=[deep], ignore=["wheel_1"]))[-1]


@pytest.mark.parametrize(("about", "joints"), [("z", []), ("", ["arm_right", "torso"])])
def test_a_tool_goes_with_the_joint_that_it_holds_along_all_of_the_way(bench, engaged, in_world, about, joints):
    wheel, position = engaged
    along = Along(instance="wheel_1", joint="hinge", by=-0.7, about=about)
    plan = bench.plan([wheel], position=position, along=along, joints=joints)
    start, hinge = bench.frame(position), in_world(wheel)
    rows = bench.description.index(plan.joints)
    for knots in plan.segments[0].positions[::6]:
        here = position.copy()
        here[rows] = knots
        tip = hinge.actInv(bench.frame(here).translation)
        assert math.hypot(tip[1], tip[2]) == pytest.approx(0.1, abs=0.002) and tip[0] == pytest.approx(0.02, abs=0.002)
    turn = hinge * pin.SE3(pin.rpy.rpyToMatrix(-0.7, 0, 0), np.zeros(3)) * hinge.inverse()
    wanted, end = turn * start, bench.frame(_end(plan, position, rows))
    assert np.linalg.norm(end.translation - wanted.translation) < 3 * LENGTH
    turned = pin.log3(wanted.rotation.T @ end.rotation)
    assert np.linalg.norm(turned[:2] if about else turned) < 3 * ANGLE
    assert plan.made_from == {"wheel_1": 1} and plan.label == "tool_right_tip along wheel_1 hinge"


def _end(plan: Plan, position: np.ndarray, rows: np.ndarray) -> np.ndarray:
    there = position.copy()
    there[rows] = plan.segments[-1].positions[-1]
    return there


def test_what_a_joint_leads_out_of_reach_is_told_by_how_much_of_the_way_is_done(bench, engaged):
    wheel, position = engaged
    with pytest.raises(Infeasible, match=r"\d+ % of the way along hinge: "):
        bench.plan([wheel], position=position, along=Along(instance="wheel_1", joint="hinge", by=6.0))
    with pytest.raises(Infeasible, match=r"where the robot stands: clearance \(tool_right and .* of wheel_1\)"):
        bench.plan([wheel], position=position, along=Along(instance="wheel_1", joint="hinge", by=0.3, touch=False))


@pytest.mark.parametrize(
    ("call", "words"),
    [
        ({}, "goals: expected at least one, or `along`"),
        ({"goals": [JointsGoal(positions={})]}, r"goals\[0\].positions: got none; expected at least one joint"),
        ({"along": Along(instance="wheel", joint="hinge", by=1.0)}, "along.instance: got 'wheel'; expected one of wheel_1"),
        ({"along": Along(instance="wheel_1", joint="axle", by=1.0)}, "along.joint: got 'axle'; expected one of hinge"),
        ({"along": Along(instance="wheel_1", joint="hinge", by=math.nan)}, "along.by: got nan; expected a finite number"),
        ({"goals": [FrameGoal(pose=Pose(position=(0.4, math.nan, 0.3)))]}, r"goals\[0\].pose.position: got .*nan.*finite"),
        ({"goals": [FrameGoal(pose=Pose(orientation=(0, 0, 0, 0)))]}, r"goals\[0\].pose.orientation: .*unit quaternion"),
        ({"goals": [FrameGoal(pose=NOWHERE, below=(math.inf, 0, 0))]}, r"goals\[0\].below: got .inf, 0, 0.; expected finite"),
        ({"goals": [FrameGoal(pose=NOWHERE, angle=4.0)]}, r"goals\[0\].angle: got 4.0; expected 0 to π"),
        ({"goals": [FrameGoal(pose=NOWHERE, angle=ANY, below=FREE, above=FREE)]}, "no bound on position or angle"),
        ({"goals": [FrameGoal(frame="tool_rihgt_tip", pose=NOWHERE)]}, r"goals\[0\].frame: .*expected one like tool_right_tip"),
        ({"goals": [FrameGoal(instance="whel", pose=NOWHERE)]}, r"goals\[0\].instance: got 'whel'; expected one of wheel_1"),
        ({"goals": [FrameGoal(instance="wheel_1", feature="axle", pose=NOWHERE)]}, r"got 'axle'; expected one of on_rim, shaft, h"),
        ({"goals": [GazeGoal(frame="head_2_link", axis=(0, 0, 0), cone=0.1)]}, r"axis: got \(0, 0, 0\); expected a direction"),
        ({"goals": [CentreOfMassGoal(position=(0.0, math.nan, 0.0))]}, r"goals\[0\].position: .*nan.*finite"),
        ({"goals": [CentreOfMassGoal(position=(0.0, 0.0, 0.0), across=None, height=None)]}, r"goals\[0\]: got no bound"),
        ({"goals": [JointsGoal(positions={"elbow": 0.1})]}, r"goals\[0\].positions: got 'elbow'; expected joints"),
        ({"goals": [JointsGoal(positions={"arm_right_4_joint": 0.4})]}, r"arm_right_4_joint\]: got 0.4; expected .* limits"),
        ({"goals": [PostureGoal(name="redy")]}, r"goals\[0\].name: got 'redy'; expected one of ready"),
        ({"goals": [PostureGoal(name="ready")], "arm": "middle"}, "arm: got 'middle'; expected one of right, left"),
        ({"goals": [PostureGoal(name="ready")], "arm": ""}, "arm: got none, and no joints"),
        ({"goals": [PostureGoal(name="ready")], "joints": ["tail"]}, "joints: got 'tail'; expected joints or groups"),
        ({"goals": [PostureGoal(name="ready")], "ignore": ["door"]}, "ignore: got 'door'; expected one of wheel_1"),
        ({"goals": [PostureGoal(name="ready")], "clearance": math.nan}, "clearance: got nan"),
    ],
)  # fmt: skip
def test_what_cant_be_meant_is_refused_by_field_value_and_expectation(bench, nominal_wheel, call, words):
    with pytest.raises(ValueError, match=words):
        bench.plan([nominal_wheel], **call)


@pytest.mark.parametrize(
    ("position", "words"),
    [
        ((1.5, -0.2, 0.3), r"goals: goals\[0\] \(tool_right_tip\) \(x\).* missed by 0\.\d+ m"),
        ((0.55, -0.27, 0.3), "goal from (rim|spokes) of wheel_1, inside of which it is"),
        ((0.0, 0.0, 0.1), "clearance .*tool_right and .*|clearance .*"),
    ],
    ids=["out of reach", "inside an obstacle", "inside the robot"],
)
def test_goals_that_nothing_reaches_are_infeasible_each_with_its_reason(bench, nominal_wheel, position, words):
    with pytest.raises(Infeasible, match=words):
        bench.plan([nominal_wheel], goals=[FrameGoal(pose=Pose(position=position), angle=ANY)])


def test_a_robot_that_stands_too_close_is_told_which_bodies_are(bench, wheel_at):
    at_elbow = wheel_at(bench.frame(bench.home, "arm_right_5_link").translation + np.array([0, 0.15, 0]), np.zeros(3))
    with pytest.raises(
        Infeasible, match=r"where the robot stands: clearance \(arm_right_\d_link and (rim|spokes) of wheel_\d\)"
    ):
        bench.plan([at_elbow], goals=[PostureGoal(name="ready")])
    assert bench.plan([at_elbow], goals=[PostureGoal(name="ready")], ignore=["wheel_1"]).made_from == {}


def test_planning_is_cancelled_soon_and_the_same_question_has_the_same_answer(bench, nominal_wheel):
    call = PlanMotion(goals=[FrameGoal(pose=Pose(position=(0.4, -0.2, 0.3)), angle=ANY)], arm="right")
    question = bench.planner.read(call, [nominal_wheel])
    for asked in (1, 3, 30):
        left = iter(range(asked))
        with pytest.raises(Cancelled):
            bench.planner.plan(question, bench.home, cancelled=lambda left=left: next(left, None) is None)
    one, other = (bench.planner.plan(question, bench.home) for _ in range(2))
    assert np.array_equal(one.segments[0].positions, other.segments[0].positions)


def test_the_verifier_finds_what_planning_would_have_missed(bench, nominal_wheel, monkeypatch):
    """Every promise broken in turn, in the plan that was verified and keeps them all."""
    seen = {}

    def spy(self, plan, limits, at, **more):
        seen["question"] = (self, plan, limits, at, more)
        return violations(self, plan, limits, at, **more)

    violations = Verifier.violations
    monkeypatch.setattr(Verifier, "violations", spy)
    goal = FrameGoal(pose=Pose(position=(0.4, -0.2, 0.3)), angle=ANY)
    bench.plan([nominal_wheel], goals=[goal])
    verifier, plan, limits, at, more = seen["question"]
    knots = plan.segments[0]

    def broken(limits=limits, torque=more["torque"], judge=verifier, **changes):
        one = dataclasses.replace(plan, segments=(dataclasses.replace(knots, **changes),))
        found = violations(judge, one, limits, at, **(more | {"torque": torque}))
        return {violation.measure.constraint for violation in found}

    assert broken() == set()
    bump = np.zeros_like(knots.positions)
    bump[len(bump) // 2, 3] = 0.002  # a jolt, in one knot only
    assert "acceleration limits" in broken(positions=knots.positions + bump)
    assert broken(limits=Limits(limits.velocity * 0.02, limits.acceleration)) == {"velocity limits"}
    stays = np.repeat(knots.positions[:1], len(bump), axis=0)
    assert {one[:8] for one in broken(positions=stays, velocities=0.0 * bump)} == {"goals[0]"}
    wary = Verifier(verifier._world, margins=Margins(0.14, 0.14))
    assert broken(judge=wary) == {"clearance"}
    assert broken(torque=more["torque"] * 0.01) == {"torque limits"}
    assert broken(positions=knots.positions * np.nan) == {"finite numbers"}
    weight = np.abs(bench.kinematics.gravity(bench.home))[bench.description.index(plan.joints)]
    share = plan.measures[TORQUE_SHARE].values[0]
    assert share == pytest.approx((weight / more["torque"]).max(), abs=0.05), "at rest it is the weight"


def test_no_plan_is_returned_that_the_verifier_refuses(bench, nominal_wheel, planner, description, monkeypatch):
    """Whatever made it: a motion or a stroke."""
    asked = []

    def refuse(self, plan, *_, **__):
        asked.append(plan.joints)
        return [Violation(plan.segments[0].name, 0.5, Missed("whim", "of a test", 2.0, 0.0, 1.0, "m"))]

    monkeypatch.setattr(Verifier, "violations", refuse)
    with pytest.raises(
        Infeasible, match=r"goals: whim \(of a test\) is 2 m at 0\.5 s, at most 1 allowed, missed by 1 m"
    ):
        bench.plan([nominal_wheel], goals=[PostureGoal(name="ready")])
    with pytest.raises(Infeasible, match="whim"):
        planner.plan(nominal_wheel, "turn", "right", description.home_position("ready"))
    assert len(asked) >= 2
