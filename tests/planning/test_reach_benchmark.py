"""The benchmark's own half, whatever the time: its goals can be reached, and its judge sees what is wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.reach import Reaches
from engines.planning.collision.margins import Margins
from engines.planning.verifier import Verifier

GOALS = 8


@pytest.fixture(scope="module")
def reaches() -> Reaches:
    return Reaches(GOALS)


def test_a_reach_is_found_and_sound_and_another_goals_plan_is_not(reaches):
    verifier = Verifier(reaches.world, margins=Margins(0.01, 0.01))
    plans = [reaches.plan(number) for number in range(2)]
    assert all(reaches.sound(verifier, number, plan) for number, plan in enumerate(plans))
    assert not reaches.sound(verifier, 0, plans[1])
    hurried = replace(
        plans[0],
        segments=tuple(replace(s, times=s.times / 20.0, velocities=s.velocities * 20.0) for s in plans[0].segments),
    )
    assert not reaches.sound(verifier, 0, hurried)


def test_the_same_question_has_the_same_answer_whatever_was_asked_before(reaches):
    """What measures is kept from one question to the next in the same world; where coal ended with each pair is not."""
    first = [reaches.plan(number) for number in range(GOALS)]
    again = [reaches.plan(number) for number in reversed(range(GOALS))][::-1]
    for one, other in zip(first, again, strict=True):
        assert np.array_equal(one.segments[0].positions, other.segments[0].positions)
        assert one.clearance == other.clearance
