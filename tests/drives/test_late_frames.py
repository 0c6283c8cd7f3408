"""Frames that come late, and streams that begin anew: what 8 bits of sequence number can tell, and what they cannot."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hal.can import frames
from hal.device import DeviceState
from hal.drives.lifecycle import CONTROLWORD, Command, State, controlword_towards
from hal.drives.order import FIRST, LATE, NEXT, order_at_drive
from hal.drives.protocol import WATCHDOG_CYCLES, DriveTargets, LimbProtocol
from hal.joint import JointCommand, JointState, Mode
from hal.plant.bus_node import BusNode
from hal.plant.world import World
from handrail.robot import library as robots
from tests.drives.conftest import network

_N = 2
_PROTOCOL = LimbProtocol(network({"arm": ("limb_fd", _N)}, {"chest": "imu"}))
_ENABLE, _OFF = (np.full(_N, CONTROLWORD[c], np.uint8) for c in (Command.ENABLE_OPERATION, Command.DISABLE_VOLTAGE))


class Stream:
    """A host that sends every cycle, drives that hear it, and all that was sent."""

    def __init__(self, start: int, watchdog: int = WATCHDOG_CYCLES):
        self.targets, self.sent = DriveTargets(_N, 1), deque[np.ndarray](maxlen=1001)
        self.sequence, self.cycle, self._watchdog = start, 0, watchdog
        self._out, self._command = frames.empty(_PROTOCOL.frames_a_cycle), JointCommand(_N)

    def write(self, words: np.ndarray | None = None) -> None:
        """A cycle's frame: controlwords, or set-points whose position says the cycle."""
        self.sequence, self.cycle = self.sequence + 1, self.cycle + 1
        self._command.position[:] = self.cycle * 1e-3
        if words is None:
            count = _PROTOCOL.encode_commands(self._command, self.sequence, self._watchdog, self._out)
        else:
            count = _PROTOCOL.encode_control(words, self.sequence, self._out)
        self.sent.append(self._out[:count].copy())

    def hear(self, record: np.ndarray) -> bool:
        """Whether the drives believe a frame that comes now."""
        good, refused = _PROTOCOL.decode(record, len(record), self.targets, self.cycle)
        assert refused == 0
        return good == 1

    def run(self, cycles: int, words: np.ndarray | None = None) -> bool:
        """Go on; whether the drives believed all of it."""
        believed = True
        for _ in range(cycles):
            self.write(words)
            believed &= self.hear(self.sent[-1])
        return believed


def _can_pass(delay: int, watchdog: int) -> bool:
    """A frame so late looks as if it were one of the next that may come."""
    return 0 < -delay % 256 <= min(watchdog, 127)


@settings(max_examples=150, deadline=None)
@given(
    delay=st.integers(1, 1000),
    start=st.integers(0, 255),
    watchdog=st.integers(1, 255),
    control=st.booleans(),
)
@example(delay=129, start=0, watchdog=20, control=False)
@example(delay=235, start=0, watchdog=20, control=True)
@example(delay=236, start=0, watchdog=20, control=True)
@example(delay=255, start=7, watchdog=20, control=False)
@example(delay=256, start=0, watchdog=255, control=False)
def test_a_late_frame_is_refused_in_a_stream_that_lives_but_for_those_that_are_late_by_nearly_256_cycles(
    delay: int, start: int, watchdog: int, control: bool
) -> None:
    stream = Stream(start, watchdog)
    assert stream.run(1, _ENABLE if control else None)
    assert stream.run(delay)
    late = stream.sent[-1 - delay]
    position = stream.targets.command.position.copy()
    assert stream.hear(late) == _can_pass(delay, watchdog)
    if not _can_pass(delay, watchdog):
        assert np.array_equal(stream.targets.command.position, position)
        assert not stream.targets.controlled.any() and not stream.targets.commanded.any()
        assert stream.run(3), "the stream itself goes on"


@pytest.mark.parametrize("delay", [237, 240, 255, 512 - 7])
def test_after_a_late_frame_that_passed_the_stream_is_followed_again_before_the_watchdog_fires(delay: int) -> None:
    stream = Stream(3)
    assert stream.run(delay + 1)
    assert stream.hear(stream.sent[-1 - delay])
    ignored = 0
    while not stream.run(1):
        ignored += 1
    assert ignored == -delay % 256 < WATCHDOG_CYCLES


@settings(max_examples=60, deadline=None)
@given(lost=st.lists(st.integers(0, WATCHDOG_CYCLES - 1), min_size=1, max_size=12), start=st.integers(0, 255))
def test_no_gap_that_the_watchdog_bridges_ends_a_stream(lost: list[int], start: int) -> None:
    stream = Stream(start)
    stream.run(1)
    for gap in lost:
        for _ in range(gap):
            stream.write()
        assert stream.run(1)


@settings(max_examples=60, deadline=None)
@given(late=st.integers(1, WATCHDOG_CYCLES - 1), start=st.integers(0, 255))
def test_a_line_that_is_late_for_a_while_ends_no_stream(late: int, start: int) -> None:
    stream = Stream(start)
    stream.run(1)
    for _ in range(late):
        stream.write()
    for _ in range(40):
        stream.write()
        assert stream.hear(stream.sent[-1 - late])
    assert stream.run(1), "on time again: what is still under way is overtaken"
    for k in range(late):
        assert not stream.hear(stream.sent[-1 - late + k])
    assert stream.run(10)


