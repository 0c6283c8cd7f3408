"""The motion that the faults interrupt: the tool goes in between two spokes, turns the wheel by a stroke, lets go, draws back.

Planned once, by the planner that programs use; the runs' robots begin with the tool in front of the wheel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from affordance_templates import catalogue
from affordance_templates.instance import Instance
from affordance_templates.joint_estimate import joint_after_push
from engines.planning.plan import Segment
from engines.planning.strokes.manipulation import ManipulationPlanner
from handrail.messages import Pose
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics

ROBOT, SCENE, OBJECT, ARM = "talos_upper", "valve", "valve", "right"
VALVE = Pose(position=(0.55, -0.35, 0.30))
"""where the scene's valve stands (rtc_programs/scenes/valve.yaml)"""
SEGMENTS = ("engage", "turn", "release", "withdraw")
NEEDED_SHARE = 0.8
"""of the angle that the template expects of the stroke, for a success"""


@dataclass(frozen=True)
class Turn:
    """The stroke."""

    joints: tuple[str, ...]
    start: dict[str, float]
    """joint → rad, where the robot begins"""
    segments: tuple[Segment, ...]
    angle: float
    """rad that the wheel turns when all goes well, at least"""


def plan() -> Turn:
    """Plan the stroke; takes some seconds. Raises engines.planning.plan.Infeasible."""
    description = robots.load(ROBOT)
    planner = ManipulationPlanner(description, Kinematics(description))
    wheel = Instance("wheel_1", catalogue.load("wheel"), VALVE)
    made = planner.plan(wheel, "turn", ARM, description.home_position("ready"))
    segments = tuple(made.segment(name) for name in SEGMENTS)
    first = segments[0].positions[0]
    start = dict(zip(made.joints, np.asarray(first).tolist(), strict=True))
    template = wheel.resolve()
    joint, entry = template.joints["hinge"], template.trajectories["turn"].entry
    assert entry is not None  # the library's wheel has one
    angle = joint_after_push(joint, entry, made.outputs["entry_angle"], made.outputs["end_angle"])
    return Turn(made.joints, start, segments, NEEDED_SHARE * (angle - joint.position))
