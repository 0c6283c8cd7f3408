"""The hub's benchmark, as `handrail bench hal_hub` runs it, with short measurements."""

from __future__ import annotations

import pytest

from benchmarks import hal_hub


def test_every_way_through_the_hub_loses_nothing_and_a_full_bus_keeps_its_bit_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(hal_hub, "_TURNS", 1)
    monkeypatch.setattr(hal_hub, "_FRAMES", {1: 2_000, 8: 16_000})
    monkeypatch.setattr(hal_hub, "_through_udp", lambda: (2_000.0, 3))  # the peer is tested elsewhere
    monkeypatch.setattr(hal_hub, "_TIMED_S", 0.3)
    singly, batches, against_udp, timed = hal_hub.rows()
    assert "were" not in singly.goal and "were" not in batches.goal
    assert batches.value > 0 and singly.value == against_udp.value > 0
    assert against_udp.ratio == pytest.approx(singly.value / 2_000, rel=0.01)
    # 64 bytes of random data at 1/5 Mbit/s take some 140 µs, and a bus is never faster than its bits.
    assert 130 < timed.peer_value < 160 and timed.ratio > 0.95  # type: ignore[operator]
