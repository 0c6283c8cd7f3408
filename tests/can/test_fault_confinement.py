"""Error counters after ISO 11898-1: error active, error passive, bus-off, and the way back."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hal.can import frames
from hal.can.faults import Fault
from tests.can.conftest import Bench

Make = Callable[..., np.ndarray]
Benches = Callable[..., Bench]


def _ids(records: np.ndarray) -> list[int]:
    return [int(can_id) for can_id in records["can_id"]]


def test_a_destroyed_frame_is_sent_again_and_counts_eight_for_its_sender_and_one_for_the_others(
    bench: Benches, make_frames: Make
) -> None:
    on = bench(timing=True)
    sender, listener = on.join("sender"), on.join("listener")
    number = on.hub.add_fault(Fault(kind="bit_error", node="sender", count=3))
    sender.send(make_frames([0x123]))
    on.turn()
    on.turn(5.0)
    assert _ids(listener.receive(1.0)) == [0x123]  # once: what was destroyed nobody took
    # Three errors up, one success down.
    assert (on.node("sender").transmit_errors, on.node("sender").receive_errors) == (3 * 8 - 1, 0)
    assert (on.node("listener").transmit_errors, on.node("listener").receive_errors) == (0, 3 - 1)
    report = on.hub.report()
    assert report.channels[0].error_frames == 3 and report.hits[number] == 3 and number not in report.faults


def test_error_frames_cost_bus_time(bench: Benches, make_frames: Make) -> None:
    busy = []
    for errors in (0, 5):
        on = bench(timing=True)
        sender = on.join("sender")
        if errors:
            on.hub.add_fault(Fault(kind="bit_error", count=errors))
        sender.send(make_frames([0x123]))
        on.turn()
        on.turn(5.0)
        busy.append(on.hub.statistics()[0].busy_ns)
        on.close()
    assert busy[1] - busy[0] >= 5 * 23_000  # error frames of 23 bits at 1 Mbit/s, and the parts of frames before them


def test_from_128_on_a_node_is_error_passive_and_its_frames_say_so(bench: Benches, make_frames: Make) -> None:
    on = bench(timing=True)
    sender, listener = on.join("sender"), on.join("listener")
    on.hub.add_fault(Fault(kind="bit_error", node="sender", count=17))
    sender.send(make_frames([0x123]))
    on.turn()
    on.turn(10.0)
    assert on.node("sender").state == "error_passive" and on.node("sender").transmit_errors == 17 * 8 - 1
    assert listener.receive(1.0)["flags"][0] & frames.ESI
    sender.send(make_frames(np.full(20, 0x124)))
    on.turn()
    on.turn(10.0)
    heard = listener.receive(1.0)
    passive = (heard["flags"] & frames.ESI) != 0
    # 8 successes down to 127: the frame that starts from then on is an error-active node's.
    assert passive.tolist() == [True] * 8 + [False] * 12
    gaps = np.diff(heard["time_ns"].astype(np.int64))
    assert gaps[:7].min() > gaps[9:].max() - 2_000  # a passive sender waits 8 bits more between its frames
    assert gaps[:7].mean() - gaps[9:].mean() > 6_000
    assert on.node("sender").state == "error_active"


def test_at_256_a_node_is_bus_off_neither_sends_nor_hears_and_its_fifo_is_gone(
    bench: Benches, make_frames: Make
) -> None:
    on = bench(timing=True)
    broken, healthy = on.join("broken"), on.join("healthy")
    fault = on.hub.add_fault(Fault(kind="bit_error", node="broken"))
    broken.send(make_frames(np.arange(10) + 0x100))
    on.turn()
    while on.node("broken").state != "bus_off":
        on.turn(0.05)
    assert (on.node("broken").waiting, on.node("broken").overflows) == (0, 10)
    assert on.hub.report().channels[0].error_frames == 32
    healthy.send(make_frames([0x200]))
    broken.send(make_frames([0x300]))  # refused: it is off the bus
    on.turn()
    on.turn(0.3)
    assert len(broken.receive(0.0)) == 0 and on.node("broken").overflows == 11
    assert on.node("healthy").state == "error_active"
    assert on.hub.clear_fault(fault) == 1


def test_a_bus_off_node_is_back_after_128_times_11_recessive_bits_without_a_burst_of_stale_frames(
    bench: Benches, make_frames: Make
) -> None:
    on = bench(timing=True)
    broken, listener = on.join("broken"), on.join("listener")
    on.hub.add_fault(Fault(kind="bit_error", node="broken", count=32))
    broken.send(make_frames(np.arange(50) + 0x100, length=8))
    on.turn()
    while on.node("broken").state != "bus_off":
        on.turn(0.01)
    off_since = on.now
    while on.node("broken").state == "bus_off":
        on.turn(0.01)
    assert 1_408_000 - 20_000 <= on.now - off_since <= 1_408_000 + 20_000  # idle bus at 1 Mbit/s
    assert (on.node("broken").transmit_errors, on.node("broken").receive_errors) == (0, 0)
    on.turn(10.0)
    assert len(listener.receive(0.0)) == 0
    broken.send(make_frames([0x777]))
    on.turn()
    on.turn(1.0)
    assert _ids(listener.receive(1.0)) == [0x777]


def test_a_busy_bus_makes_recovery_take_longer(bench: Benches, make_frames: Make) -> None:
    on = bench(timing=True)
    broken, busy = on.join("broken"), on.join("busy")
    on.hub.add_fault(Fault(kind="bit_error", node="broken", count=32))
    broken.send(make_frames([0x100]))
    on.turn()
    while on.node("broken").state != "bus_off":
        on.turn(0.01)
    since = on.now
    while on.node("broken").state == "bus_off":
        if on.node("busy").waiting < 5:
            busy.send(make_frames(np.full(20, 0x200), length=64))
        on.turn(0.1)
    # Of every frame only its end is recessive for long enough: 128 frames of some 170 µs.
    assert 15_000_000 < on.now - since < 25_000_000


def test_without_timing_the_same_node_goes_bus_off_at_once_and_the_bus_is_quick_again_in_the_end(
    bench: Benches, make_frames: Make
) -> None:
    on = bench()
    broken, listener, third = on.join("broken"), on.join("listener"), on.join("third")
    on.hub.add_fault(Fault(kind="bit_error", node="broken", count=32))
    assert on.hub.careful
    broken.send(make_frames([0x100, 0x101]))
    on.turn()
    assert on.node("broken").state == "bus_off" and len(listener.receive(0.0)) == 0
    for _ in range(40):
        listener.send(make_frames([0x200]))
        third.send(make_frames([0x201]))
        on.turn(1.0)
    assert on.node("broken").state == "error_active" and not on.hub.careful
    broken.send(make_frames([0x300]))
    assert _ids(on.turn()) == [0x300]
