"""TALOS stands for thirty simulated seconds; minutes of this machine's."""

from __future__ import annotations

import pytest

from benchmarks.balance import OFF_MM, SLIP_MM, STAND_S, stand
from handrail.robot import library as robots


@pytest.mark.soak
@pytest.mark.timeout(1800)
def test_let_down_by_its_gantry_it_stands_for_half_a_minute_with_feet_that_stay():
    told = stand(robots.load("talos"), STAND_S)
    assert told["slip"] < SLIP_MM
    assert told["base"] < OFF_MM
    assert told["com"] < 20.0, "mm"
    assert told["estimate"] < OFF_MM, "of which most is from hanging, where nothing measures it"
