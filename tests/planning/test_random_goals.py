"""Random goals among random boxes, on four robots: whatever plan comes back passes the independent check of all of it."""

from __future__ import annotations

import sys
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from engines.planning.collision.connect import Budget, Connector
from engines.planning.collision.margins import Margins
from engines.planning.collision.obstacles import Obstacle
from engines.planning.collision.sweep import Sweep
from engines.planning.collision.world import World
from engines.planning.ik.constraints import Clearance, Direction, Orientation, Position
from engines.planning.ik.mechanism import Mechanism
from engines.planning.ik.solver import Solver
from engines.planning.plan import Infeasible, Plan, Segment
from engines.planning.timing.timing import Limits, parametrise
from engines.planning.verifier import Verifier
from handrail.messages import Pose
from handrail.robot import library as robots
from handrail.robot.srdf import disabled_pairs

SHARE = Path(sys.prefix) / "lib" / f"python3.{sys.version_info.minor}" / "site-packages" / "cmeel.prefix" / "share"
ROBOTS = SHARE / "example-robot-data" / "robots"
TIAGO_ARM = ("torso_lift_joint", *(f"arm_right_{number}_joint" for number in range(1, 8)))
MARGINS = Margins(itself=0.01, objects=0.02)
QUICK = Budget(edges=150, shortcuts=20)
SETTINGS = {"deadline": None, "derandomize": True, "suppress_health_check": [HealthCheck.too_slow]}


class Robot:
    """A robot's model, its arm, and which of its links may touch."""

    def __init__(self, name: str):
        if name == "talos_upper":
            description = robots.load(name)
            urdf, self.tool = description.urdf, "tool_right_tip"
            self.joints, self.allowed = description.arms["right"].joints, description.allowed_collision_pairs
            self.mechanism = Mechanism.from_urdf(str(urdf), description.joints)
        else:
            folder, self.tool, joints = {
                "panda": ("panda_description/urdf/panda.urdf", "panda_hand_tcp", ()),
                "ur5": ("ur_description/urdf/ur5_robot.urdf", "tool0", ()),
                "tiago_pro": ("tiago_pro_description/robots/tiago_pro.urdf", "arm_right_tool_link", TIAGO_ARM),
            }[name]
            self.mechanism = Mechanism.from_urdf(str(ROBOTS / folder), joints, packages=[str(SHARE)])
            self.joints = tuple(joint for joint in self.mechanism.joints if "finger" not in joint)
            srdf = {"panda": "panda_description/srdf/panda.srdf", "ur5": "ur_description/srdf/ur5.srdf"}.get(name)
            self.allowed = disabled_pairs(ROBOTS / srdf) if srdf else ()
        m = self.mechanism
        self.rows = [m.row(joint) for joint in self.joints]
        self.columns = m.coordinate[self.rows]
        self.lower, self.upper = np.maximum(m.lower[self.rows], -np.pi), np.minimum(m.upper[self.rows], np.pi)
        middle = m.within_limits(pin.neutral(m.model))
        middle[self.columns] = (self.lower + self.upper) / 2.0
        self.middle = middle
        self.allowed = (*self.allowed, *self._always_near())
        self.solver = Solver(m)
        velocity = np.minimum(m.model.velocityLimit[self.rows], 2.0)
        self.limits = Limits(velocity, 2.0 * velocity)

    def random(self, generator: np.random.Generator) -> np.ndarray:
        q = self.middle.copy()
        q[self.columns] = generator.uniform(self.lower, self.upper)
        return q

    def _always_near(self) -> list[tuple[str, str]]:
        """Links that nothing said may touch, and that nearly always do: hulls of hollow bodies, covers about joints."""
        world = World(self.mechanism, (), self.allowed, moving=self.joints)
        data, scratch = self.mechanism.model.createData(), world.geometry.createData()
        generator, near = np.random.default_rng(0), np.zeros(len(world.pairs), int)
        for _ in range(12):
            pin.computeDistances(self.mechanism.model, data, world.geometry, scratch, self.random(generator))
            near += np.array([found.min_distance for found in scratch.distanceResults]) < MARGINS.itself
        return [(world.names[i], world.names[j]) for i, j in world.pairs[near >= 10]]


_ROBOTS: dict[str, Robot] = {}


def robot_of(name: str) -> Robot:
    if name not in _ROBOTS:
        _ROBOTS[name] = Robot(name)
    return _ROBOTS[name]


def clear(robot: Robot, world: World, generator: np.random.Generator) -> np.ndarray | None:
    sweep, floors = Sweep(world), MARGINS.floors(world)
    for _ in range(40):
        q = robot.random(generator)
        if sweep.meeting(q[None, None], floors) is None:
            return q
    return None


def planned(robot: Robot, seed: int) -> bool:
    """Whether a plan to a random goal among boxes was found; it is verified then, and refused by its reason else."""
    generator = np.random.default_rng(seed)
    boxes = [
        Obstacle(
            f"box {number}",
            coal.Box(*generator.uniform(0.05, 0.3, 3)),
            pin.SE3(pin.Quaternion(generator.normal(size=4)).normalized().matrix(), generator.uniform(-0.9, 0.9, 3)),
        )
        for number in range(3)
    ]
    world = World(robot.mechanism, boxes, robot.allowed, moving=robot.joints)
    start, there = clear(robot, world, generator), clear(robot, world, generator)
    if start is None or there is None:
        return False
    data = robot.mechanism.model.createData()
    pin.framesForwardKinematics(robot.mechanism.model, data, there)
    target = data.oMf[robot.mechanism.frame_id(robot.tool)].translation
    goal = Position.at(robot.tool, target, name="goal")
    keep = Clearance(scene=world, at_least=MARGINS.objects + 1e-3)
    try:
        answer = robot.solver.solve([goal, keep], start, moving=robot.joints, starts=3).require("goal")
        way = Connector(world, margins=MARGINS).way(start, answer.q, budget=QUICK)
        knots = parametrise(way[:, robot.columns], robot.limits, 1.0)
    except Infeasible as refused:
        assert refused.constraint and np.isfinite(refused.by)
        return False
    segment = Segment("go", knots.times, knots.positions, knots.velocities)
    plan = Plan("plan", "go", "", robot.joints, (segment,), {}, start[robot.columns], 0.0, 0.0)
    end = Position.at(robot.tool, target, name="goal", window=(segment.duration, segment.duration))
    assert Verifier(world, margins=MARGINS).violations(plan, robot.limits, start, constraints=[end]) == []
    return True


