"""Goals that may give way: in the order that the call names them, as little as possible, told in units; what may not, holds."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest

from engines.planning.plan import Infeasible
from engines.planning.planners import Planners
from handrail.messages import FrameGoal, JointsGoal, PlanMotion, Pose
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics

ANY = math.pi


class Bench:
    def __init__(self) -> None:
        self.description = robots.load("panda")
        self.kinematics = Kinematics(self.description)
        self.planner = Planners(self.description).motions
        self.home = self.description.home_position("ready")
        (self.arm,) = self.description.arms.values()
        self.tip = self.kinematics.frame(self.home, self.arm.tip)

    def plan(self, *goals, relax=(), **more):
        call = PlanMotion(goals=list(goals), arm=self.arm.name, relax=list(relax), **more)
        return self.planner.plan(self.planner.read(call, []), self.home)

    def end(self, plan) -> pin.SE3:
        position = self.home.copy()
        position[self.description.index(plan.joints)] = plan.segments[-1].positions[-1]
        return self.kinematics.frame(position, self.arm.tip)


@pytest.fixture(scope="module")
def bench() -> Bench:
    return Bench()


def at(*position, angle=ANY, **more) -> FrameGoal:
    return FrameGoal(pose=Pose(position=tuple(map(float, position))), angle=angle, **more)


def test_out_of_reach_is_refused_and_as_near_as_can_be_where_the_place_may_give_way(bench):
    far = bench.tip.translation + np.array([2.0, 0.0, 0.0])
    with pytest.raises(Infeasible, match=r"goals\[0\]"):
        bench.plan(at(*far))
    plan = bench.plan(at(*far), relax=["goals[0]"])
    left = bench.end(plan).translation - far
    by = {gave.what: gave.by for gave in plan.gave}
    assert by["x"] == pytest.approx(-left[0], abs=2e-4) and by["x"] > 1.0
    assert np.linalg.norm(left) == pytest.approx(np.linalg.norm(list(by.values())), abs=1e-3)
    assert all(gave.goal.startswith("goals[0]") and gave.unit == "m" for gave in plan.gave)
    assert plan.preview(fresh=True).gave == list(plan.gave)


def test_what_is_named_first_gives_first_and_what_is_not_named_holds(bench):
    x, y, z = bench.tip.translation
    here, there = at(x, y + 0.05, z), at(x, y - 0.05, z)  # both at once: no
    for first, (gives, holds) in {"goals[0]": (0.05, -0.05), "goals[1]": (-0.05, 0.05)}.items():
        other = "goals[1]" if first == "goals[0]" else "goals[0]"
        plan = bench.plan(here, there, relax=[first, other])
        assert bench.end(plan).translation == pytest.approx([x, y + holds, z], abs=2e-3)
        assert {gave.goal.partition(" ")[0] for gave in plan.gave} == {first}
        assert max(gave.by for gave in plan.gave) == pytest.approx(abs(gives - holds), abs=2e-3)
    plan = bench.plan(here, there, relax=["goals[1]"])
    assert bench.end(plan).translation == pytest.approx([x, y + 0.05, z], abs=3e-4)


def test_a_part_of_a_pose_may_give_way_alone(bench):
    """The wrist may not turn as far as is asked: its angle gives, its place does not."""
    quaternion = pin.Quaternion(bench.tip.rotation).coeffs()
    pose = Pose(position=tuple(bench.tip.translation), orientation=tuple(map(float, quaternion)))
    joint = bench.arm.joints[-1]
    row = bench.description.index([joint])[0]
    turned = JointsGoal(positions={joint: float(bench.home[row]) + 0.6})
    still = JointsGoal(
        positions={one: float(bench.home[bench.description.index([one])[0]]) for one in bench.arm.joints[:1]}
    )
    plan = bench.plan(FrameGoal(pose=pose), turned, still, relax=["goals[0].angle"])
    assert bench.end(plan).translation == pytest.approx(bench.tip.translation, abs=3e-4)
    assert [gave.what for gave in plan.gave] == ["angle"]
    assert plan.gave[0].by == pytest.approx(
        np.linalg.norm(pin.log3(bench.tip.rotation.T @ bench.end(plan).rotation)), abs=2e-3
    )


def test_where_all_can_be_kept_nothing_gives(bench):
    x, y, z = bench.tip.translation
    plan = bench.plan(at(x, y + 0.1, z - 0.05), relax=["goals[0]"])
    assert plan.gave == ()


@pytest.mark.parametrize(
    ("relax", "words"),
    [
        ("goals[3]", r"relax\[0\]: got 'goals\[3\]'; expected one of goals\[0\], goals\[1\]"),
        ("clearance", r"relax\[0\]: got 'clearance'; expected one of goals\[0\]"),
        ("goals[1].angle", r"relax\[0\]: got 'goals\[1\].angle'; expected goals\[1\], which has no angle"),
        ("goals[0].tilt", r"relax\[0\]: got 'goals\[0\].tilt'"),
    ],
)
def test_what_is_not_there_cannot_give_way(bench, relax, words):
    turned = JointsGoal(positions={bench.arm.joints[-1]: 0.5})
    with pytest.raises(ValueError, match=words):
        bench.plan(at(*bench.tip.translation), turned, relax=[relax])
