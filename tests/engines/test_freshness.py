"""Every reason why a plan goes stale, in words of its own; nothing else makes it so."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from affordance_templates import catalogue
from affordance_templates.instance import Instance
from engines.planning.plan import Plan, Segment
from engines.plans.freshness import Origin, World, causes
from handrail.messages import Base, Pose

JOINTS = ("torso", "shoulder", "elbow", "head")
WHEEL = Instance("wheel_1", catalogue.load("wheel"), Pose(position=(0.5, -0.3, 0.3)))
COMMAND = np.array([0.1, 0.2, 0.3, 0.4])


def base(x: float = 0.0, source: str = "feet", problem: str = "") -> Base:
    return Base(
        time_ns=0,
        pose_in_world=Pose(position=(x, 0.0, 1.0)),
        linear_velocity=(0.0, 0.0, 0.0),
        angular_velocity=(0.0, 0.0, 0.0),
        position_deviation=0.001,
        orientation_deviation=0.001,
        source=source,  # type: ignore[arg-type]
        problem=problem,
    )


STANDING = World(7, COMMAND, base())
PLAN = Plan(
    id="plan-1",
    label="turn",
    arm="right",
    joints=JOINTS[:3],
    segments=(Segment("turn", np.array([0.0, 1.0]), np.zeros((2, 3)), np.zeros((2, 3))),),
    made_from={"wheel_1": 1},
    start=COMMAND[:3],
    clearance=0.03,
    limit_margin=0.2,
)
ORIGIN = Origin(STANDING, JOINTS, (WHEEL,), {"instance": "wheel_1", "trajectory": "turn", "arm": "right"}, "run-1")


def found(*, wheel: Instance | None = WHEEL, start: bool = True, **world: object) -> list[tuple[str, str]]:
    now = dataclasses.replace(STANDING, **world)  # type: ignore[arg-type]
    instances = {} if wheel is None else {wheel.name: wheel}
    return [(cause.code, cause.words) for cause in causes(PLAN, ORIGIN, instances, now, start=start)]


def edited(**changes: object) -> Instance:
    return dataclasses.replace(WHEEL, version=2, **changes)  # type: ignore[arg-type]


def off(joint: str, by: float) -> np.ndarray:
    command = COMMAND.copy()
    command[JOINTS.index(joint)] += by
    return command


def test_a_plan_stays_fresh_while_nothing_moves_further_than_it_may():
    assert found() == []
    assert found(command=off("elbow", 0.019)) == found(command=off("head", -0.019)) == []
    assert found(base=base(0.009)) == []
    turned = dataclasses.replace(WHEEL, joint_state={"hinge": 0.4})
    assert found(wheel=turned) == [], "what the tool did to the wheel's joint is no edit"


@pytest.mark.parametrize(
    ("change", "cause", "words"),
    [
        ({"wheel": None}, "instance_removed", "wheel_1 was removed"),
        (
            {"wheel": edited(pose_in_world=Pose(position=(0.5, -0.3, 0.32)))},
            "instance_moved",
            "wheel_1 was moved 20 mm after the plan was made (version 1, now 2)",
        ),
        (
            {"wheel": edited(pose_in_world=Pose(position=(0.5, -0.3, 0.3), orientation=(0.0, 0.0, 0.02618, 0.99966)))},
            "instance_moved",
            "wheel_1 was turned 3.0°",
        ),
        ({"wheel": edited(parameters={"radius": 0.16})}, "instance_parameters", "radius 0.15 to 0.16"),
        ({"wheel": edited()}, "instance_changed", "version 1, now 2"),
        ({"command": off("elbow", 0.021)}, "start_left", "elbow is 0.021 rad off"),
        ({"command": off("elbow", np.nan)}, "start_left", "elbow is nan rad off"),
        ({"command": off("head", 0.3)}, "others_moved", "counts on head to stay, and it is 0.300 rad"),
        ({"base": base(0.03)}, "base_moved", "base was moved 30 mm"),
        ({"base": base(source="none", problem="the IMU is silent")}, "base_unknown", "not known: the IMU is silent"),
    ],
)
def test_each_cause_has_its_own_words(change, cause, words):
    ((code, said),) = found(**change)
    assert code == cause
    assert words in said


def test_all_causes_are_told_at_once():
    assert [code for code, _ in found(wheel=None, base=base(0.03), command=off("torso", 0.1))] == [
        "instance_removed",
        "base_moved",
        "start_left",
    ]


def test_a_plan_under_way_has_left_its_start_but_must_still_find_the_world_where_it_was():
    assert found(command=off("elbow", 1.0), start=False) == found(command=off("head", 1.0), start=False) == []
    assert found(base=base(0.03), start=False)[0][0] == "base_moved"
    assert found(wheel=edited(), start=False)[0][0] == "instance_changed"


def test_what_it_was_made_from_is_told_whole():
    told = ORIGIN.told()
    assert told.joints == dict(zip(JOINTS, COMMAND.tolist(), strict=True))
    assert told.base_in_world == base().pose_in_world
    assert (told.time_ns, told.run, told.asked["trajectory"]) == (7, "run-1", "turn")
    (wheel,) = told.instances
    assert (wheel.version, wheel.parameters["radius"]) == (1, 0.15)