@pytest.mark.parametrize("name", ["talos_upper", "panda", "ur5", "tiago_pro"])
def test_whatever_plan_comes_back_passes_the_independent_check(name):
    found = []

    @settings(max_examples=3, **SETTINGS)
    @given(seed=st.integers(0, 2**32 - 1))
    def drive(seed):
        found.append(planned(robot_of(name), seed))

    drive()
    assert any(found), "no plan at all: nothing was shown"


@pytest.mark.soak
@pytest.mark.parametrize("name", ["talos_upper", "panda", "ur5", "tiago_pro"])
def test_whatever_of_two_hundred_plans_comes_back_passes_the_independent_check(name):
    found = []

    @settings(max_examples=200, **SETTINGS)
    @given(seed=st.integers(0, 2**32 - 1))
    def drive(seed):
        found.append(planned(robot_of(name), seed))

    drive()
    assert sum(found) > 0.5 * len(found)


def unreachable(robot: Robot, generator: np.random.Generator) -> None:
    """A place metres beyond the reach, along any direction: missed by at least what is between."""
    far = generator.normal(size=3)
    far *= generator.uniform(4.0, 20.0) / np.linalg.norm(far)
    answer = robot.solver.solve([Position.at(robot.tool, far, name="goal")], robot.random(generator), starts=2)
    worst = answer.violations[0]
    assert (worst.constraint, worst.unit) == ("goal", "m")
    off = np.array([m.by for m in answer.violations if m.constraint == "goal"])
    assert np.linalg.norm(off) > np.linalg.norm(far) - 2.5
    with pytest.raises(Infeasible, match=f"goal .*missed by {worst.by:.3g} m") as refused:
        answer.require()
    assert refused.value.by == worst.by


def inside(robot: Robot, generator: np.random.Generator) -> None:
    """A place within a box that is to be kept clear of: the box is named, and how deep it is in."""
    size, turn = generator.uniform(0.1, 0.5, 3), pin.Quaternion(generator.normal(size=4)).normalized().matrix()
    share = generator.uniform(-0.45, 0.45, 3)
    box = Obstacle("crate", coal.Box(*size), pin.SE3(turn, generator.uniform(-0.6, 0.6, 3)))
    world = World(robot.mechanism, [box], robot.allowed, moving=robot.joints)
    goal = Position.at(robot.tool, box.placement.act(share * size), name="goal")
    answer = robot.solver.solve([goal, Clearance(scene=world, at_least=0.01)], robot.random(generator), starts=1)
    told = answer.violations[0]
    assert (told.constraint, told.what) == ("goal", "goal from crate, inside of which it is")
    assert -told.value == pytest.approx(((0.5 - np.abs(share)) * size).min(), abs=1e-4)


def meaningless(robot: Robot, generator: np.random.Generator) -> None:
    """Numbers that are not finite, directions without length, bounds the wrong way round: refused by field."""
    number = float(generator.choice([np.nan, np.inf, -np.inf]))
    place = generator.uniform(-0.5, 0.5, 3)
    spoilt = place.copy()
    spoilt[generator.integers(3)] = number
    low, high, q = tuple(place + 0.1), tuple(place), robot.random(generator)
    turned = tuple(generator.normal(size=4) * 3.0 + 4.0)
    wrong = [
        (lambda: Position.at(robot.tool, place, point=tuple(spoilt)), r"point: got .*(nan|inf)"),
        (lambda: Position.at(robot.tool, place, box=Pose(position=tuple(spoilt))), r"box: got .*(nan|inf)"),
        (lambda: Position(frame=robot.tool, lower=low, upper=high), "lower, upper: got"),
        (lambda: Direction(frame=robot.tool, axis=(0.0, 0.0, 0.0), direction=(0.0, 0.0, 1.0)), "axis: got"),
        (lambda: Orientation(frame=robot.tool, target=turned), "target: got .* unit quaternion"),
        (lambda: robot.solver.solve([Position.at(robot.tool + "?", place)], q), "frame: got"),
        (lambda: robot.solver.solve([Position.at(robot.tool, place)], q + number), "nominal: got .*finite"),
        (lambda: robot.solver.solve([Position.at(robot.tool, place)], q[1:]), r"nominal: got shape"),
    ]
    make, words = wrong[generator.integers(len(wrong))]
    with pytest.raises(ValueError, match=words):
        make()


@pytest.mark.parametrize("name", ["talos_upper", "panda", "ur5", "tiago_pro"])
@pytest.mark.parametrize("trouble", [unreachable, inside, meaningless])
def test_whatever_goal_can_not_be_met_is_told_why(name, trouble):
    @settings(max_examples=8, **SETTINGS)
    @given(seed=st.integers(0, 2**32 - 1))
    def drive(seed):
        trouble(robot_of(name), np.random.default_rng(seed))

    drive()
