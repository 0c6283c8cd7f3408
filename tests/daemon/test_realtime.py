"""Deadlines and what makes a process a real-time one; never how late, which is the machine's affair."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

from hal.realtime import sleep_then_spin_until, sleep_until


def test_it_never_wakes_before_the_deadline() -> None:
    for _ in range(20):
        deadline = time.monotonic_ns() + 2_000_000
        sleep_until(deadline)
        assert time.monotonic_ns() >= deadline
        deadline += 1_000_000
        sleep_then_spin_until(deadline)
        assert time.monotonic_ns() >= deadline


def test_a_deadline_in_the_past_returns_at_once() -> None:
    begin = time.monotonic()
    for _ in range(1000):
        sleep_until(time.monotonic_ns() - 1_000_000_000)
    assert time.monotonic() - begin < 5


def test_absolute_deadlines_do_not_drift_by_the_work_between_them() -> None:
    period = 2_000_000
    deadline = time.monotonic_ns()
    late = []
    for _ in range(100):
        deadline += period
        sleep_until(deadline)
        late.append(time.monotonic_ns() - deadline)
        until = time.monotonic_ns() + 300_000
        while time.monotonic_ns() < until:
            pass
    # Sleeping for a period after each piece of work would be late by all the work before, 15 ms and more in the second half.
    assert min(late[50:]) < 15_000_000


def test_a_signals_handler_runs_and_the_sleep_goes_on_to_its_deadline() -> None:
    seen = []
    previous = signal.signal(signal.SIGALRM, lambda *_: seen.append(time.monotonic_ns()))
    try:
        deadline = time.monotonic_ns() + 100_000_000
        signal.setitimer(signal.ITIMER_REAL, 0.02)
        sleep_until(deadline)
        assert time.monotonic_ns() >= deadline
        assert len(seen) == 1
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, previous)


SCRIPT = """
import os, resource, sys
from hal.realtime import RealTime
if len(sys.argv) > 1:
    os.setgroups([]); os.setgid(65534); os.setuid(65534)
    resource.setrlimit(resource.RLIMIT_MEMLOCK, (0, 0))
made = RealTime(priority=5, cpus={0})
big = bytearray(64 << 20)  # memory that is allocated later must still be had
print(os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO, sorted(os.sched_getaffinity(0)))
for line in made.warnings:
    print(line)
"""


def run_script(*arguments: str) -> list[str]:
    result = subprocess.run(
        [sys.executable, "-c", SCRIPT, *arguments], capture_output=True, text=True, timeout=60, check=False
    )
    assert result.returncode == 0, result.stderr
    return result.stdout.splitlines()


def test_every_thing_that_was_not_done_is_a_warning() -> None:
    first, *warnings = run_script()
    scheduled = first.startswith("True")
    assert scheduled != any("SCHED_FIFO" in line for line in warnings)


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give its rights away")
def test_without_rights_it_runs_on_and_says_what_is_missing_and_where_to_allow_it() -> None:
    first, *warnings = run_script("without rights")
    assert first.startswith("False")
    assert any("SCHED_FIFO 5" in line and "rtprio" in line for line in warnings)
    assert any("mlockall" in line and "memlock" in line for line in warnings)


def test_processors_that_are_not_there_are_a_warning_and_no_error() -> None:
    script = "from hal.realtime import RealTime; print(RealTime(priority=0, cpus={4000}).warnings[0])"
    result = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=True)
    assert "4000" in result.stdout
