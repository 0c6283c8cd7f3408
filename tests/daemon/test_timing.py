"""The loop's histograms: bins, percentiles, misses, and counting anew."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.exchange.shared_file import SharedFileError, create
from daemon.timing import BINS, EDGES_NS, MARK, TimingReader, TimingWriter, bin_of, distribution, loop_timing

TIMES = st.one_of(st.integers(0, 1 << 33), st.sampled_from(EDGES_NS.tolist()), st.integers(50_000, 500_000))


@settings(deadline=None)
@given(st.one_of(TIMES, st.sampled_from((EDGES_NS - 1).tolist())))
def test_a_time_lies_in_the_bin_that_numpy_finds_between_the_edges(ns: int) -> None:
    assert bin_of(ns) == np.searchsorted(EDGES_NS, ns, side="right")


def test_bins_are_an_eighth_of_an_octave_from_a_microsecond_to_a_second() -> None:
    assert (EDGES_NS[0], EDGES_NS[-1], len(EDGES_NS)) == (1 << 10, 1 << 30, BINS - 1)
    assert EDGES_NS[::8].tolist() == [1 << bit for bit in range(10, 31)]
    assert (np.diff(EDGES_NS) / EDGES_NS[:-1]).max() <= 1 / 8


@settings(deadline=None)
@given(st.lists(TIMES, min_size=1, max_size=60))
def test_percentiles_are_those_of_the_times_but_for_a_bins_width(times: list[int]) -> None:
    counts = np.bincount([bin_of(ns) for ns in times], minlength=BINS)
    told = distribution(counts, max(times))
    assert told.max_us == max(times) / 1e3
    assert sum(told.counts) == len(times)
    for share, value in ((50, told.p50_us), (90, told.p90_us), (99, told.p99_us)):
        exact = float(np.percentile(times, share, method="inverted_cdf"))
        assert exact <= value * 1e3 + 1e-6
        if 1 << 10 <= exact < 1 << 30:
            assert value * 1e3 <= exact * 1.125 + 1e-6
        assert value <= told.max_us


def test_without_a_cycle_every_percentile_is_zero() -> None:
    told = distribution(np.zeros(BINS, np.int64), 0)
    assert (told.p50_us, told.p90_us, told.p99_us, told.max_us) == (0.0, 0.0, 0.0, 0.0)


def test_the_reader_sees_what_was_counted_and_a_new_loop_begins_anew(tmp_path: Path) -> None:
    path = tmp_path / "timing"
    reader = TimingReader(path)
    assert reader.read() is None
    writer = TimingWriter(path)
    for work, late in ((100_000, 2_000), (100_500, 700), (3_000_000, 2_000_000_000)):
        writer.count(work, late)
    record = reader.read()
    assert record is not None
    assert np.flatnonzero(record["work"]).tolist() == [bin_of(100_000), bin_of(3_000_000)]
    assert record["work"][bin_of(100_000)] == 2
    assert np.flatnonzero(record["late"]).tolist() == [0, bin_of(2_000), BINS - 1]
    assert "7 periods in a row stop the robot" in loop_timing(record, "wall", 2_000_000, 7).overrun_policy
    told = loop_timing(record, "wall", 2_000_000)
    assert (told.cycles, told.work.max_us, told.late.max_us) == (3, 3000.0, 2e6)
    assert "skips whole periods" in told.overrun_policy
    TimingWriter(path)
    assert loop_timing(reader.read(), "wall", 2_000_000).cycles == 0


def test_the_longest_run_counts_periods_until_a_cycle_is_punctual(tmp_path: Path) -> None:
    writer, reader = TimingWriter(tmp_path / "timing"), TimingReader(tmp_path / "timing")
    for skipped in (1, 0, 2, 3, 1, 0, 0, 4, 0):
        writer.count(1000, 0)
        if skipped:
            writer.missed(skipped)
    record = reader.read()
    assert record is not None
    assert (record["misses"], record["longest_run"]) == (11, 6)


def test_it_counts_anew_when_it_is_asked_and_shows_nothing_old_until_then(tmp_path: Path) -> None:
    writer, reader = TimingWriter(tmp_path / "timing"), TimingReader(tmp_path / "timing")
    writer.count(5_000_000, 90_000)
    writer.missed(2)
    reader.begin_anew()
    assert loop_timing(reader.read(), "wall", 1).cycles == 0
    writer.count(3_000, 2_000)
    told = loop_timing(reader.read(), "wall", 1)
    assert (told.cycles, told.misses, told.longest_run) == (1, 0, 0)
    assert (told.work.max_us, told.late.max_us) == (3.0, 2.0)


def test_another_versions_file_is_refused(tmp_path: Path) -> None:
    create(tmp_path / "timing", 4096, magic=MARK, record_size=8, count=1)
    with pytest.raises(SharedFileError, match="different versions"):
        TimingReader(tmp_path / "timing").read()
