"""What the loop counts of its own cycles."""

import dataclasses
import time

import numpy as np
import pytest

from daemon.timing import EDGES_NS, TimingReader, bin_of


def test_slow_cycles_are_found_in_the_bins_of_their_time(bench, monkeypatch) -> None:
    bench.run(5)
    reader = TimingReader(bench.runtime.timing)
    reader.begin_anew()
    works: list[int] = []
    bench.run(10, lambda: works.append(bench.loop.work_ns))
    update = bench.loop.devices.update

    def slow() -> None:
        time.sleep(0.03)
        update()

    monkeypatch.setattr(bench.loop.devices, "update", slow)
    bench.run(3, lambda: works.append(bench.loop.work_ns))
    record = reader.read()
    assert record is not None
    assert record["work"].tolist() == np.bincount([bin_of(ns) for ns in works], minlength=len(EDGES_NS) + 1).tolist()
    assert record["work"][bin_of(29_999_999) :].sum() >= 3
    assert record["work_max_ns"] == max(works)
    assert not record["late"].any(), "in lock-step nothing is late"


def test_on_the_wall_clock_a_cycle_that_overruns_counts_as_a_run_of_misses(bench, monkeypatch) -> None:
    loop, cycle = bench.loop, bench.loop.cycle
    loop.lockstep = False
    bench.run(5)

    def slow_then_end() -> None:
        cycle()
        time.sleep(6.5 * loop.period_ns * 1e-9)
        loop.end()

    monkeypatch.setattr(loop, "cycle", slow_then_end)
    loop.run_wall()
    record = TimingReader(bench.runtime.timing).read()
    assert record is not None
    assert record["misses"] == record["longest_run"] == loop.misses >= 6
    assert record["late"].sum() == 6
    assert record["late_max_ns"] == loop.late_ns


@pytest.mark.parametrize(("allowed", "stops"), [(0, False), (5, True), (1_000_000, False)])
def test_a_loop_that_misses_more_periods_in_a_row_than_its_robot_allows_stops_it(
    talos, make_bench, monkeypatch, allowed: int, stops: bool
) -> None:
    bench = make_bench(dataclasses.replace(talos, stop_after_misses=allowed))
    bench.enable()
    loop, cycle, turns = bench.loop, bench.loop.cycle, iter(range(8))
    loop.lockstep = False

    def slow_then_end() -> None:
        turn = next(turns)
        cycle()
        if turn == 4:
            time.sleep(6.5 * loop.period_ns * 1e-9)
        if turn == 7:
            loop.end()

    monkeypatch.setattr(loop, "cycle", slow_then_end)
    loop.run_wall()
    assert loop.misses >= 6
    assert loop.life.stopped is stops
    assert loop.life.enabled is not stops
    if stops:
        assert "periods in a row; control.stop_after_misses is 5" in loop.life.stop_reason
