"""A bus that keeps bit timing: frames take their time, a full bus delays and drops, a frame on the wire is not pushed off it."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest

from hal.can import frames
from hal.can.hub import Hub
from hal.can.timing import frame_ns
from tests.can.conftest import Bench

Make = Callable[..., np.ndarray]
Benches = Callable[..., Bench]


def _ids(records: np.ndarray) -> list[int]:
    return [int(can_id) for can_id in records["can_id"]]


def _cost(records: np.ndarray) -> list[int]:
    return [frame_ns(frames.words(records), row, 1_000_000, 5_000_000) for row in range(len(records))]


def test_a_frame_arrives_when_it_ends_and_not_before(bench: Benches, make_frames: Make) -> None:
    on = bench(timing=True)
    sender, listener = on.join("sender"), on.join("listener")
    batch = make_frames([0x100, 0x101], length=64)
    sender.send(batch)
    start, cost = on.now, _cost(batch)
    on.turn()
    on.turn((cost[0] - 1) * 1e-6)
    assert len(listener.receive(0.0)) == 0
    on.turn(1e-6)
    first = listener.receive(1.0)
    assert _ids(first) == [0x100] and first["time_ns"][0] == start + cost[0]
    on.turn(cost[1] * 1e-6)
    second = listener.receive(1.0)
    assert _ids(second) == [0x101] and second["time_ns"][0] == start + sum(cost)
    assert on.hub.statistics()[0].busy_ns == sum(cost)


def test_who_comes_while_a_frame_is_on_the_wire_waits_however_important(bench: Benches, make_frames: Make) -> None:
    on = bench(timing=True)
    slow, urgent, listener = on.join("slow"), on.join("urgent"), on.join("listener")
    slow.send(make_frames([0x700, 0x701], length=64))
    on.turn()
    urgent.send(make_frames([0x001]))
    on.turn(0.01)
    on.turn(5.0)
    assert _ids(listener.receive(1.0)) == [0x700, 0x001, 0x701]


def test_channels_carry_at_the_same_time(bench: Benches, make_frames: Make) -> None:
    on = bench(timing=True)
    sender, listener = on.join("sender"), on.join("listener")
    both = np.concatenate([make_frames([1, 2], bus=0, length=64), make_frames([3, 4], bus=1, length=64)])
    sender.send(both)
    on.turn()
    on.turn(2.0)
    heard = listener.receive(1.0)
    assert sorted(_ids(heard)) == [1, 2, 3, 4]
    assert np.all(np.diff(heard["time_ns"].astype(np.int64)) >= 0)
    assert heard["time_ns"].astype(np.int64)[-1] - 1_000_000_000 == max(sum(_cost(both)[:2]), sum(_cost(both)[2:]))


def test_a_bus_that_is_offered_too_much_drops_what_the_fifo_does_not_hold(bench: Benches, make_frames: Make) -> None:
    on = bench(timing=True, fifo=50)
    flood, polite, listener = on.join("flood"), on.join("polite"), on.join("listener")
    batch = make_frames(np.full(200, 0x400), length=64)
    flood.send(batch)
    on.turn()
    assert on.node("flood").waiting == 50 and on.node("flood").overflows == 150
    polite.send(make_frames([0x010]))
    on.turn(0.001)
    on.turn(50.0)
    heard = _ids(listener.receive(1.0))
    assert heard == [0x400, 0x010] + [0x400] * 49
    assert on.node("flood").waiting == 0 and on.node("polite").overflows == 0


def test_a_saturated_bus_carries_exactly_what_its_bit_rate_allows(bench: Benches, make_frames: Make) -> None:
    on = bench(timing=True, fifo=100)
    sender, listener = on.join("sender"), on.join("listener")
    batch = make_frames(np.full(20, 0x123), length=64)
    begun, times, rng = on.now, [], np.random.default_rng(1)
    for _ in range(200):
        sender.send(batch)
        on.turn(rng.uniform(0.0, 3.0))
        times += listener.receive(0.0)["time_ns"].astype(np.int64).tolist()
    spacing = np.diff(times[1:])
    assert len(times) > 1000 and len(set(spacing.tolist())) <= 20  # the data differ, and the stuff bits with them
    busy = on.hub.statistics()[0].busy_ns
    assert busy == pytest.approx(times[-1] - begun, rel=0.01)


def test_what_a_sender_queued_before_it_left_still_goes_out(bench: Benches, make_frames: Make) -> None:
    on = bench(timing=True)
    sender, listener = on.join("sender"), on.join("listener")
    sender.send(make_frames([1, 2, 3], length=64))
    sender.close()
    on.turn()
    on.turn()
    on.join("another")  # gets no number that has frames under way
    on.turn(5.0)
    assert _ids(listener.receive(1.0)) == [1, 2, 3]


def test_on_the_wall_clock_the_hub_wakes_up_when_a_frame_ends(bench: Benches, folder, make_frames: Make) -> None:  # type: ignore[no-untyped-def]
    on = bench(timing=True)
    on.hub._clock = time.time_ns
    sender, listener = on.join("sender"), on.join("listener")
    batch = make_frames(np.arange(50), length=64)
    begun = time.perf_counter()
    sender.send(batch)
    heard = 0
    while heard < 50 and time.perf_counter() - begun < 30.0:
        heard += len(on.hub.poll(1.0))
    took = time.perf_counter() - begun
    needed = sum(_cost(batch)) * 1e-9
    assert heard == 50 and took >= needed
    assert took < needed + 30.0  # a machine with much else to do is late, but not for ever
    assert len(listener.receive(1.0)) == 50


def _cycle(
    on: Bench, ports: list, make_frames: Make, commands: int, answers: int
) -> tuple[int, tuple[int, int] | None]:
    """One host cycle in lock-step: commands and Sync out, a period later the answers; (answers that came, ticks)."""
    host = ports[0]
    host.send(np.concatenate([make_frames(np.full(commands, 0x100), length=64), make_frames([0x080], length=0)]))
    on.hub.poll(1.0)
    ticks = on.hub.heard
    on.now += 2_000_000
    on.hub.owe_ticks(1)
    on.hub.transmit(make_frames(np.arange(answers) + 0x200, length=64), np.arange(answers))
    on.hub.tick()
    return len(host.receive(0.0)), ticks


def test_in_lock_step_a_cycle_has_a_period_of_bus_time_and_the_rest_comes_in_the_next(
    bench: Benches, make_frames: Make
) -> None:
    on = bench(timing=True)
    on.hub.own_nodes([f"drive{i}" for i in range(40)], ["can0"] * 40)
    on.hub.lockstep(2_000_000, 0x080, 0x081)
    ports = [on.join("host", ticks=True)]
    light = [_cycle(on, ports, make_frames, 3, 7) for _ in range(5)]
    assert light == [(7, (1, 0))] * 5
    # 40 answers of about 170 µs fit no period of 2 ms: they pile up, at the rate of the bus.
    heavy = [_cycle(on, ports, make_frames, 3, 40) for _ in range(10)]
    assert all(tick == (1, 0) for _, tick in heavy)
    assert all(8 <= got <= 13 for got, _ in heavy)


def test_in_lock_step_the_same_frames_give_the_same_run(folder, make_frames: Make) -> None:  # type: ignore[no-untyped-def]
    runs = []
    for _ in range(2):
        on = Bench(folder, timing=True)
        on.hub.own_nodes([f"drive{i}" for i in range(9)], ["can0"] * 9)
        on.hub.lockstep(2_000_000, 0x080, 0x081)
        listener = on.join("listener")
        ports = [on.join("host")]
        seen = b""
        for cycle in range(30):
            _cycle(on, ports, make_frames, cycle % 5, 9)
            seen += listener.receive(0.0).tobytes()
        runs.append(seen)
        on.close()
    assert runs[0] == runs[1] and len(runs[0]) > 80 * 200


def test_holding_time_takes_no_time_on_the_bus(bench: Benches, make_frames: Make) -> None:
    on = bench(timing=True, fifo=8)
    on.hub.lockstep(2_000_000, 0x080, 0x081)
    host = on.join("host")
    for _ in range(100):
        host.send(make_frames([0x081], length=0))
        on.hub.poll(1.0)
        assert on.hub.heard == (0, 1)
    assert on.node("host").waiting == 0 and on.hub.statistics()[0].busy_ns == 0


def test_without_timing_nothing_waits(bench: Benches, make_frames: Make) -> None:
    on = bench(fifo=4)
    sender, listener = on.join("sender"), on.join("listener")
    sender.send(make_frames(np.arange(100)))
    assert len(on.turn()) == 100
    assert len(listener.receive(1.0)) == 100
    assert not on.hub.report().timing
    assert isinstance(on.hub, Hub) and on.node("sender").overflows == 0
