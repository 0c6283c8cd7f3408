"""Two processes that take turns on one core: real processes, real cores."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator

import pytest

from hal.shared_core import SharedCore

ALLOWED = os.sched_getaffinity(0)

pytestmark = pytest.mark.skipif(len(ALLOWED) < 2, reason="this machine lets us have one core only")


@pytest.fixture
def other() -> Iterator[int]:
    """A process that sleeps."""
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        yield process.pid
        process.kill()
    os.sched_setaffinity(0, ALLOWED)


def test_both_come_to_one_core_and_are_let_go_at_the_end(other: int) -> None:
    core = SharedCore(other)
    core.look()
    assert len(os.sched_getaffinity(0)) == 1
    assert os.sched_getaffinity(other) == os.sched_getaffinity(0)
    core.close()
    assert os.sched_getaffinity(other) == os.sched_getaffinity(0) == ALLOWED


def test_they_leave_a_core_that_others_want(other: int) -> None:
    core = SharedCore(other)
    core.look()
    mine = os.sched_getaffinity(0)
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(3)]
    try:
        for process in busy:
            os.sched_setaffinity(process.pid, mine)
        deadline = time.monotonic() + 5.0
        while os.sched_getaffinity(0) == mine and time.monotonic() < deadline:
            core.look()
        assert os.sched_getaffinity(0) == os.sched_getaffinity(other) == ALLOWED
    finally:
        for process in busy:
            process.kill()
            process.wait()


def test_a_process_that_is_not_there_is_left_alone() -> None:
    with subprocess.Popen([sys.executable, "-c", ""]) as gone:
        gone.wait()
        core = SharedCore(gone.pid)
        core.look()
        core.close()
    assert os.sched_getaffinity(0) == ALLOWED
