"""Joint references that a client streams: what comes is followed, what is lost or late is bridged, and silence is a hold."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from daemon import exchange
from daemon.exchange import ActionState, Answer, Kind, Outcome, Rule, action_event
from daemon.serving.validation import check_joints, check_start
from handrail.messages import JointStream, StartAction, StreamJoints
from handrail.topics import RefusedError
from tests.daemon.loop.conftest import Bench

JOINTS = ["arm_right_1_joint", "arm_right_4_joint"]
EVERY = 5
"""cycles between two samples: a hundred a second"""


class Stream:
    """A client that streams a swing of two joints, and the loop's side of the mailbox."""

    def __init__(self, bench: Bench, **fields: float):
        self.bench, self.period = bench, bench.loop.period_ns * 1e-9
        self.rows = np.array([bench.index(joint) for joint in JOINTS])
        self.start = bench.loop.written.position[self.rows].copy()
        assert bench.start(JointStream(joints=JOINTS, **fields)) is Answer.ACCEPTED
        self.action, self.sequence, self.cycle = int(bench.snapshot()["actions"][0]["serial"]), 0, 0

    def at(self, cycle: int) -> tuple[np.ndarray, np.ndarray]:
        """Where the joints are to be, rad and rad/s."""
        phase = 2.0 * cycle * self.period
        return self.start + 0.1 * (1.0 - np.cos(phase)), np.full(2, 0.2 * np.sin(phase))

    def send(self, cycle: int, sequence: int = 0, **fields: object) -> None:
        self.sequence = sequence or self.sequence + 1
        position, velocity = self.at(cycle)
        sample = {"positions": position.tolist(), "velocities": velocity.tolist(), **fields}
        message = StreamJoints(id="a", sequence=self.sequence, **sample)  # type: ignore[arg-type]
        self.bench._serial += 1
        self.bench._mailbox.post(*exchange.encode_joints(message, self.bench._serial, self.action))

    def run(self, cycles: int, sends: Callable[[int], bool] = lambda number: True) -> np.ndarray:
        """Cycles with a sample every so often, where `sends` says so of its number; rad (cycles, 2) off the reference."""
        off = []
        for _ in range(cycles):
            if self.cycle % EVERY == 0 and sends(self.cycle // EVERY):
                self.send(self.cycle)
            self.bench.run()
            off.append(self.commanded - self.at(self.cycle)[0])
            self.cycle += 1
        return np.array(off)

    @property
    def commanded(self) -> np.ndarray:
        return self.bench.loop.written.position[self.rows].copy()

    @property
    def velocity(self) -> np.ndarray:
        return self.bench.loop.written.velocity[self.rows].copy()

    def answer(self) -> Answer:
        return Answer(int(self.bench.run()["answer"]))


@pytest.fixture
def stream(bench: Bench) -> Stream:
    bench.enable()
    return Stream(bench)


def test_what_is_streamed_is_followed_without_lag_through_the_limits(stream: Stream) -> None:
    off = np.abs(stream.run(300))
    assert off.max() < 2e-3
    assert off[150:].max() < 1e-3, "a few cycles' way at most"
    assert stream.bench.snapshot()["limited"] == 0
    assert stream.bench.ask(Kind.CANCEL, action=stream.action) is Answer.ACCEPTED
    for _ in range(400):
        if stream.bench.action()[0] is ActionState.ENDED:
            break
        stream.bench.run()
    assert stream.bench.action() == (ActionState.ENDED, Outcome.CANCELLED)
    assert stream.velocity == pytest.approx(0.0, abs=1e-3)


def test_lost_samples_are_bridged_at_the_velocity_that_was_sent(stream: Stream) -> None:
    off = np.abs(stream.run(300, sends=lambda number: number % 4 == 0))
    assert off.max() < 4e-3
    assert stream.bench.action()[0] is ActionState.RUNNING


def test_late_and_repeated_samples_do_nothing(stream: Stream) -> None:
    stream.run(100)
    newest, before = stream.sequence, stream.commanded
    for sequence in (newest, newest - 3):
        stream.send(0, sequence)
        assert stream.answer() is Answer.ACCEPTED
    step = stream.commanded - before
    assert (step > 0).all(), "it goes on as the newest one said"
    assert step == pytest.approx(2 * stream.period * stream.velocity, rel=0.2)
    stream.send(stream.cycle, newest + 5)
    assert stream.answer() is Answer.ACCEPTED, "some were lost in between"


def test_samples_that_come_in_another_order_are_followed_by_their_numbers(stream: Stream) -> None:
    stream.run(100)
    first = stream.sequence + 1
    for sequence, cycle in ((first + 1, stream.cycle), (first, stream.cycle - EVERY)):
        stream.send(cycle, sequence)
        stream.bench.run()
    stream.cycle, stream.sequence = stream.cycle + 2, first + 1
    assert np.abs(stream.run(50)).max() < 2e-3


def test_where_nothing_comes_the_joints_come_to_a_stand_are_held_and_go_on_with_the_next_sample(stream: Stream) -> None:
    stream.run(200)
    moving = stream.commanded
    stream.run(90, sends=lambda number: False)
    assert stream.bench.action()[0] is ActionState.PAUSED
    slot = stream.bench.snapshot()["actions"][0]
    event = action_event(slot, "a", [], stream.bench.description.joints)
    assert (event.state, event.cycle) == ("paused", int(slot["cycle"]))
    assert "nothing has been streamed for 0.1" in event.detail
    held = stream.commanded
    assert stream.velocity == pytest.approx(0.0, abs=5e-3)
    assert (np.abs(held - moving) < 0.2 * (0.05 + 0.1)).all(), (
        "it went no further than what was bridged, and its stopping"
    )
    stream.run(100, sends=lambda number: False)
    assert stream.commanded == pytest.approx(held, abs=5e-4)
    velocities = []
    for _ in range(100):
        stream.run(1)
        velocities.append(stream.velocity)
    assert stream.bench.action()[0] is ActionState.RUNNING
    assert action_event(stream.bench.snapshot()["actions"][0], "a", [], stream.bench.description.joints).detail == ""
    assert np.abs(velocities).max() < 0.5 + 0.2 + 1e-9, "what it is behind is worked off no faster than it may be"
    assert np.abs(stream.run(200)[100:]).max() < 2e-3


def test_a_stream_that_ends_ends_its_action_with_the_reason(bench: Bench) -> None:
    bench.enable()
    stream = Stream(bench, expiry=0.3)
    stream.run(100)
    stream.run(160, sends=lambda number: False)
    assert bench.action() == (ActionState.ENDED, Outcome.STREAM_LOST)
    event = action_event(bench.snapshot()["actions"][0], "a", [], bench.description.joints)
    assert (event.outcome, event.detail) == ("stream_lost", "nothing had been streamed for 0.30 s")
    before = stream.commanded
    stream.send(stream.cycle)
    assert stream.answer() is Answer.NO_SUCH_ACTION
    assert (stream.commanded == before).all()


def test_a_sample_far_off_is_gone_to_not_jumped_to(stream: Stream) -> None:
    stream.send(0, positions=(stream.start + 0.3).tolist(), velocities=[0.0, 0.0])
    before = stream.commanded
    stream.bench.run(10)
    assert stream.commanded - before == pytest.approx(10 * stream.period * 0.5, rel=1e-6)


def test_a_paused_stream_stands_though_samples_come_and_is_not_lost(bench: Bench) -> None:
    bench.enable()
    stream = Stream(bench, expiry=0.3)
    stream.run(100)
    assert stream.bench.ask(Kind.PAUSE, action=stream.action) is Answer.ACCEPTED
    stream.run(300)
    assert stream.bench.action()[0] is ActionState.PAUSED
    stood = stream.commanded
    stream.run(200, sends=lambda number: False)
    assert (stream.commanded == stood).all()
    assert stream.bench.action()[0] is ActionState.PAUSED
    assert stream.bench.ask(Kind.RESUME, action=stream.action) is Answer.ACCEPTED
    assert np.abs(stream.run(500)[450:]).max() < 2e-3


def test_an_expired_sample_is_dropped_and_told(stream: Stream) -> None:
    stream.send(stream.cycle, expires_ns=int(stream.bench.snapshot()["time_ns"]) - 30_000_000)
    assert stream.answer() is Answer.EXPIRED
    assert stream.bench.snapshot()["safety"]["times"][Rule.EXPIRED] == 1
    stream.send(stream.cycle, expires_ns=int(stream.bench.snapshot()["time_ns"]) + 30_000_000)
    assert stream.answer() is Answer.ACCEPTED


@pytest.mark.parametrize("numbers", [[np.nan, 0.0], [np.inf, 0.0], [0.1], [0.1, 0.2, 0.3]])
def test_what_is_no_number_or_no_number_a_joint_moves_nothing(stream: Stream, numbers: list[float]) -> None:
    before = stream.commanded
    stream.send(0, positions=numbers, velocities=[0.0] * len(numbers))
    assert stream.answer() in (Answer.MALFORMED, Answer.NO_SUCH_REFERENCE)
    stream.bench.run(20)
    assert stream.commanded == pytest.approx(before, abs=1e-12)


@pytest.mark.parametrize(
    ("fields", "field", "expected"),
    [
        ({"positions": [0.0]}, "positions", "2: arm_right_1_joint"),
        ({"positions": [0.0, np.nan]}, "positions[1]", "a finite number"),
        ({"positions": [0.0, 9.0]}, "positions[1]", "rad"),
        ({"positions": [0.0, -1.0], "velocities": [99.0, 0.0]}, "velocities[0]", "rad/s"),
        ({"positions": [0.0, -1.0], "velocities": [0.0]}, "velocities", "2: "),
    ],
)
def test_the_server_refuses_a_sample_with_field_value_and_expectation(
    bench: Bench, fields: dict[str, list[float]], field: str, expected: str
) -> None:
    with pytest.raises(RefusedError) as refused:
        check_joints(StreamJoints(id="a", sequence=1, **fields), JOINTS, bench.description)
    assert refused.value.refusal.field == field
    assert expected in refused.value.refusal.expected


def test_a_stream_of_unknown_joints_is_refused(bench: Bench) -> None:
    bench.enable()
    call = StartAction(id="a", owner="o", motion=JointStream(joints=["knee"]))
    with pytest.raises(RefusedError) as refused:
        check_start(call, bench.description, (), bench.snapshot(), 1000)
    assert refused.value.refusal.field == "motion.joints[0]"