@pytest.mark.parametrize("silence", [WATCHDOG_CYCLES + 2, 100, 700])
@pytest.mark.parametrize("jump", [0, 1, 21, 128, 255])
def test_after_a_silence_a_host_may_count_from_anywhere_but_its_first_frame_switches_nothing_on(
    silence: int, jump: int
) -> None:
    stream = Stream(77)
    assert stream.run(30, _OFF)
    stream.cycle += silence - 1
    stream.sequence += jump - 1
    assert stream.run(1, _ENABLE)
    assert stream.targets.answer.all() and not stream.targets.controlled.any()
    assert stream.run(1, _ENABLE) and stream.targets.controlled.all()


def test_a_first_frame_switches_off_at_once() -> None:
    for command in (Command.DISABLE_VOLTAGE, Command.QUICK_STOP, Command.SHUTDOWN):
        stream = Stream(9)
        assert stream.run(1, np.full(_N, CONTROLWORD[command], np.uint8)) and stream.targets.controlled.all()


def test_another_host_is_not_heard_before_the_first_has_been_silent() -> None:
    stream, other = Stream(0), Stream(100)
    stream.run(30)
    heard = [False]
    while not heard[-1]:
        stream.cycle += 1
        other.write(_OFF)
        heard.append(stream.hear(other.sent[-1]))
    assert len(heard) - 1 == WATCHDOG_CYCLES + 2, "cycles: its watchdog's, one that it may be behind, and the one now"
    assert stream.targets.controlled.all()


def test_the_order_of_frames_is_that_of_the_docs() -> None:
    passing = [d for d in range(1, 257) if order_at_drive(-d & 0xFF, 0, True, 1, WATCHDOG_CYCLES) == NEXT]
    assert passing == list(range(236, 256))
    assert order_at_drive(1, 1, True, 21, 20) == LATE and order_at_drive(1, 1, True, 22, 20) == FIRST


@settings(max_examples=60, deadline=None)
@given(delay=st.integers(1, 1000), start=st.integers(0, 255))
def test_a_devices_late_frame_is_refused_but_for_those_that_are_late_by_nearly_256(delay: int, start: int) -> None:
    out, got, state = frames.empty(_PROTOCOL.frames_a_cycle), JointState(_N), DeviceState(1)
    sequences, due, sent = np.full(1, start, np.uint8), np.ones(1, np.bool_), deque[np.ndarray](maxlen=1001)
    for _ in range(delay + 1):
        count = _PROTOCOL.encode_device_status(DeviceState(1), due, sequences, out)
        sent.append(out[:count].copy())
    assert _PROTOCOL.decode_status(sent[-1], 1, got, state)[0] == 1
    state.age += 1
    passes = 0 < -delay % 256 <= 50
    assert _PROTOCOL.decode_status(sent[-1 - delay], 1, got, state) == (passes, 0)
    state.age += 60  # so long silent that order can't be told: only a repetition is refused
    again = passes or delay % 256 == 0
    assert _PROTOCOL.decode_status(sent[-1 - delay], 1, got, state) == (not again, 0)


@pytest.fixture(scope="module")
def node() -> Iterator[tuple[BusNode, World]]:
    world = World(robots.load("talos_upper"))
    yield BusNode(world), world
    world.close()


def test_late_enabling_does_not_switch_drives_on_again_that_were_switched_off(node: tuple[BusNode, World]) -> None:
    bus, world = node
    protocol = LimbProtocol(world.description)
    n, out = len(world.drives), frames.empty(protocol.frames_a_cycle)
    words, command, sent = np.zeros(n, np.uint8), JointCommand(n), []
    command.position[:], command.mode[:] = world.position, Mode.DAMPING

    def cycle(goal: State | None, late: np.ndarray | None = None) -> None:
        if goal is None:
            count = protocol.encode_commands(command, len(sent), 20, out)
        else:
            words[:] = controlword_towards(goal, world.drives.state, words)
            count = protocol.encode_control(words, len(sent), out)
        sent.append(out[:count].copy())
        bus.receive(sent[-1])
        if late is not None:
            bus.receive(late)
        world.advance(2)
        bus.answer()

    for goal in (State.SWITCH_ON_DISABLED, *[State.OPERATION_ENABLED] * 3, None, None):
        cycle(goal)
    assert (world.drives.state == State.OPERATION_ENABLED).all()
    enabling = sent[1:4]
    for _ in range(3):
        cycle(State.SWITCH_ON_DISABLED)
    for late in enabling:  # while the host says: off
        cycle(State.SWITCH_ON_DISABLED, late)
    for _ in range(10):
        cycle(State.SWITCHED_ON)  # one word from being enabled
    cycle(State.SWITCHED_ON, enabling[2])
    assert (world.drives.state == State.SWITCHED_ON).all()
    world.advance(2 * (WATCHDOG_CYCLES + 5))  # the host has gone
    bus.receive(enabling[2])
    assert (world.drives.state == State.SWITCHED_ON).all()
    world.advance(2 * (WATCHDOG_CYCLES + 5))
    # A host that comes back counts from anywhere, and needs one cycle more.
    for ready in (State.SWITCHED_ON, State.OPERATION_ENABLED):
        sent.append(out[:0].copy())
        cycle(State.OPERATION_ENABLED)
        assert (world.drives.state == ready).all()
