"""TALOS balances on its own feet by what the daemon estimates; the plant judges."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.exchange import ActionState, Answer, Flag, Rule
from hal.hardware import Goal
from handrail.messages import WholeBody


def test_talos_stands_on_its_estimate_comes_upright_and_takes_a_push_with_feet_that_stay(standing) -> None:
    bench = standing()
    assert bench.begin(WholeBody(compound="stand")) is Answer.ACCEPTED
    bench.run(400)
    before, soles = bench.world.truth().base_in_world.position, bench.soles()
    furthest = off = slipped = cycle = 0.0

    def look() -> None:
        nonlocal furthest, off, slipped, cycle
        cycle += 1
        if cycle % 5:
            return
        furthest = max(furthest, abs(bench.world.truth().base_in_world.position[0] - before[0]))
        off, slipped = max(off, bench.base_off()), max(slipped, float(np.abs(bench.soles() - soles).max()))

    bench.shove((60.0, 20.0, 0.0))
    bench.run(700, look)
    assert bench.action()[0] is ActionState.RUNNING
    assert furthest > 0.005, "it was pushed"
    assert off < 0.003
    assert slipped < 0.001
    assert bench.tilt() < np.radians(0.5)
    assert np.linalg.norm(np.subtract(bench.world.truth().base_in_world.position, before)) < 0.005, "and is back"
    assert bench.com()[:2] == pytest.approx(bench.soles()[:, :2].mean(axis=0), abs=0.01)


def test_let_down_and_held_it_stands_and_pushed_too_hard_it_falls_damped_and_stops_once_it_lies(standing) -> None:
    bench = standing("hoist")
    hoist = bench.world.hoist
    assert bench.begin(WholeBody(compound="stand")) is Answer.NOT_ACTIVATED, "it hangs"
    for _ in range(1000):
        if hoist.slack:
            break
        bench.run()
    assert hoist.slack
    bench.run(200)
    assert bench.tilt() < np.radians(2.0)
    assert np.abs(bench.loop.written.position - bench.world.position).max() < 0.02, "no joint sags under the weight"
    bench.shove((300.0, 0.0, 0.0))
    for _ in range(500):
        bench.run()
        if bench.snapshot()["safety"][Rule.BALANCE]["times"]:
            break
    assert bench.snapshot()["safety"][Rule.BALANCE]["holds"]
    assert bench.tilt() < np.radians(20.0), "it is said while the robot still falls"
    assert not bench.loop.written.stiffness.any()
    bench.run(750)
    assert bench.tilt() > np.radians(45.0)
    assert not bench.snapshot()["flags"] & Flag.ENABLED
    assert bench.loop.hardware.goal is Goal.QUICK_STOP
