"""What hypothesis asks of planners: random goals among random boxes; and what an independent check says of the answers."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pinocchio as pin
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline

from affordance_templates import catalogue
from affordance_templates.instance import Instance
from engines.planning.collision.margins import Margins
from engines.planning.collision.obstacles import obstacles_of
from engines.planning.collision.world import World
from engines.planning.ik.constraints import Constraint, Orientation, Position, Posture
from engines.planning.ik.mechanism import Mechanism
from engines.planning.motion_search import PASSED
from engines.planning.plan import Infeasible, Plan
from engines.planning.planners import Planners
from engines.planning.timing.timing import Limits
from engines.planning.verifier import DENSITY, Verifier
from engines.planning.waiting import Cancelled
from handrail.messages import FrameGoal, JointsGoal, KeyFrame, PlanMotion, Pose
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics

NAMES = ["talos_upper", "panda", "ur5", "tiago_pro"]
HERE = Path(__file__).parent / "robots"
UNITS = {"m", "rad", "rad/s", "rad/s²", "N·m"}
REACH = 1.0
"""m about the arm's first joint where boxes and places are drawn"""


class Robot:
    """A robot, the planners as its engine has them, and another model of it that judges."""

    def __init__(self, name: str):
        own = HERE / name
        self.description = robots.load(own if own.is_dir() else name)
        self.planners = Planners(self.description)
        self.arm, arm = next(iter(self.description.arms.items()))
        self.joints, self.tip = arm.joints, arm.tip
        self.home = self.description.home_position("ready")
        self.rows = self.description.index(self.joints)
        self.lower, self.upper = self.description.lower[self.rows], self.description.upper[self.rows]
        self.kinematics = Kinematics(self.description)
        self.mechanism = Mechanism.of(Kinematics(self.description))
        shoulder = self.kinematics.model.getJointId(self.joints[0])
        self.kinematics.frame(self.home, self.tip)
        self.middle = np.array(self.kinematics.data.oMi[shoulder].translation)
        self.limits = Limits(self.description.velocity_limit[self.rows], self.description.acceleration_limit[self.rows])

    def at(self, shares: np.ndarray) -> np.ndarray:
        """All joints (n,), those of the arm at these shares (m,) of their ranges."""
        whole = self.home.copy()
        whole[self.rows] = self.lower + shares * (self.upper - self.lower)
        return whole

    def configuration(self, position: np.ndarray) -> np.ndarray:
        there = dict(zip(self.description.joints, position.tolist(), strict=True))
        return self.mechanism.configuration(np.array([there[joint] for joint in self.mechanism.joints]))

    def missed(self, plan: Plan, call: PlanMotion, boxes: list[Instance]) -> list[str]:
        """What an independent check of the whole plan, ten looks between any two knots, says against it."""
        assert DENSITY >= 10
        solids = [solid for box in boxes for solid in obstacles_of(box)]
        world = World(self.mechanism, solids, self.description.allowed_collision_pairs, moving=plan.joints)
        guard = self.description.guard
        margins = Margins(itself=max(call.clearance, guard.planned), objects=call.clearance)
        end = plan.duration
        ends = [one for goal in call.goals for one in self.constraints(goal, end)]
        stops = [
            one
            for frame, time in zip(call.through, plan.key_times, strict=True)
            for goal in frame.goals
            for one in self.constraints(goal, time)
        ]
        checked = Verifier(world, margins=margins).violations(
            plan, self.limits, self.configuration(self.home), constraints=ends,
            torque=self.description.torque_limit[self.rows],
        )  # fmt: skip
        words = [str(one) for one in checked]
        whole = self.home.copy()
        for one in stops:
            time = one.window[0]
            begin, segment = next(
                (start, each)
                for start, each in zip(plan.starts, plan.segments, strict=True)
                if time <= start + each.duration + 1e-9
            )
            curve = CubicHermiteSpline(segment.times + begin, segment.positions, segment.velocities)
            whole[self.description.index(plan.joints)] = curve(time)
            far = Verifier(world)._checker.measures([one], self.configuration(whole))
            words += [f"key frame: {measure}" for measure in far if measure.size > PASSED + 1e-6]
        return words

    def constraints(self, goal: FrameGoal | JointsGoal, time: float) -> list[Constraint]:
        """What a goal asks for, read by the test itself."""
        window = (time, time)
        if isinstance(goal, JointsGoal):
            return [
                Posture(coefficients={joint: 1.0}, lower=x, upper=x, name=joint, window=window)
                for joint, x in goal.positions.items()
            ]
        # Along the goal's own axes, as its bounds are: what is kept along each may be out by more along the world's.
        here = (0.0, 0.0, 0.0)
        found: list[Constraint] = [
            Position(frame=self.tip, lower=here, upper=here, box=goal.pose, name="place", window=window)
        ]
        if goal.angle < math.pi:
            turn = Orientation(
                frame=self.tip, target=goal.pose.orientation, angle=goal.angle, name="turn", window=window
            )
            found.append(turn)
        return found

    def pose(self, position: np.ndarray) -> Pose:
        """Of the tool's tip at all joints (n,)."""
        x, y, z, a, b, c, d = pin.SE3ToXYZQUAT(self.kinematics.frame(position, self.tip)).tolist()
        return Pose(position=(x, y, z), orientation=(a, b, c, d))


