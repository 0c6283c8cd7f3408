"""Random goals among random boxes, on four robots, asked as an engine asks: a plan that an independent check has nothing against,
or an error that names why; what can't be met or meant has an error of its own."""

from __future__ import annotations

import math
from collections import Counter

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from affordance_templates import catalogue
from affordance_templates.instance import Instance
from engines.planning.collision.obstacles import placement_of
from engines.planning.plan import Infeasible
from handrail.messages import FrameGoal, GazeGoal, JointsGoal, PlanMotion, Pose
from tests.planning.random_questions import NAMES, Robot, answer, questions, robot_of

SETTINGS = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
QUICK = {"derandomize": True, "database": None} | SETTINGS
PATIENCE = 4000
"""times that a planner asks whether to go on, in `make test`; nothing here needs so many"""

robots = pytest.mark.parametrize("name", NAMES)


def driven(name: str, patience: int, **chosen: object) -> Counter[str]:
    robot, found = robot_of(name), Counter[str]()

    @settings(**chosen)
    @given(question=questions(robot))
    def drive(question):
        found[answer(robot, *question, patience=patience)] += 1

    drive()
    return found


@robots
def test_whatever_plan_comes_back_passes_the_independent_check_and_whatever_does_not_is_told_why(name):
    found = driven(name, PATIENCE, max_examples=10, **QUICK)
    assert found["plan"] >= 3 and found["refused"] >= 1, f"nothing was shown: {found}"


@pytest.mark.soak
@robots
def test_of_five_hundred_random_goals_every_one_has_a_sound_plan_or_a_reason(name):
    found = driven(name, 10**9, max_examples=500, **SETTINGS)
    assert found["plan"] > 0.4 * found.total() and not found["ended"], found


def refusal(robot: Robot, call: PlanMotion, around: list[Instance] | None = None) -> Infeasible:
    with pytest.raises(Infeasible) as refused:
        robot.planners.motion(call, around or [], robot.home)
    return refused.value


def reach(robot: Robot, place: np.ndarray, **changes: object) -> PlanMotion:
    goal = FrameGoal(pose=Pose(position=tuple(place.tolist())), angle=math.pi)
    return PlanMotion(goals=[msgspec.structs.replace(goal, **changes)], arm=robot.arm)


def out_of_reach(robot: Robot, generator: np.random.Generator) -> None:
    """Metres beyond the reach, along any direction: missed by about what is between."""
    far = generator.normal(size=3)
    far *= generator.uniform(4.0, 20.0) / np.linalg.norm(far)
    refused = refusal(robot, reach(robot, far))
    assert refused.constraint.startswith(f"goals[0] ({robot.tip})") and refused.unit == "m"
    assert (np.abs(far).max() - 3.0) / math.sqrt(3.0) < refused.by < np.linalg.norm(far) + 2.5


def inside_an_obstacle(robot: Robot, generator: np.random.Generator) -> None:
    """Within a box that is to be kept clear of: the box is named."""
    size = dict(zip(("depth", "width", "height"), generator.uniform(0.1, 0.5, 3).tolist(), strict=True))
    here = robot.kinematics.frame(robot.home, robot.tip).translation
    away = generator.normal(size=3)
    away *= 0.75 / np.linalg.norm(away)
    box = Instance("crate", catalogue.load("box"), Pose(position=tuple((here + away).tolist())), size)
    share = generator.uniform(-0.45, 0.45, 3)
    within = placement_of(box.pose_in_world).act(share * np.array(list(size.values())))
    refused = refusal(robot, reach(robot, within), [box])
    words = (
        "of crate" if refused.where == "where the robot stands" else "goal from body of crate, inside of which it is"
    )
    assert words in refused.detail and refused.unit == "m" and refused.by > 0.0, str(refused)


def where_it_stands(robot: Robot, generator: np.random.Generator) -> None:
    """A box about the tool: no motion may begin there, whatever its goal is."""
    here = robot.kinematics.frame(robot.home, robot.tip).translation
    size = dict(zip(("depth", "width", "height"), generator.uniform(0.1, 0.3, 3).tolist(), strict=True))
    box = Instance("crate", catalogue.load("box"), Pose(position=tuple(here.tolist())), size)
    refused = refusal(robot, reach(robot, here + generator.uniform(-0.1, 0.1, 3)), [box])
    assert (refused.constraint, refused.where, refused.unit) == ("clearance", "where the robot stands", "m")
    assert "of crate" in refused.detail


