"""What the loop counts of its own cycles."""

import time

import numpy as np

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
