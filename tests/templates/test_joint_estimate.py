"""What the tool's motion says about the wheel."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from affordance_templates import catalogue
from affordance_templates.instance import Instance
from affordance_templates.joint_estimate import angle_about, joint_after_push
from handrail.messages import Pose

RESOLVED = catalogue.load("wheel").resolve()
HINGE, ENTRY = RESOLVED.joints["hinge"], RESOLVED.trajectories["turn"].entry
TOUCHING = ENTRY.contact_offset


@pytest.mark.parametrize("angle", [-3.0, -1.0, 0.0, 0.4, 2.0, 3.1])
def test_the_angle_of_a_point_counts_from_the_waypoint_about_the_hinge(angle):
    point = np.array([0.02, 0.1 * math.cos(angle), 0.1 * math.sin(angle)])
    assert angle_about(HINGE, np.array([0.05, 0.1, 0]), point) == pytest.approx(angle)
    assert angle_about(HINGE, np.array([0.05, 0.1, 0]), point, near=angle + 2 * math.pi) == pytest.approx(
        angle + 2 * math.pi
    )


def test_an_instance_in_the_world_gives_the_same_angle():
    half = math.radians(30) / 2
    pose = Pose(position=(0.5, -0.3, 0.3), orientation=(0, 0, math.sin(half), math.cos(half)))
    instance = Instance("w", catalogue.load("wheel"), pose)
    in_template = np.array([0.02, 0.0, 0.1])
    in_world = instance.rotation @ in_template + [0.5, -0.3, 0.3]
    assert instance.point_in_template(in_world) == pytest.approx(in_template)
    assert instance.rotation @ [1, 0, 0] == pytest.approx([math.cos(math.radians(30)), 0.5, 0])


@pytest.mark.parametrize("start", [0.0, 0.3, 2.0, -1.0, 7.0])
def test_the_first_spoke_ahead_is_pushed_from_where_the_tool_touches_it(start):
    joint = replace(HINGE, position=start)
    entry_angle = start + math.radians(45)  # half-way between two spokes
    untouched = entry_angle + math.radians(45) - TOUCHING
    assert joint_after_push(joint, ENTRY, entry_angle, untouched - 0.01) == pytest.approx(start)
    assert joint_after_push(joint, ENTRY, entry_angle, untouched + 0.5) == pytest.approx(start + 0.5)


def test_the_wheel_never_runs_back():
    assert joint_after_push(HINGE, ENTRY, 0.8, 0.1) == HINGE.position


def test_a_reference_on_the_axis_is_refused():
    with pytest.raises(ValueError, match="lies on the axis"):
        angle_about(HINGE, np.array([0.3, 0, 0]), np.array([0, 0.1, 0]))
