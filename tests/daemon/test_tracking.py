"""Joint trajectories on a robot with friction, backlash and motors calibrated badly: where its tools really are."""

from __future__ import annotations

import dataclasses

import numpy as np

from benchmarks import tracking
from handrail.robot import description as robots


def test_the_outer_integral_brings_the_tools_of_a_worn_robot_to_where_they_are_wanted(tmp_path) -> None:
    worn = robots.load(tracking.ROBOT)
    short = {"count": 2, "first_s": 0.6, "move_s": 0.8, "stand_s": 0.55}
    with_ = tracking.run(worn, **short)
    without = tracking.run(dataclasses.replace(worn, integral=None), **short)
    assert without.worst[without.standing].max() > 2 * tracking.GOAL_MM
    assert with_.worst[with_.standing].max() < tracking.GOAL_MM / 2
    assert np.mean(with_.worst) < 0.8 * np.mean(without.worst), "on the way, too, fast as it is"
    assert worn.integral is not None
    assert (np.abs(with_.offset) <= worn.integral.limit).all()
    assert not without.offset.any()
    tracking.draw(tmp_path / "tracking.png", worn, with_, without)
    assert (tmp_path / "tracking.png").stat().st_size > 20_000
