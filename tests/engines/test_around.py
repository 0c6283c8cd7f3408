"""Pushing something around its hinge: chords of the circle, no more force than was allowed, and ends that are none of a failure."""

from __future__ import annotations

import math

import numpy as np
import pytest

from affordance_templates import catalogue
from affordance_templates.instance import Instance
from affordance_templates.placement import of_message, turn_between
from engines.activities.around import STIFFNESS, Circle, Push, at_stop
from handrail.messages import Pose
from handrail.robot import library as robots

FORCE, SPEED = 40.0, 0.1
ARM = robots.load("talos_upper").arms["right"]


def lever(**joints: float) -> Instance:
    return Instance("it", catalogue.load("lever_valve"), Pose(position=(0.5, -0.3, 0.2)), {}, joint_state=joints)


def circle(*, free: bool, lag: float = 0.0) -> Circle:
    """Of a tool 0.1 m above the lever's stem that points along the world's −z."""
    start = np.eye(4)
    start[:3, 3] = 0.45, -0.3, 0.3
    return Circle.of(lever(), "stem", start, free=free, lag=lag)


def test_its_centre_is_on_the_hinge_beside_the_tool():
    of = circle(free=True)
    assert of.centre == pytest.approx([0.45, -0.3, 0.2])
    assert of.radius == pytest.approx(0.1)


def test_what_is_held_turns_with_the_hinge_and_a_tool_that_may_turn_about_itself_no_more_than_it_must():
    held = circle(free=False).at(math.pi / 3)
    assert held[:3, 3] == pytest.approx([0.45, -0.3 - 0.1 * math.sin(math.pi / 3), 0.25])
    assert turn_between(np.eye(4), held) == pytest.approx(math.pi / 3)
    start = np.eye(4)
    start[:3, :3] = [[0, 0, -1], [0, 1, 0], [1, 0, 0]]  # pointing along the hinge
    start[:3, 3] = 0.45, -0.3, 0.3
    along = Circle.of(lever(), "stem", start, free=True).at(math.pi / 3)
    assert turn_between(start, along) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("angle", "turned"), [(0.5, 0.0), (-0.5, 0.0), (1.5, 0.8), (-1.5, 0.8)])
def test_a_tool_that_may_point_elsewhere_is_turned_only_by_what_is_beyond_that_and_goes_all_the_way(angle, turned):
    there = circle(free=False, lag=0.7).at(angle)
    assert turn_between(np.eye(4), there) == pytest.approx(turned)
    assert there[:3, 3] == pytest.approx(circle(free=False).at(angle)[:3, 3])


@pytest.mark.parametrize("by", [math.pi / 2, -math.pi / 6, 0.01])
def test_chords_lead_all_the_way_and_none_is_further_ahead_than_the_force_allows(by):
    of = circle(free=True)
    chords = of.chords(by, FORCE, SPEED, ARM)
    assert chords[-1].by == pytest.approx(by)
    assert sum(chord.end.distance for chord in chords) == pytest.approx(abs(by) * of.radius)
    before = 0.0
    for chord in chords:
        assert chord.motion.goal_in_world is not None
        ahead = of_message(chord.motion.goal_in_world)[:3, 3] - of.at(before)[:3, 3]
        assert STIFFNESS[0] * np.linalg.norm(ahead) <= FORCE * 1.001
        assert ahead @ np.array(chord.end.axis) > 0.7 * FORCE / STIFFNESS[0]
        before = chord.by


def test_each_chord_follows_the_one_before_when_that_has_gone_far_enough():
    steps = Push(circle(free=True).chords(1.0, FORCE, SPEED, ARM)).call("a", "o", None).steps
    following = [step.then["travel"] for step in steps]
    assert following == [*(step.name for step in steps[1:]), "end"]
    assert {step.then["done"] for step in steps} == {"end"}


def test_what_stops_shortly_before_its_joints_end_is_at_it_and_what_stops_elsewhere_is_stuck():
    stem = lever().resolve().joints["stem"]
    assert at_stop(stem, math.pi / 2, 0.85 * math.pi / 2)
    assert not at_stop(stem, math.pi / 2, 0.5 * math.pi / 2)
    assert not at_stop(stem, math.pi / 4, 0.85 * math.pi / 4), "the joint goes on behind where it was to go"
    half = lever(stem=math.pi / 4).resolve().joints["stem"]
    assert at_stop(half, math.pi / 4, 0.85 * math.pi / 4)
    assert at_stop(half, -math.pi / 4, -0.85 * math.pi / 4)
    assert not at_stop(half, -math.pi / 4, 0.85 * math.pi / 4)
