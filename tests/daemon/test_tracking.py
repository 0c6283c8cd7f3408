"""Joint trajectories on a robot with friction, backlash and motors calibrated badly: where its tools really are."""

from __future__ import annotations

import dataclasses

import numpy as np

from benchmarks import tracking
from handrail.robot import library as robots


def test_the_outer_integral_brings_the_tools_of_a_worn_robot_to_where_they_are_wanted(tmp_path) -> None:
    """Its friction and backlash are others than its daemon is told."""
    worn = tracking.drawn(robots.load(tracking.ROBOT), 1)
    short = {"count": 2, "first_s": 0.6, "move_s": 0.8, "stand_s": 0.55}
    with_, alone = tracking.run(worn, **short), tracking.run(tracking.alone(worn), **short)
    without = tracking.run(dataclasses.replace(worn, integral=None), **short)
    assert without.worst[without.standing].max() > 2 * tracking.GOAL_MM
    assert with_.worst[with_.standing].max() < tracking.GOAL_MM
    assert np.mean(alone.worst) < 0.8 * np.mean(without.worst), "on the way, too, fast as it is"
    assert np.mean(with_.worst) < 0.8 * np.mean(alone.worst), "and better where friction and backlash are known about"
    assert with_.hunting < 1e-3
    assert worn.integral is not None
    assert (np.abs(with_.offset) <= worn.integral.limit).all()
    assert not without.offset.any()
    tracking.draw(tmp_path / "tracking.png", worn, with_, alone, without)
    assert (tmp_path / "tracking.png").stat().st_size > 20_000
