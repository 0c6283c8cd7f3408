"""Faults that a script lays on the bus, each as an engineer would see it."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hal.can import faults, frames
from hal.can.faults import Fault
from tests.can.conftest import Bench

Make = Callable[..., np.ndarray]
Benches = Callable[..., Bench]


def _ids(records: np.ndarray) -> list[int]:
    return [int(can_id) for can_id in records["can_id"]]


@pytest.fixture
def on(bench: Benches) -> Bench:
    return bench()


def test_a_dropped_frame_reaches_nobody_and_its_sender_is_content(on: Bench, make_frames: Make) -> None:
    sender, listener = on.join("sender"), on.join("listener")
    number = on.hub.add_fault(Fault(kind="drop", can_id=0x101))
    sender.send(make_frames([0x100, 0x101, 0x102]))
    assert _ids(on.turn()) == [0x100, 0x102] == _ids(listener.receive(1.0))
    assert on.node("sender").transmit_errors == 0 and on.hub.report().hits[number] == 1


def test_a_fault_hits_only_the_node_the_channel_and_the_identifiers_that_it_names(on: Bench, make_frames: Make) -> None:
    on.hub.own_nodes(["arm_right_1", "arm_left_1"], ["can0", "can1"])
    arms = np.concatenate([make_frames([0x200], bus=0), make_frames([0x210], bus=1)])
    listener = on.join("listener")

    def heard(**options: object) -> list[int]:
        number = on.hub.add_fault(Fault(kind="drop", **options))  # type: ignore[arg-type]
        on.hub.transmit(arms, np.array([0, 1]))
        on.hub.clear_fault(number)
        return sorted(_ids(listener.receive(0.0)))

    assert heard(node="arm_right_*") == [0x210]
    assert heard(channel="can1") == [0x200]
    assert heard(can_id=0x200, mask=0x7F0) == [0x210]
    assert heard(can_id=0x200, mask=0x700) == []
    assert heard(node="leg") == heard(node="arm_right_1", channel="can1") == [0x200, 0x210]
    on.turn()
    assert not on.hub.careful


def test_a_fault_begins_and_ends_on_the_buss_clock(on: Bench, make_frames: Make) -> None:
    sender, listener = on.join("sender"), on.join("listener")
    on.hub.add_fault(Fault(kind="drop", after=0.005, duration=0.010))
    arrived = []
    for millisecond in range(20):
        sender.send(make_frames([millisecond]))
        on.turn()
        arrived += _ids(listener.receive(0.0))
        on.now += 1_000_000
    assert arrived == [*range(5), *range(15, 20)]
    assert on.hub.report().faults == {} and not on.hub.careful


def test_a_delayed_frame_is_overtaken_and_comes_after_its_delay(on: Bench, make_frames: Make) -> None:
    sender, listener = on.join("sender"), on.join("listener")
    on.hub.add_fault(Fault(kind="delay", can_id=0x100, delay=0.004, count=1))
    sender.send(make_frames([0x100, 0x101]))
    given = on.now
    on.turn()
    on.turn(3.9)
    assert _ids(listener.receive(0.0)) == [0x101]
    on.turn(0.2)
    late = listener.receive(1.0)
    assert _ids(late) == [0x100] and 4_000_000 <= int(late["time_ns"][0]) - given < 4_200_000


def test_a_duplicated_frame_comes_twice_and_a_reordered_one_after_the_next(on: Bench, make_frames: Make) -> None:
    sender, other, listener = on.join("sender"), on.join("other"), on.join("listener")
    on.hub.add_fault(Fault(kind="duplicate", can_id=0x101))
    sender.send(make_frames([0x100, 0x101, 0x102]))
    on.turn()
    assert _ids(listener.receive(1.0)) == [0x100, 0x101, 0x101, 0x102]
    on.hub.clear_fault()
    on.hub.add_fault(Fault(kind="reorder", node="sender", count=1))
    sender.send(make_frames([0x300]))
    other.send(make_frames([0x400]))
    on.turn()
    assert _ids(listener.receive(1.0)) == [0x400]
    sender.send(make_frames([0x301]))
    on.turn()
    assert _ids(listener.receive(1.0)) == [0x301, 0x300]
    assert not on.hub.careful


def test_a_frame_that_waits_for_the_next_goes_on_when_the_fault_is_cleared(on: Bench, make_frames: Make) -> None:
    sender, listener = on.join("sender"), on.join("listener")
    on.hub.add_fault(Fault(kind="reorder"))
    sender.send(make_frames([0x300]))
    on.turn()
    on.hub.clear_fault()
    on.turn()
    assert _ids(listener.receive(1.0)) == [0x300]


def test_a_corrupt_frame_differs_in_one_to_three_bits_the_same_ones_with_the_same_seed(
    bench: Benches, make_frames: Make
) -> None:
    seen = []
    for seed in (1, 1, 2):
        on = bench()
        sender, listener = on.join("sender"), on.join("listener")
        on.hub.add_fault(Fault(kind="corrupt", seed=seed))
        batch = make_frames(np.full(20, 0x123), length=24)
        sender.send(batch)
        on.turn()
        flipped = np.unpackbits(listener.receive(1.0)["data"] ^ batch["data"], axis=1)
        assert flipped[:, 24 * 8 :].sum() == 0
        assert set(flipped.sum(axis=1).tolist()) == {1, 2, 3}
        seen.append(flipped.tobytes())
        on.close()
    assert seen[0] == seen[1] != seen[2]


def test_a_stuck_node_repeats_its_old_data_per_identifier(on: Bench, make_frames: Make) -> None:
    sender, listener = on.join("sender"), on.join("listener")
    number = on.hub.add_fault(Fault(kind="stuck", node="sender"))
    for value in (1, 2, 3):
        batch = make_frames([0x100, 0x200])
        batch["data"][:] = value
        batch["data"][1] += 100
        sender.send(batch)
        on.turn()
    heard = listener.receive(1.0)
    assert heard["data"][heard["can_id"] == 0x100][:, 0].tolist() == [1, 1, 1]
    assert heard["data"][heard["can_id"] == 0x200][:, 0].tolist() == [101, 101, 101]
    on.hub.clear_fault(number)
    sender.send(batch)
    on.turn()
    assert listener.receive(1.0)["data"][:, 0].tolist() == [3, 103]


def test_probability_is_the_share_of_frames_that_are_hit(on: Bench, make_frames: Make) -> None:
    sender, listener = on.join("sender"), on.join("listener")
    number = on.hub.add_fault(Fault(kind="drop", probability=0.3, seed=4))
    for _ in range(10):
        sender.send(make_frames(np.arange(100)))
        on.turn()
    hits = on.hub.report().hits[number]
    assert 230 < hits < 370 and len(listener.receive(1.0)) == 1000 - hits


def test_a_babbling_node_takes_the_whole_bus_from_all_who_matter_less(bench: Benches, make_frames: Make) -> None:
    for timing in (False, True):
        on = bench(timing=timing)
        on.join("idiot")
        sender, listener = on.join("sender"), on.join("listener")
        fault = on.hub.add_fault(Fault(kind="babble", node="idiot", channel="can0", can_id=0x010))
        on.turn()
        sender.send(np.concatenate([make_frames([0x100]), make_frames([0x100], bus=1)]))
        on.turn()
        on.turn(10.0)
        heard = listener.receive(1.0)
        on_first = heard[heard["bus"] == 0]
        assert set(_ids(on_first)) == {0x010} and 70 < len(on_first) < 100  # 108 to 134 bits each at 1 Mbit/s
        assert _ids(heard[heard["bus"] == 1]) == [0x100]
        on.join("boss").send(make_frames([0x001]))
        on.turn()
        on.turn(1.0)
        assert 0x001 in _ids(listener.receive(1.0))  # what matters more still gets through
        on.hub.clear_fault(fault)
        on.turn(1.0)
        assert 0x100 in _ids(listener.receive(1.0))  # and the rest when the babbling ends
        on.close()


def test_a_node_held_bus_off_comes_back_only_when_the_fault_has_ended(on: Bench, make_frames: Make) -> None:
    sender, listener = on.join("sender"), on.join("listener")
    on.hub.add_fault(Fault(kind="bus_off", node="sender", duration=0.050))
    sender.send(make_frames([0x100]))
    on.turn()
    on.turn(49.0)
    assert on.node("sender").state == "bus_off" and on.node("sender").overflows == 1
    on.turn(1.5)
    assert on.node("sender").state == "bus_off"
    on.turn(1.5)
    assert on.node("sender").state == "error_active" and len(listener.receive(0.0)) == 0
    sender.send(make_frames([0x101]))
    on.turn()
    assert _ids(listener.receive(1.0)) == [0x101]


def test_behind_a_cut_cable_a_node_is_alone_and_error_passive(on: Bench, make_frames: Make) -> None:
    on.hub.own_nodes(["elbow", "wrist"], ["can0", "can0"])
    host, listener = on.join("host"), on.join("listener")
    cut = on.hub.add_fault(Fault(kind="cut", node="host"))
    host.send(make_frames(np.arange(200)))
    on.turn()
    on.hub.transmit(make_frames([0x300]), np.array([0]))
    assert len(host.receive(0.0)) == 0 and _ids(listener.receive(1.0)) == [0x300]
    state = on.node("host")
    assert (state.state, state.transmit_errors, state.waiting, state.overflows) == ("cut", 128, 128, 72)
    deaf = on.hub.deaf()
    assert deaf is not None and not deaf.any()
    on.hub.add_fault(Fault(kind="cut", node="wrist"))
    assert on.hub.deaf().tolist() == [False, True]  # type: ignore[union-attr]
    on.hub.clear_fault(cut)
    on.turn(5.0)
    assert on.node("host").state == "error_active" and on.node("host").waiting == 0
    assert _ids(listener.receive(1.0)) == list(range(128))


def test_a_channel_whose_cable_is_cut_carries_nothing_not_even_for_newcomers(on: Bench, make_frames: Make) -> None:
    on.hub.add_fault(Fault(kind="cut", channel="can0"))
    sender, listener = on.join("sender"), on.join("listener")
    sender.send(np.concatenate([make_frames([1], bus=0), make_frames([2], bus=1)]))
    on.turn()
    assert _ids(listener.receive(1.0)) == [2]


def test_a_delay_ends_by_itself_on_the_wall_clock(on: Bench, make_frames: Make) -> None:
    on.hub._clock = time.time_ns
    sender, listener = on.join("sender"), on.join("listener")
    on.hub.add_fault(Fault(kind="delay", delay=0.3))
    sender.send(make_frames([0x100]))
    begun = time.perf_counter()
    assert _ids(on.hub.poll(0.01)) == []
    assert _ids(on.hub.poll(30.0)) == [0x100]
    assert 0.29 < time.perf_counter() - begun < 30.0
    assert _ids(listener.receive(1.0)) == [0x100]


def test_a_file_of_faults_is_read_with_line_and_field(tmp_path: Path, on: Bench) -> None:
    file = tmp_path / "faults.yaml"
    file.write_text(
        "faults:\n- {kind: drop, node: daemon, probability: 0.5}\n- {kind: cut, channel: can1, after: 1.0}\n"
    )
    for fault in faults.read(file):
        on.hub.add_fault(fault)
    assert [fault.kind for fault in on.hub.report().faults.values()] == ["drop", "cut"]
    file.write_text("faults:\n- {kind: drop, probability: 1.5}\n")
    with pytest.raises(Exception, match=r"faults.yaml:2.*probability"):
        faults.read(file)


_fault = st.builds(
    Fault,
    kind=st.sampled_from(faults.Kind.__args__),  # type: ignore[attr-defined]
    channel=st.sampled_from([None, "can0", "can1"]),
    node=st.sampled_from(["one", "two", "t*", "elbow", "nobody"]),
    can_id=st.one_of(st.none(), st.integers(0, 0x1FFFFFFF)),
    mask=st.integers(0, 0x1FFFFFFF),
    after=st.floats(0, 0.01),
    duration=st.one_of(st.none(), st.floats(1e-6, 0.02)),
    count=st.one_of(st.none(), st.integers(1, 50)),
    probability=st.floats(1e-3, 1.0),
    delay=st.floats(0, 0.01),
    seed=st.integers(0, 2**32),
)
_step = st.one_of(
    st.tuples(st.just("send"), st.integers(0, 1), st.binary(min_size=0, max_size=400)),
    st.tuples(st.just("records"), st.integers(0, 1), st.lists(st.binary(min_size=80, max_size=80), max_size=5)),
    st.tuples(st.just("fault"), _fault),
    st.tuples(st.just("clear")),
    st.tuples(st.just("pass"), st.floats(0, 5)),
    st.tuples(st.just("answer"), st.integers(0, 40)),
)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(timing=st.booleans(), steps=st.lists(_step, max_size=25))
def test_no_datagram_and_no_fault_brings_the_hub_down_or_loses_track_of_a_frame(
    timing: bool, steps: list[tuple], folder: Path, make_frames: Make
) -> None:
    with contextlib.closing(Bench(folder, timing=timing, fifo=16)) as on:
        on.hub.own_nodes(["elbow"], ["can1"])
        ports = [on.join("one"), on.join("two")]
        for step in steps:
            match step:
                case ("send", who, data):
                    with contextlib.suppress(OSError):
                        ports[who]._socket.send(data)
                case ("records", who, rows):
                    with contextlib.suppress(OSError):
                        ports[who]._socket.send(b"".join(rows))
                case ("fault", fault):
                    on.hub.add_fault(fault)
                case ("clear",):
                    on.hub.clear_fault()
                case ("pass", ms):
                    on.turn(ms)
                case ("answer", n):
                    on.hub.transmit(make_frames(np.full(n, 0x200), bus=1), np.zeros(n, np.int64))
            times = on.turn()["time_ns"].astype(np.int64)
            assert np.all(np.diff(times) >= 0)
        on.hub.clear_fault()
        for _ in range(3):
            on.turn(1000.0)
        on.hub.report()
        state = on.hub._traffic._state
        # Every frame has left: no row of the pool is lost, none is there twice.
        assert sorted(state.spare[:-1].tolist()) == list(range(len(state.spare) - 1))
        if not on.hub.listeners:
            return
        alive = next(port for port, name in zip(ports, ("one", "two"), strict=True) if name in _names(on))
        alive.send(make_frames([0x123]))
        on.turn()
        assert _ids(on.turn(1000.0)) == [0x123] or not timing
        assert frames.RECORD.itemsize == 80


def _names(on: Bench) -> list[str]:
    return [node.name for node in on.hub.report().nodes]
