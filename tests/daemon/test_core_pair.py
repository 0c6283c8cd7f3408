"""Cores of two processes that take turns: real processes, real cores."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import pytest

from hal.core_pair import CorePair

ALLOWED = os.sched_getaffinity(0)

pytestmark = pytest.mark.skipif(len(ALLOWED) < 2, reason="this machine lets us have one core only")


@pytest.fixture
def other() -> Iterator[int]:
    """A process that sleeps."""
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        yield process.pid
        process.kill()
    os.sched_setaffinity(0, ALLOWED)


@pytest.fixture
def crowd() -> Iterator[None]:
    """So much work for all cores that whoever wants one waits."""
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(3 * len(ALLOWED))]
    yield
    for process in busy:
        process.kill()
        process.wait()


def _look_until(pair: CorePair, cores: Callable[[], bool]) -> bool:
    """Work between looks, as the loop does, until the cores are as wanted; False: not within a minute."""
    deadline = time.monotonic() + 60.0
    while not cores() and time.monotonic() < deadline:
        pair.look()
    return cores()


@pytest.mark.usefixtures("crowd")
def test_where_others_want_the_cores_both_come_to_one_and_part_again_later(other: int) -> None:
    pair = CorePair(other)
    assert os.sched_getaffinity(other) == os.sched_getaffinity(0) == ALLOWED
    assert _look_until(pair, lambda: len(os.sched_getaffinity(0)) == 1)
    assert os.sched_getaffinity(other) == os.sched_getaffinity(0)
    assert _look_until(pair, lambda: os.sched_getaffinity(0) == ALLOWED)
    assert os.sched_getaffinity(other) == ALLOWED


@pytest.mark.usefixtures("crowd")
def test_both_are_let_go_at_the_end(other: int) -> None:
    pair = CorePair(other)
    assert _look_until(pair, lambda: len(os.sched_getaffinity(0)) == 1)
    pair.close()
    assert os.sched_getaffinity(other) == os.sched_getaffinity(0) == ALLOWED


def test_a_process_whose_last_partner_was_killed_while_they_shared_a_core_is_let_go(other: int) -> None:
    os.sched_setaffinity(other, {min(ALLOWED)})
    CorePair(other)
    assert os.sched_getaffinity(other) == ALLOWED


def test_a_process_that_is_not_there_is_left_alone() -> None:
    with subprocess.Popen([sys.executable, "-c", ""]) as gone:
        gone.wait()
        core = CorePair(gone.pid)
        core.look()
        core.close()
    assert os.sched_getaffinity(0) == ALLOWED
