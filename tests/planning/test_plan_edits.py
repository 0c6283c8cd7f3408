"""An edited motion of a real arm passes where its ghost was dragged to, and says when, and how hard the arm works."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from engines.planning.planners import Planners
from engines.plans.freshness import World
from engines.plans.making import make_edit, make_motion
from engines.plans.store import PlanStore
from handrail.messages import EditPlan, FrameGoal, PlanMotion, Pose

ARM = "right"


@pytest.fixture(scope="module")
def services(description):
    """What the engine lends to planning, with a robot at home in an empty world."""
    world = World(0, description.home_position("ready"))
    return SimpleNamespace(
        description=description,
        daemon=SimpleNamespace(world=lambda: world),
        affordances=SimpleNamespace(instances=list),
        plans=PlanStore(list, lambda: world, lambda preview: None),
        planner=Planners(description),
    )


def tip(services, kinematics, plan, time: float) -> np.ndarray:
    """(3,) m, where the tool's tip is at a time of a plan, s."""
    starts = np.array(plan.starts)
    row = int(np.searchsorted(starts, time, side="right")) - 1
    segment = plan.segments[row]
    position = services.description.home_position("ready")
    q = [np.interp(time - starts[row], segment.times, column) for column in segment.positions.T]
    position[services.description.index(plan.joints)] = q
    return np.array(kinematics.frame(position, services.description.arms[ARM].tip).translation)


def to(place) -> list[FrameGoal]:
    return [FrameGoal(pose=Pose(position=tuple(map(float, place))), angle=math.pi)]


def test_the_way_passes_the_place_that_it_was_dragged_to(services, kinematics):
    goal = np.array([0.45, -0.30, 0.30])
    reach, _ = make_motion(services, PlanMotion(goals=to(goal), arm=ARM))
    half = reach.plan.duration / 2
    middle = tip(services, kinematics, reach.plan, half)
    raised = middle + np.array([0.0, 0.0, 0.06])
    once, shown = make_edit(services, EditPlan(id=reach.plan.id, goals=to(raised), time=half))
    (when,) = shown.key_times
    assert np.linalg.norm(tip(services, kinematics, once.plan, when) - raised) < 2e-3
    assert np.linalg.norm(tip(services, kinematics, once.plan, once.plan.duration) - goal) < 1e-3
    assert [(waypoint.name, waypoint.time) for waypoint in shown.waypoints] == [
        ("key frame 0", when),
        ("goals", pytest.approx(once.plan.duration, abs=1e-3)),
    ]
    assert min(waypoint.clearance.value for waypoint in shown.waypoints) == pytest.approx(once.plan.clearance, abs=1e-4)
    assert shown.waypoints[0].residual is None and shown.waypoints[1].residual < 1e-3
    for waypoint in shown.waypoints:
        assert waypoint.time - once.plan.duration <= 1e-3 and waypoint.clearance.time <= waypoint.time + 1e-3
        assert waypoint.torque_share is not None and 0.0 < waypoint.torque_share.value < 1.0
        assert waypoint.torque_share.about in once.plan.joints
