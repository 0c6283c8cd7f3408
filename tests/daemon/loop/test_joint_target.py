"""Joints sent to a target that may be replaced on the way."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon import exchange
from daemon.controllers.point_to_point import NoWay, PointToPoint
from daemon.controllers.references import PathClock
from daemon.exchange import ActionState, Answer, Kind, Outcome
from daemon.serving.validation import check_start
from handrail.messages import JointTarget, StartAction, Step, StreamJoints
from handrail.topics import RefusedError

JOINTS = ["arm_right_1_joint", "arm_right_4_joint"]
PERIOD = 0.002


@pytest.fixture
def enabled(bench: Any) -> Any:
    bench.enable()
    return bench


def where(bench: Any) -> np.ndarray:
    return bench.loop.written.position[[bench.index(joint) for joint in JOINTS]].copy()


def send(bench: Any, action: int, sequence: int, positions: np.ndarray) -> None:
    message = StreamJoints(id="a", sequence=sequence, positions=positions.tolist())
    bench._serial += 1
    bench._mailbox.post(*exchange.encode_joints(message, bench._serial, action))


def rates(positions: list[np.ndarray]) -> list[np.ndarray]:
    return [np.abs(np.diff(positions, order, axis=0)).max(axis=0) / PERIOD**order for order in (1, 2, 3)]


def test_joints_go_to_their_target_in_a_straight_line_and_end_there(enabled: Any) -> None:
    bench, start, told = enabled, where(enabled), [where(enabled)] * 3
    shift = np.array([0.3, -0.2])
    assert bench.start(JointTarget(joints=JOINTS, positions=(start + shift).tolist(), speed=0.5)) is Answer.ACCEPTED
    while bench.action()[0] is ActionState.RUNNING:
        told.append(where(bench))
        bench.run()
        assert len(told) < 1500
    assert bench.action()[1] is Outcome.DONE
    assert where(bench) == pytest.approx(start + shift, abs=1e-6)
    gone = np.array(told) - start
    assert np.abs(gone[:, 0] * shift[1] - gone[:, 1] * shift[0]).max() < 1e-9
    of, rows = bench.description, [bench.index(joint) for joint in JOINTS]
    velocity, acceleration, jerk = rates(told)
    assert (velocity <= 0.5 * of.velocity_limit[rows] * 1.001).all()
    assert (acceleration <= of.acceleration_limit[rows]).all()
    assert (jerk <= of.jerk_limit[rows]).all()


def test_a_target_replaced_on_the_way_at_any_speed_and_in_a_pause_is_gone_to_without_a_jump(enabled: Any) -> None:
    bench, start, told = enabled, where(enabled), [where(enabled)] * 3
    bench.ask(Kind.SET_SPEED, value=0.6)
    serial = bench.post_start(JointTarget(joints=JOINTS, positions=(start + np.array([0.4, 0.3])).tolist(), speed=0.8))

    def run(cycles: int) -> None:
        bench.run(cycles, lambda: told.append(where(bench)))

    run(150)
    send(bench, serial, 1, start + np.array([-0.2, 0.3]))
    run(60)
    bench.post(Kind.SET_SPEED, value=1.0)
    run(20)
    send(bench, serial, 3, start + np.array([0.1, -0.1]))
    send(bench, serial, 2, start + np.array([9.0, 9.0]))
    run(40)
    bench.post(Kind.PAUSE, action=serial)
    run(300)
    assert bench.action()[0] is ActionState.PAUSED
    send(bench, serial, 4, start + np.array([0.2, 0.2]))
    run(20)
    assert (told[-1] == told[-20]).all(), "a new target does not end a pause"
    bench.post(Kind.RESUME, action=serial)
    while bench.action()[0] is not ActionState.ENDED:
        run(10)
        assert len(told) < 3000
    assert bench.action()[1] is Outcome.DONE
    assert where(bench) == pytest.approx(start + np.array([0.2, 0.2]), abs=1e-6)
    of, rows = bench.description, [bench.index(joint) for joint in JOINTS]
    velocity, acceleration, jerk = rates(told)
    assert (velocity <= 0.8 * of.velocity_limit[rows] * 1.001).all()
    assert (acceleration <= of.acceleration_limit[rows]).all()
    assert (jerk <= of.jerk_limit[rows]).all()


def test_a_behaviours_step_may_go_to_a_target(enabled: Any) -> None:
    start = where(enabled)
    there = JointTarget(joints=JOINTS, positions=(start + 0.1).tolist())
    back = JointTarget(joints=JOINTS, positions=start.tolist())
    enabled.post_behaviour(Step(name="there", motion=there), Step(name="back", motion=back))
    for _ in range(150):
        enabled.run(10)
        if enabled.action()[0] is ActionState.ENDED:
            break
    assert enabled.action() == (ActionState.ENDED, Outcome.DONE)
    assert where(enabled) == pytest.approx(start, abs=1e-6)


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"positions": [0.0]}, "motion.positions"),
        ({"positions": [0.0, 9.0]}, r"motion.positions\[1\]"),
        ({"positions": [float("nan"), 0.0]}, r"motion.positions\[0\]"),
        ({"joints": ["arm_right_1_joint", "tail"]}, r"motion.joints\[1\]"),
    ],
)
def test_a_target_that_is_none_is_refused(enabled: Any, changes: dict[str, Any], field: str) -> None:
    motion = JointTarget(**{"joints": JOINTS, "positions": where(enabled).tolist(), **changes})
    frames = exchange.frame_names(enabled.description)
    with pytest.raises(RefusedError, match=field):
        check_start(
            StartAction(id="a", owner="o", motion=motion), enabled.description, frames, enabled.snapshot(), 9999
        )


def test_what_is_no_number_leaves_the_way_as_it_was() -> None:
    way = PointToPoint(np.array([[1.0], [6.0], [100.0]]), PERIOD)
    way.begin(np.zeros(1), np.zeros(1), np.ones(1))
    length = way.length
    with pytest.raises(NoWay):
        way.turn_to(0.1, np.array([np.nan]))
    assert way.length == length


@settings(max_examples=30, deadline=None, derandomize=True)
@given(
    changes=st.lists(
        st.tuples(
            st.integers(0, 600),
            st.sampled_from(["hold", "go"])
            | st.floats(0.1, 1.0)
            | st.tuples(st.floats(-0.6, 0.6), st.floats(-0.6, 0.6)),
        ),
        max_size=8,
    )
)
def test_targets_speeds_and_pauses_at_any_time_keep_acceleration_and_jerk(changes: list[Any]) -> None:
    limits = np.array([[1.0, 1.5], [6.0, 9.0], [100.0, 150.0]])
    way, clock = PointToPoint(limits, PERIOD), PathClock(np.inf, PERIOD)
    way.begin(np.zeros(2), np.zeros(2), np.array([0.5, -0.4]))
    clock.begin_anew(way.length)
    clock.room = way.room
    position, velocity, told, end = np.zeros(2), np.zeros(2), [np.zeros(2)] * 4, np.array([0.5, -0.4])
    asked = dict(changes)
    for cycle in range(3000):
        what = {601: "go", 602: 1.0}.get(cycle, asked.get(cycle))
        if what == "hold":
            clock.hold()
        elif what == "go":
            clock.go()
        elif isinstance(what, tuple) and not clock.at_end:
            end = np.array(what)
            way.turn_to(clock.s, end)
            clock.begin_anew(way.length)
        elif isinstance(what, float):
            clock.run_at(what)
        clock.advance()
        way.evaluate(clock.s, position, velocity)
        told.append(position.copy())
        if clock.at_end and cycle > 602:
            break
    assert told[-1] == pytest.approx(end, abs=1e-6)
    most, acceleration, jerk = rates([*told, *[told[-1]] * 4])
    assert (most <= limits[0] * 1.001).all()
    assert (acceleration <= limits[1] * 1.001).all()
    assert (jerk <= limits[2] * 1.02).all()
