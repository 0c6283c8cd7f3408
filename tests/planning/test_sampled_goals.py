"""Goals with tolerances are looked for all over them, not only where the nearest posture is."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest

from engines.planning import motion_search
from engines.planning.goals import message_of
from engines.planning.ik.checker import Checker
from engines.planning.ik.constraints import Direction, Orientation, Position, Posture
from engines.planning.ik.constraints import Pose as PoseConstraint
from engines.planning.ik.solver import Solver
from engines.planning.plan import Infeasible
from engines.planning.planners import Planners
from engines.planning.sampling import sampled
from handrail.messages import FrameGoal, PlanMotion, Pose
from handrail.robot import library as robots

TIP = "tool_right_tip"


@pytest.fixture(scope="module")
def panda():
    """Its planner, where it stands, and the name of its arm."""
    description = robots.load("panda")
    (arm,) = description.arms.values()
    return Planners(description).motions, description.home_position("ready"), arm


def test_whatever_keeps_a_sample_keeps_the_goal_and_samples_lie_all_over_it(mechanism, ready, kinematics, description):
    home = kinematics.frame(description.home_position("ready"), TIP)
    box = message_of(home)
    axis = tuple(home.rotation[:, 2])
    goals = [
        [Position(frame=TIP, lower=(-0.1, 0.0, -math.inf), upper=(0.1, 0.0, math.inf), box=box)],
        [PoseConstraint(frame=TIP, target=box, lower=(-0.05, -0.05, 0.0), upper=(0.05, 0.05, 0.0), angle=0.4)],
        [Position.at(TIP, home.translation), Direction(frame=TIP, axis=(0.0, 0.0, 1.0), direction=axis, cone=0.3)],
        [Posture(coefficients={"arm_right_4_joint": 1.0}, lower=-1.2, upper=-0.4)],
    ]
    solver, checker, generator = Solver(mechanism), Checker(mechanism), np.random.default_rng(3)
    for goal in goals:
        found = []
        for _ in range(12):
            answer = solver.solve(sampled(goal, generator), ready, starts=2)
            if answer.feasible:
                assert checker.violations(goal, answer.q) == ()
                found.append(answer.q)
        assert len(found) >= 8
        assert max(np.abs(a - b).max() for a in found for b in found) > 0.1


def test_goals_without_room_have_no_samples():
    exact = [Position.at(TIP, (0.4, -0.3, 0.1)), Orientation(frame=TIP, target=(0.0, 0.0, 0.0, 1.0))]
    free = [Position(frame=TIP, lower=(-math.inf, 0.0, 0.0), upper=(math.inf, 0.0, 0.0))]
    for goals in (exact, free):
        assert sampled(goals, np.random.default_rng(0)) == []


def test_where_nothing_leads_to_the_nearest_place_another_within_the_tolerance_is_gone_to(panda, monkeypatch):
    planner, home, arm = panda
    mechanism = planner.mechanism
    data = mechanism.model.createData()

    def tip(q) -> np.ndarray:
        pin.framesForwardKinematics(mechanism.model, data, q)
        return data.oMf[mechanism.frame_id(arm.tip)].translation.copy()

    centre = tip(planner.configuration("home", home)) - [0.0, 0.0, 0.1]
    goal = FrameGoal(pose=Pose(position=tuple(centre)), below=(0.2, 0.2, 0.0), above=(0.2, 0.2, 0.0), angle=math.pi)  # fmt: skip
    question = planner.read(PlanMotion(goals=[goal], arm=arm.name), [])
    nearest = planner.plan(question, home)
    end = tip(planner.configuration("end", nearest.segments[-1].positions[-1]))
    whole = motion_search.Connector.way

    def walled(self, here, there, **more):
        if np.linalg.norm(tip(there) - end) < 0.08:
            raise Infeasible("way", 0.1, "rad")
        return whole(self, here, there, **more)

    monkeypatch.setattr(motion_search.Connector, "way", walled)
    other = tip(planner.configuration("end", planner.plan(question, home).segments[-1].positions[-1]))
    assert np.linalg.norm(other - end) >= 0.08
    assert np.all(np.abs(other - centre) < [0.2 + 1e-3, 0.2 + 1e-3, 2e-4])