@robots
@pytest.mark.parametrize("trouble", [out_of_reach, inside_an_obstacle, where_it_stands])
def test_whatever_goal_can_not_be_met_is_told_why(name, trouble):
    @settings(max_examples=3, **QUICK)
    @given(seed=st.integers(0, 2**32 - 1))
    def drive(seed):
        trouble(robot_of(name), np.random.default_rng(seed))

    drive()


def pose(**changes: object) -> Pose:
    return msgspec.structs.replace(Pose(position=(0.4, 0.0, 0.4)), **changes)


def wrong(robot: Robot, number: float, place: int) -> list[tuple[dict[str, object], str]]:
    """Changes of a call, each with what its error names; `number` is not finite, `place` 0 to 2."""
    spoilt = tuple(number if axis == place else 0.4 for axis in range(3))
    joint, words = robot.joints[place], "(nan|inf)"
    return [
        ({"goals": [FrameGoal(pose=pose(position=spoilt))]}, rf"goals\[0\].pose.position: got .*{words}.*finite"),
        ({"goals": [FrameGoal(pose=pose(orientation=(*spoilt, 1.0)))]}, rf"pose.orientation: got .*{words}.*finite"),
        ({"goals": [JointsGoal(positions={joint: number})]}, rf"positions\[{joint}\]: got .*{words}.*finite"),
        ({"goals": [JointsGoal(positions={joint: 0.3}, tolerance=number)]}, rf"tolerance: got .*{words}.*finite"),
        ({"goals": [GazeGoal(frame=robot.tip, target=spoilt, cone=0.1)]}, rf"target: got .*{words}.*finite"),
        ({"keep": [FrameGoal(pose=pose(position=spoilt))]}, rf"keep\[0\].pose.position: got .*{words}.*finite"),
        ({"clearance": number}, rf"clearance: got .*{words}.*finite"),
        ({"duration": number}, rf"duration: got .*{words}.*finite"),
        ({"goals": []}, "goals: expected at least one"),
        ({"goals": [JointsGoal(positions={})]}, r"goals\[0\].positions: got none"),
        ({"goals": [FrameGoal(pose=pose(orientation=(0.0, 0.0, 0.0, 0.0)))]}, "orientation: .*length 0; expected a unit"),
        ({"goals": [FrameGoal(pose=pose(orientation=(0.0, 0.0, 1.0, 1.0)))]}, "orientation: .*length 1.41; expected a unit"),
        ({"goals": [FrameGoal(pose=pose(), angle=4.0)]}, "angle: got 4.0; expected 0 to π"),
        ({"goals": [FrameGoal(pose=pose(), angle=math.pi, below=(None,) * 3, above=(None,) * 3)]}, "no bound"),
        ({"goals": [GazeGoal(frame=robot.tip, axis=(0.0, 0.0, 0.0), cone=0.1)]}, "axis: got .*expected a direction"),
        ({"goals": [JointsGoal(positions={joint: 9.0})]}, rf"positions\[{joint}\]: got 9; expected .*limits"),
        ({"goals": [FrameGoal(frame="hnad", pose=pose())]}, r"goals\[0\].frame: got 'hnad'"),
    ]  # fmt: skip


@robots
def test_what_is_no_number_or_has_no_meaning_is_refused_by_its_field(name):
    robot, good = robot_of(name), JointsGoal(positions={robot_of(name).joints[0]: 0.1})

    @settings(max_examples=34, **QUICK)
    @given(number=st.sampled_from([math.nan, math.inf, -math.inf]), place=st.integers(0, 2), which=st.integers(0, 16))
    def drive(number, place, which):
        changes, words = wrong(robot, number, place)[which]
        with pytest.raises(ValueError, match=words):
            robot.planners.motion(PlanMotion(**({"goals": [good], "arm": robot.arm} | changes)), [], robot.home)
        start = robot.home.copy()
        start[robot.rows[place]] = number
        with pytest.raises(ValueError, match=rf"position\.{robot.joints[place]}: got .*(nan|inf)"):
            robot.planners.motion(PlanMotion(goals=[good], arm=robot.arm), [], start)

    drive()
