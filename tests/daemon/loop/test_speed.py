"""The operator's speed, pauses and resumptions: the path stays, and nothing goes beyond the joints' limits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.controllers.references import HermitePath, PathClock
from daemon.exchange import ActionState, Answer, Kind, Outcome
from handrail.messages import (
    CartesianImpedance,
    CompliantMotion,
    Dither,
    JointStream,
    JointTrajectory,
    Pose,
    Step,
    TimeEnd,
)

PERIOD = 0.002
SHIFT = np.array([0.2, -0.15, 0.25, 0.4, 0.5, -0.3, 0.4])
"""rad, of the right arm's joints"""


@pytest.fixture
def enabled(bench: Any) -> Any:
    bench.enable()
    return bench


def knots(shift: np.ndarray, duration: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, positions, velocities of a minimum-jerk motion by `shift` (m,) rad."""
    u = np.linspace(0.0, 1.0, 100)
    share, slope = u**3 * (10 - 15 * u + 6 * u * u), 30 * u * u * (1 - u) ** 2 / duration
    return u * duration, np.outer(share, shift), np.outer(slope, shift)


def reach(bench: Any, duration: float = 1.0) -> JointTrajectory:
    """The right arm by SHIFT, from where it is commanded."""
    joints = [f"arm_right_{number}_joint" for number in range(1, 8)]
    start = bench.loop.written.position[[bench.index(joint) for joint in joints]]
    times, positions, velocities = knots(SHIFT, duration)
    return JointTrajectory(
        joints=joints,
        times=times.tolist(),
        positions=(start + positions).tolist(),
        velocities=velocities.tolist(),
    )


def record(bench: Any, cycles: int, into: list[np.ndarray]) -> None:
    bench.run(cycles, lambda: into.append(bench.loop.written.position.copy()))


def rates(positions: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The largest velocity, acceleration and jerk of each column, by differences."""
    return [np.abs(np.diff(positions, order, axis=0)).max(axis=0) / PERIOD**order for order in (1, 2, 3)]


def run_to_end(bench: Any, into: list[np.ndarray], cycles: int = 8000) -> Outcome:
    for _ in range(cycles // 20):
        if bench.action()[0] is ActionState.ENDED:
            return bench.action()[1]
        record(bench, 20, into)
    raise AssertionError("the action did not end")


def test_speed_pause_and_resume_in_mid_motion_stay_within_velocity_acceleration_and_jerk(enabled: Any) -> None:
    bench, of = enabled, enabled.description
    motion = reach(bench)
    told: list[np.ndarray] = []
    record(bench, 5, told)
    serial = bench.post_start(motion)
    record(bench, 150, told)
    for share in (0.1, 1.0, 0.3):
        assert bench.ask(Kind.SET_SPEED, value=share) is Answer.ACCEPTED
        told.append(bench.loop.written.position.copy())
        record(bench, 60, told)
    bench.post(Kind.PAUSE, action=serial)
    record(bench, 350, told)
    assert bench.action()[0] is ActionState.PAUSED
    assert rates(told[-10:])[0].max() == 0.0, "a pause stands"
    bench.post(Kind.RESUME, action=serial)
    record(bench, 200, told)
    assert bench.snapshot()["actions"][0]["speed"] == pytest.approx(0.3), "a pause does not forget the speed"
    bench.post(Kind.SET_SPEED, value=1.0)
    assert run_to_end(bench, told) is Outcome.DONE
    velocity, acceleration, jerk = rates(told)
    assert (velocity <= of.velocity_limit).all()
    assert (acceleration <= of.acceleration_limit * 1.01).all()
    assert (jerk <= of.jerk_limit * 1.05).all()
    rows = [bench.index(joint) for joint in motion.joints]
    assert bench.loop.written.position[rows] == pytest.approx(motion.positions[-1], abs=1e-6)
    assert bench.snapshot()["limited"] == 0


def test_a_tools_line_is_slowed_down_stopped_and_gone_on_with_within_the_joints_limits(
    enabled: Any, talos_kinematics: Any
) -> None:
    bench, of = enabled, enabled.description
    tip = talos_kinematics.frame(bench.loop.written.position, "tool_right_tip")
    there = tip.translation + np.array([0.08, -0.08, 0.1])
    goal = Pose(position=tuple(there.tolist()), orientation=tuple(pin.Quaternion(tip.rotation).coeffs().tolist()))
    right = list(of.arms["right"].joints)
    motion = CartesianImpedance(frame="tool_right_tip", joints=right, goal_in_world=goal, duration=0.7)
    told: list[np.ndarray] = []
    serial = bench.post_start(motion)
    record(bench, 90, told)
    for kind, value, cycles in ((Kind.SET_SPEED, 0.1, 90), (Kind.SET_SPEED, 1.0, 90), (Kind.PAUSE, 0.0, 300)):
        bench.post(kind, action=serial, value=value)
        record(bench, cycles, told)
    assert bench.action()[0] is ActionState.PAUSED
    bench.post(Kind.RESUME, action=serial)
    while bench.action()[0] is not ActionState.ENDED:
        record(bench, 1, told)
        assert len(told) < 2000
    assert bench.action()[1] is Outcome.DONE
    velocity, acceleration, jerk = rates(told[2:-2])  # at its ends another controller's command takes over
    assert (velocity <= of.velocity_limit).all()
    assert (acceleration <= of.acceleration_limit).all()
    assert (jerk <= of.jerk_limit).all()
    reached = talos_kinematics.frame(told[-2], "tool_right_tip").translation
    assert reached == pytest.approx(there, abs=2e-3)


@pytest.mark.parametrize("looks_ahead", [True, False])
def test_a_line_that_uses_up_the_joints_limits_slows_down_within_them_since_its_clock_looks_at_what_it_leaves(
    enabled: Any, talos_kinematics: Any, looks_ahead: bool
) -> None:
    bench, of = enabled, enabled.description
    tip = talos_kinematics.frame(bench.loop.written.position, "tool_right_tip")
    there = tip.translation + np.array([0.1, -0.08, 0.1])
    goal = Pose(position=tuple(there.tolist()), orientation=tuple(pin.Quaternion(tip.rotation).coeffs().tolist()))
    right = list(of.arms["right"].joints)
    line = CartesianImpedance(frame="tool_right_tip", joints=right, goal_in_world=goal, duration=0.4)
    serial = bench.post_start(line)
    told: list[np.ndarray] = []
    record(bench, 60, [])
    if not looks_ahead:
        bench.loop.actions.running()[0].controller.clock.room = None
    bench.post(Kind.PAUSE, action=serial)
    record(bench, 200, told)
    assert bench.action()[0] is not ActionState.ENDED
    _, acceleration, jerk = rates(told)
    within = (acceleration <= of.acceleration_limit).all() and (jerk <= 1.02 * of.jerk_limit).all()
    assert within == looks_ahead


def test_no_change_of_speed_makes_the_torque_jump_more_than_the_motion_does(enabled: Any) -> None:
    bench, told = enabled, []
    bench.post_start(reach(bench))
    seen = len(bench.drives.jumps)
    run_to_end(bench, told)
    usual = np.abs(bench.drives.jumps[seen:]).max(axis=0)
    rows = [bench.index(f"arm_right_{number}_joint") for number in range(1, 8)]
    bench.run(300)
    back = reach(bench)
    back.positions = np.array(back.positions)[::-1].tolist()
    back.velocities = (-np.array(back.velocities)[::-1]).tolist()
    shift = np.array(back.positions[0]) - bench.loop.written.position[rows]
    back.positions = (np.array(back.positions) - shift).tolist()
    bench.post_start(back)
    seen = len(bench.drives.jumps)
    for share in (0.1, 1.0, 0.5, 0.1, 1.0):
        record(bench, 70, told)
        bench.post(Kind.SET_SPEED, value=share)
    assert run_to_end(bench, told) is Outcome.DONE
    assert (np.abs(bench.drives.jumps[seen:]).max(axis=0)[rows] <= 1.1 * usual[rows] + 0.05).all()


def test_a_speed_holds_for_what_starts_later_and_an_actions_own_comes_on_top(enabled: Any) -> None:
    bench = enabled
    assert bench.ask(Kind.SET_SPEED, value=0.5) is Answer.ACCEPTED
    assert bench.snapshot()["speed"] == 0.5
    serial = bench.post_start(bench.move("arm_right_1_joint", 0.2, 0.4))
    bench.post_start(bench.move("arm_left_1_joint", 0.2, 0.4))
    bench.run(101)
    assert bench.snapshot()["actions"]["progress"][:2] == pytest.approx([0.101, 0.1], abs=1e-9)
    assert bench.ask(Kind.SET_SPEED, action=serial, value=0.4) is Answer.ACCEPTED
    assert bench.snapshot()["actions"]["speed"][:2] == pytest.approx([0.2, 0.5])
    assert bench.snapshot()["speed"] == 0.5
    bench.ask(Kind.SET_SPEED, value=1.0)
    assert bench.snapshot()["actions"]["speed"][:2] == pytest.approx([0.4, 1.0])


@pytest.mark.parametrize("share", [0.0, 0.09, 1.01, -1.0, float("nan"), float("inf")])
def test_a_speed_that_is_none_changes_nothing(enabled: Any, share: float) -> None:
    assert enabled.ask(Kind.SET_SPEED, value=share) is Answer.MALFORMED
    assert enabled.snapshot()["speed"] == 1.0
    assert enabled.ask(Kind.SET_SPEED, action=4711, value=0.5) is Answer.NO_SUCH_ACTION


def test_an_actions_own_time_runs_as_fast_as_its_path(enabled: Any) -> None:
    bench = enabled
    bench.ask(Kind.SET_SPEED, value=0.5)
    bench.start(bench.move("arm_right_1_joint", 0.3, 3.0), (TimeEnd(after=0.2),))
    bench.run(198)
    assert bench.action()[0] is ActionState.RUNNING
    bench.run(4)
    assert bench.action() == (ActionState.ENDED, Outcome.CONDITION)


def test_the_steps_of_a_behaviour_and_their_compliance_run_at_its_speed(enabled: Any) -> None:
    bench = enabled
    right = list(bench.description.arms["right"].joints)
    swing = Dither(axis="x", amplitude=0.002, frequency=2.0)
    still = CompliantMotion(frame="tool_right_tip", joints=right, duration=0.1, dither=[swing])
    bench.ask(Kind.SET_SPEED, value=0.25)
    bench.post_behaviour(Step(name="a", motion=still), Step(name="b", motion=still))
    bench.run(197)
    assert bench.snapshot()["actions"][0]["step"] == 0
    bench.run(10)
    assert bench.snapshot()["actions"][0]["step"] == 1
    bench.run(197)
    assert bench.action() == (ActionState.ENDED, Outcome.DONE)


def test_a_stream_is_as_fast_as_who_streams_it(enabled: Any) -> None:
    bench = enabled
    bench.ask(Kind.SET_SPEED, value=0.1)
    bench.start(JointStream(joints=["arm_right_4_joint"]))
    assert bench.snapshot()["actions"][0]["speed"] == 1.0


CHANGES = st.lists(
    st.tuples(st.integers(0, 700), st.sampled_from(["hold", "go"]) | st.floats(0.1, 1.0)), min_size=1, max_size=8
)
LIMITS = np.array([[4.6, 7.6], [80.0, 130.0]])


@settings(max_examples=60, deadline=None, derandomize=True)
@given(changes=CHANGES, duration=st.floats(0.9, 2.0))
def test_whatever_is_asked_of_a_path_whenever_it_is_run_to_its_end_within_the_limits(
    changes: list[tuple[int, str | float]], duration: float
) -> None:
    path = HermitePath(*knots(np.array([0.5, -0.8]), duration))
    clock = PathClock(path.length, PERIOD)
    clock.room = lambda: path.room(LIMITS)
    position, velocity = np.zeros(2), np.zeros(2)
    told, before = [np.zeros(2)] * 4, 0.0
    asked: dict[int, Callable[[], None]] = {700: clock.go, 701: lambda: clock.run_at(1.0)}
    for cycle, what in changes:
        do = {"hold": clock.hold, "go": clock.go}.get(what, lambda what=what: clock.run_at(what))  # type: ignore
        asked.setdefault(cycle, do)
    for cycle in range(4000):
        asked.get(cycle, lambda: None)()
        clock.advance()
        assert clock.s >= before, "never back"
        before = clock.s
        path.evaluate(clock.s, position, velocity)
        told.append(position.copy())
        if clock.at_end:
            break
    assert told[-1] == pytest.approx([0.5, -0.8], abs=1e-9)
    _, acceleration, jerk = rates([*told, *[told[-1]] * 4])
    assert (acceleration <= LIMITS[0] * 1.001).all()
    assert (jerk <= LIMITS[1] * 1.02).all()


def test_who_was_pushed_off_in_a_pause_lets_go_returns_to_the_path_and_goes_on_without_a_jump(enabled: Any) -> None:
    bench, of, joint = enabled, enabled.description, enabled.index("arm_right_4_joint")
    motion, told = reach(bench), []
    serial = bench.post_start(motion)
    bench.run(200)
    bench.ask(Kind.PAUSE, action=serial)
    bench.run(400)
    stood = bench.loop.written.position.copy()

    def held(cycles: int) -> None:
        """Somebody holds the forearm 0.1 rad away from where it stood."""
        for _ in range(cycles):
            off, speed = stood[joint] + 0.1 - bench.drives.state.position[joint], bench.drives.state.velocity[joint]
            bench.drives.external_torque[joint] = 500.0 * off - 10.0 * speed
            record(bench, 1, told)

    held(300)
    felt = bench.drives.external_torque[joint]
    assert felt > 10.0 and (bench.loop.written.position == stood).all()
    bench.post(Kind.RESUME, action=serial)
    held(70)
    assert bench.drives.external_torque[joint] < 0.3 * felt, "its spring lets go of who holds it"
    bench.post(Kind.PAUSE, action=serial)
    held(300)
    assert bench.action()[0] is ActionState.PAUSED, "the way back pauses, too"
    assert bench.loop.written.position[joint] - stood[joint] > 0.01
    bench.post(Kind.RESUME, action=serial)
    bench.drives.external_torque[joint] = 0.0
    assert run_to_end(bench, told) is Outcome.DONE
    _, acceleration, jerk = rates(told)
    assert (acceleration <= of.acceleration_limit * 1.01).all()
    assert (jerk <= of.jerk_limit * 1.05).all()
    rows = [bench.index(name) for name in motion.joints]
    assert bench.loop.written.position[rows] == pytest.approx(motion.positions[-1], abs=1e-6)


def test_what_it_leans_on_when_it_comes_to_a_stand_it_goes_on_leaning_on(enabled: Any) -> None:
    bench, joint = enabled, enabled.index("arm_right_4_joint")
    bench.drives.external_torque[joint] = 20.0
    serial = bench.post_start(reach(bench))
    bench.run(250)
    bench.ask(Kind.PAUSE, action=serial)
    bench.run(400)
    stood = bench.loop.written.position[joint]
    assert abs(bench.snapshot()["position"][joint] - stood) > 0.05
    bench.ask(Kind.RESUME, action=serial)
    assert abs(bench.loop.written.position[joint] - stood) < 1e-3
