"""The integral on the joint encoders' error: what it works off, what bounds it, and what it leaves alone."""

from __future__ import annotations

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

from daemon import exchange
from daemon.controllers.base import Ended
from daemon.controllers.outer_integral import CROSSING, PRESLIDING, SEARCHING, OuterIntegral
from daemon.exchange import Answer, Outcome
from handrail.messages import CartesianImpedance, JointStream, Pose, StreamJoints
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


def test_an_error_is_worked_off_while_a_client_streams_the_reference(make_tracking) -> None:
    bench = make_tracking()
    start, row = float(bench.loop.written.position[bench.index(JOINT)]), bench.index(JOINT)
    assert bench.start(JointStream(joints=[JOINT])) is Answer.ACCEPTED
    action = int(bench.snapshot()["actions"][0]["serial"])
    lean(bench, -10.0)
    for sample in range(120):
        swing = 0.02 * np.sin(0.02 * sample)
        message = StreamJoints(id="a", sequence=sample + 1, positions=[start + swing], velocities=[0.0])
        bench._serial += 1
        bench._mailbox.post(*exchange.encode_joints(message, bench._serial, action))
        bench.run(5)
        if sample == 20:
            assert off(bench) > 2e-3
    assert off(bench) < 4 * BAND, "of a reference that moves"
    assert abs(learned(bench)[row]) > 2e-3


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


FRICTION, SLACK, STIFFNESS, PERIOD = 2.0, 0.0175, 500.0, 0.002


class Joint:
    """One joint whose friction and backlash are known about; the test says what is measured of it."""

    def __init__(self, backlash: float = 2 * SLACK):
        each = np.ones(1)
        gains = IntegralGains(
            rate=8 * each, limit=0.06 * each, push=6 * each, band=0.001 * each, friction=FRICTION, backlash=backlash
        )
        self.integral = OuterIntegral(gains, PERIOD)

    def write(self, velocity: float = 0.0, carried: float = 0.0, error: float = 0.0, gravity: float = 0.0) -> float:
        """A cycle; N·m that are fed forward."""
        measured, out = np.array([[-error], [0.0], [carried]]), np.zeros((5, 1))
        gains, mode = np.array([[STIFFNESS], [10.0]]), np.zeros(1, np.uint8)
        given = np.zeros(1, np.int64), np.zeros(1), np.array([velocity]), np.array([gravity])
        self.integral.write(*given, gains, measured, out, mode)
        return float(out[2, 0])

    @property
    def offset(self) -> float:
        return float(self.integral.offset[0])


def test_friction_acts_in_the_references_direction_and_stays_when_it_stands() -> None:
    joint = Joint(backlash=0.0)
    cycles = round(PRESLIDING / (0.1 * PERIOD))
    torques = [joint.write(velocity=0.1) for _ in range(cycles)]
    assert np.diff(torques) == pytest.approx(FRICTION / cycles)
    assert torques[-1] == pytest.approx(FRICTION)
    assert joint.write(velocity=0.1) == pytest.approx(FRICTION), "not more than there is"
    for carried in (FRICTION, 0.0, -FRICTION):
        assert joint.write(carried=carried) == pytest.approx(FRICTION), "what is measured moves nothing"
    assert joint.write(velocity=-0.1) == pytest.approx(FRICTION - FRICTION / cycles)
    joint.write(velocity=np.nan)
    assert joint.write() == pytest.approx(FRICTION - FRICTION / cycles), "nor does what is no number"
    joint.integral.forget(np.ones(1, bool))
    assert joint.write() == 0.0


def touched(side: float = 1.0) -> Joint:
    """One whose motor has been found at a side of the gap."""
    joint = Joint()
    joint.write(carried=side * FRICTION)
    return joint


def test_a_joint_whose_load_turns_has_its_motor_led_across_the_gap_in_bounded_steps() -> None:
    joint = touched()
    before = joint.write(carried=1.0, gravity=1.0)
    torques = np.array([joint.write(gravity=-3.0) for _ in range(30)])
    assert before - torques[-1] == pytest.approx(2 * STIFFNESS * SLACK + 4.0)
    steps, cycles = -np.diff(torques), round(CROSSING / PERIOD)
    assert steps[: cycles - 1] == pytest.approx(2 * STIFFNESS * SLACK / cycles)
    assert steps[cycles - 1 :] == pytest.approx(0.0, abs=1e-9)


def test_the_motor_stays_at_its_side_while_the_spring_carries_something_whatever_the_joint_needs() -> None:
    joint = touched()
    before = joint.write(carried=1.0)
    assert joint.write(carried=1.0, error=-0.0009) == before
    assert joint.write(carried=0.0, error=-0.0009) == before, "it stands: less than its friction turns no joint round"
    assert joint.write(carried=-1.0) < before, "it is at the other side already"


def test_the_integral_waits_while_the_motor_crosses() -> None:
    joint = touched()
    joint.write(carried=1.0, error=0.003)
    before = joint.offset
    for _ in range(round(CROSSING / PERIOD)):
        joint.write(velocity=-0.01, error=-0.003)
        assert joint.offset == before
    for _ in range(2):
        joint.write(velocity=-0.01, error=-0.003)
    assert joint.offset < before


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_joint_that_was_never_in_touch_is_searched_for_slowly_and_the_touch_leaves_no_bump(side: float) -> None:
    joint = Joint()
    torques = [joint.write(gravity=side * 2.5) for _ in range(20)]
    assert np.diff(torques) == pytest.approx(side * 2 * STIFFNESS * SLACK * PERIOD / SEARCHING)
    found = joint.write(carried=side * 0.5, gravity=side * 2.5)
    assert found == pytest.approx(torques[-1]), "what the search was ahead or behind is the calibration's"
    assert joint.offset == pytest.approx((torques[-1] - side * 2.5) / STIFFNESS - side * SLACK)
