"""TALOS balances on its own feet by what the daemon estimates; the plant judges."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.exchange import ActionState, Answer, Flag, Rule
from hal.hardware import Goal
from handrail.messages import JointTrajectory, WholeBody


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


def test_legs_and_torso_balance_whatever_else_moves_an_arm(standing) -> None:
    bench = standing()
    names = bench.description.joints
    legs = [name for name in names if not name.startswith("arm")]
    assert bench.begin(WholeBody(compound="stand", joints=legs)) is Answer.ACCEPTED
    bench.run(200)
    soles, before = bench.soles(), bench.loop.written.position.copy()
    swing, s = 0.5, np.linspace(0.0, 1.0, 11)
    shoulder = ["arm_right_1_joint", "arm_right_4_joint"]
    way = JointTrajectory(
        joints=shoulder,
        times=(1.2 * s).tolist(),
        positions=(before[bench.description.index(tuple(shoulder))] + swing * (s**2 * (3 - 2 * s))[:, None]).tolist(),
        velocities=np.tile((swing * 6 * s * (1 - s) / 1.2)[:, None], (1, 2)).tolist(),
    )
    assert bench.start(way) is Answer.ACCEPTED
    off = slipped = 0.0

    def look() -> None:
        nonlocal off, slipped
        middle = bench.soles()[:, :2].mean(axis=0)
        off = max(off, float(np.abs(bench.com()[:2] - middle).max()))
        slipped = max(slipped, float(np.abs(bench.soles() - soles).max()))

    bench.run(600, lambda: look() if bench.loop.cycles % 10 == 0 else None)
    assert [bench.action(slot)[0] for slot in range(2)] == [ActionState.RUNNING, ActionState.ENDED]
    assert bench.world.position[names.index(shoulder[0])] - before[names.index(shoulder[0])] > 0.4, "the arm did move"
    assert off < 0.015, "m, the centre of mass beside the feet's middle"
    assert slipped < 0.001


def test_let_down_and_held_it_stands_and_pushed_too_hard_it_falls_damped_and_stops_once_it_lies(standing) -> None:
    bench = standing("hoist")
    hoist = bench.world.hoist
    assert bench.begin(WholeBody(compound="stand")) is Answer.NOT_STANDING, "it hangs"
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