_KNOWN: dict[str, Robot] = {}


def robot_of(name: str) -> Robot:
    """The same one for all tests: what is compiled and read is so once."""
    if name not in _KNOWN:
        _KNOWN[name] = Robot(name)
    return _KNOWN[name]


def _place(robot: Robot, generator: np.random.Generator) -> tuple[float, float, float]:
    """Somewhere about the arm's first joint."""
    x, y, z = (robot.middle + REACH * generator.uniform(-1.0, 1.0, 3)).tolist()
    return x, y, z


def _box(robot: Robot, number: int, generator: np.random.Generator) -> Instance:
    """Anywhere: the arm may begin in it."""
    quaternion = pin.Quaternion(generator.normal(size=4)).normalized().coeffs().tolist()
    pose = Pose(position=_place(robot, generator), orientation=tuple(quaternion))
    sizes = {side: float(generator.uniform(0.05, 0.4)) for side in ("depth", "width", "height")}
    return Instance(f"box_{number}", catalogue.load("box"), pose, sizes)


def _goal(robot: Robot, kind: str, generator: np.random.Generator) -> FrameGoal | JointsGoal:
    """Joints; the pose or place of the tip at some posture, which may meet anything; a place that nothing may reach."""
    if kind == "anywhere":
        return FrameGoal(pose=Pose(position=_place(robot, generator)), angle=math.pi)
    there = robot.at(generator.uniform(0.02, 0.98, len(robot.joints)))
    if kind == "joints":
        return JointsGoal(positions=dict(zip(robot.joints, there[robot.rows].tolist(), strict=True)))
    return FrameGoal(pose=robot.pose(there), angle=math.pi if kind == "place" else 0.0)


kinds = st.sampled_from(["joints", "pose", "place", "anywhere"])


@st.composite
def questions(draw: st.DrawFn, robot: Robot) -> tuple[PlanMotion, list[Instance]]:
    """A goal, or one through a key frame, among up to four boxes, one of which may be ignored."""
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    asked = [draw(kinds) for _ in range(draw(st.sampled_from([1, 1, 1, 2])))]
    around = [_box(robot, number, generator) for number in range(draw(st.integers(0, 4)))]
    *through, last = [_goal(robot, kind, generator) for kind in asked]
    call = PlanMotion(
        goals=[last], through=[KeyFrame(goals=[each]) for each in through], arm=robot.arm,
        ignore=[box.name for box in around[:1] if draw(st.booleans())], clearance=float(generator.uniform(0.0, 0.02)),
    )  # fmt: skip
    return call, around


def answer(robot: Robot, call: PlanMotion, around: list[Instance], patience: int) -> str:
    """`plan` where there is one that the check has nothing against, `refused` where an error named why, `ended` by `patience`."""
    asked = 0

    def cancelled() -> bool:
        nonlocal asked
        asked += 1
        return asked > patience

    try:
        plan = robot.planners.motion(call, around, robot.home, cancelled=cancelled)
    except Infeasible as refused:
        assert refused.constraint and refused.unit in UNITS, str(refused)
        assert math.isfinite(refused.by) and refused.by >= 0.0, str(refused)
        assert refused.where, "it is said at which part of the way"
        return "refused"
    except Cancelled:
        return "ended"
    heeded = [box for box in around if box.name not in call.ignore]
    assert robot.missed(plan, call, heeded) == []
    assert set(plan.made_from) == {box.name for box in heeded}
    return "plan"
