"""The integral on the joint encoders' error: what it works off, what bounds it, and what it leaves alone."""

from __future__ import annotations

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from daemon.controllers.base import Ended
from daemon.exchange import Answer, Outcome
from daemon.outer_integral import OuterIntegral
from handrail.messages import CartesianImpedance, Pose
from handrail.robot.description import IntegralGains
from tests.daemon.loop.test_manager import rated_jump

JOINT = "arm_right_2_joint"
LIMIT, BAND = 0.05, 0.0005


@pytest.fixture
def make_tracking(talos, make_bench):
    """Makes an enabled robot with the integral, whose torque rate limiter cannot hide a bump."""

    def make(push: float = 100.0, limit: float = LIMIT):
        each = np.ones(len(talos.joints))
        integral = IntegralGains(rate=6.0 * each, limit=limit * each, push=push * each, band=BAND * each)
        bench = make_bench(dataclasses.replace(talos, integral=integral))
        limits = bench.loop.last_word.limits
        bench.loop.last_word.limits = dataclasses.replace(limits, torque_step=np.full_like(limits.torque_step, np.inf))
        bench.enable()
        return bench

    return make


def learned(bench) -> np.ndarray:
    """rad (n,)"""
    return bench.loop.manager.gains.integral.offset


def off(bench) -> float:
    """rad between the joint and its command"""
    row = bench.index(JOINT)
    return float(abs(bench.loop.written.position[row] - bench.drives.state.position[row]))


def lean(bench, torque: float) -> None:
    """Something pushes the joint with so many N·m: to the loop it is as if its drive were calibrated wrong."""
    bench.drives.external_torque[bench.index(JOINT)] = torque


def test_an_error_that_would_stay_is_worked_off_and_the_command_stays_what_was_asked_for(make_tracking) -> None:
    bench = make_tracking()
    asked = bench.loop.written.position.copy()
    lean(bench, -10.0)
    bench.run(100)
    assert off(bench) > 5e-3
    bench.run(500)
    assert off(bench) < 1.5 * BAND
    np.testing.assert_array_equal(bench.loop.written.position, asked)


def test_an_error_within_the_band_is_left_alone(make_tracking) -> None:
    bench = make_tracking()
    row = bench.index(JOINT)
    lean(bench, 0.4 * BAND * bench.loop.manager.gains.stiffness[row])
    bench.run(300)
    assert 0.0 < off(bench) < BAND
    assert learned(bench)[row] == 0.0


def test_what_was_learned_outlives_switches_and_they_leave_no_bump(make_tracking, talos_kinematics) -> None:
    bench = make_tracking()
    row = bench.index(JOINT)
    lean(bench, -10.0)
    bench.run(500)
    before = learned(bench)[row]
    assert bench.start(bench.move(JOINT, 0.2, 0.4)) is Answer.ACCEPTED
    assert rated_jump(bench) < 0.01
    assert learned(bench)[row] == pytest.approx(before, abs=1e-4)
    while bench.action()[1] is Outcome.NONE:
        bench.run()
    assert rated_jump(bench) < 0.01
    bench.run(250)
    assert off(bench) < 2 * BAND

    arm = bench.description.arms["right"]
    tip = talos_kinematics.frame(bench.loop.written.position, arm.tip)
    x, y, z, w = pin.Quaternion(tip.rotation).coeffs().tolist()
    goal = tip.translation + np.array([0.0, 0.0, 0.01])
    motion = CartesianImpedance(
        frame=arm.tip,
        joints=list(arm.joints),
        goal_in_world=Pose(position=tuple(goal.tolist()), orientation=(x, y, z, w)),
        duration=0.3,
    )
    before = learned(bench)[row]
    assert bench.start(motion) is Answer.ACCEPTED
    assert rated_jump(bench) < 0.01
    bench.run(50)
    assert learned(bench)[row] == before, "nothing is learned where no joint reference is followed"
    while bench.action()[1] is Outcome.NONE:
        bench.run()
    assert rated_jump(bench) < 0.01


def test_it_moves_no_set_point_by_more_than_its_limit_and_comes_back_at_once(make_tracking) -> None:
    bench = make_tracking(limit=0.01)
    row = bench.index(JOINT)
    stiffness = bench.loop.manager.gains.stiffness[row]
    lean(bench, -20.0)
    bench.run(600)
    assert learned(bench)[row] == 0.01
    assert off(bench) == pytest.approx(20.0 / stiffness - 0.01, abs=2e-3)
    lean(bench, 0.0)
    bench.run(60)
    assert learned(bench)[row] < 0.01, "nothing has been wound up beyond the limit"


def test_a_joint_that_leans_on_something_is_not_pushed_harder(make_tracking) -> None:
    pushed = {}
    for push in (2.0, 100.0):
        bench = make_tracking(push=push)
        lean(bench, -20.0)
        bench.run(600)
        row = bench.index(JOINT)
        pushed[push] = bench.loop.manager.gains.stiffness[row] * learned(bench)[row]
    assert abs(pushed[2.0]) < 1.0
    assert pushed[100.0] == pytest.approx(20.0, abs=1.0)


def test_a_stop_makes_it_begin_anew(make_tracking) -> None:
    bench = make_tracking()
    lean(bench, -10.0)
    bench.run(200)
    assert np.abs(learned(bench)).max() > 0.01
    bench.loop.life.stop("a test")
    bench.run(5)
    lean(bench, 0.0)
    bench.loop.life.clear_stop()
    bench.drives.seen.clear()
    bench.enable()
    first, gravity = bench.drives.seen[0], bench.loop.robot.gravity
    np.testing.assert_allclose(first.torque, gravity, atol=0.1)


def test_a_limb_that_comes_back_begins_anew_and_the_others_go_on(make_tracking) -> None:
    bench = make_tracking()
    other = bench.index("arm_left_2_joint")
    bench.drives.external_torque[[bench.index(JOINT), other]] = -10.0
    bench.run(300)
    manager, back = bench.loop.manager, np.zeros(len(learned(bench)), bool)
    back[bench.index(JOINT)] = True
    before = learned(bench).copy()
    manager.isolate(back, bench.loop.written, Ended(Outcome.DRIVE_FAULT))
    manager.rejoin()
    assert before[bench.index(JOINT)] > 0.005
    assert learned(bench)[bench.index(JOINT)] == 0.0
    assert learned(bench)[other] == before[other] > 0.005


def test_what_is_not_a_number_is_not_learned() -> None:
    each = np.ones(2)
    integral = OuterIntegral(IntegralGains(rate=each, limit=each, push=each, band=0.0 * each), 0.002)
    rows, out, mode = np.arange(2), np.zeros((5, 2)), np.zeros(2, np.uint8)
    measured = np.array([[np.nan, 0.1], [0.0, 0.0], [0.0, np.nan], [0.0, 0.0]])
    for position in (np.array([0.2, 0.2]), np.array([np.nan, np.nan])):
        integral.write(rows, position, np.zeros(2), np.zeros(2), np.ones((2, 2)), measured, out, mode)
        assert (integral.offset == 0.0).all()
