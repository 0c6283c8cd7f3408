"""The benchmark's own half, whatever the time: its goals can be reached, and its judge sees what is wrong."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks.reach import Reaches
from engines.planning.margins import Margins
from engines.planning.verifier import Verifier


@pytest.fixture(scope="module")
def reaches() -> Reaches:
    return Reaches(2)


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
