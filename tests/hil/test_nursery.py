"""The warm process that tests' processes are forked from: real processes, and none left behind."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Iterator

import psutil
import pytest

from hal.hil.nursery import Nursery, Process, ProcessDied

SERVER = ("http.server", ["--bind", "127.0.0.1", "0"])
"""a module of the standard library that runs until it is ended"""

ASKER = """
import time
from hal.hil.nursery import Nursery
nursery = Nursery()
child = nursery.start("server", "http.server", ["--bind", "127.0.0.1", "0"])
child.wait_for("Serving HTTP")
print(nursery._process.pid, child.pid, flush=True)
time.sleep(60)
"""


@pytest.fixture(scope="module")
def nursery() -> Iterator[Nursery]:
    made = Nursery()
    yield made
    made.close()


def start(nursery: Nursery) -> Process:
    child = nursery.start("server", *SERVER)
    child.wait_for("Serving HTTP", 20.0)
    return child


def test_children_are_processes_that_can_be_killed_and_ended_one_by_one(nursery):
    one, other = start(nursery), start(nursery)
    assert one.pid != other.pid
    assert one.kill() == -signal.SIGKILL
    assert not one.alive
    assert other.alive
    assert other.end() == -signal.SIGTERM
    assert other.end() == -signal.SIGTERM, "the end of what has ended is told again"


def test_a_child_that_outlives_its_killing_is_reported_with_what_keeps_each_of_its_threads(nursery, monkeypatch):
    child = start(nursery)
    with monkeypatch.context() as pretended:
        pretended.setattr(child, "send", lambda _: None)
        pretended.setattr(child, "wait", lambda _: None)
        with pytest.raises(AssertionError, match=rf"server outlives SIGKILL by .*thread {child.pid} [RS] in \w+"):
            child.kill()
    assert child.kill() == -signal.SIGKILL


def test_a_child_that_ends_at_once_says_why(nursery):
    child = nursery.start("server", "http.server", ["--port-of-call"])
    with pytest.raises(ProcessDied, match="unrecognized arguments"):
        child.wait_for("Serving HTTP", 20.0)
    assert child.wait(5.0) == 2


def test_what_cannot_be_imported_is_told_to_who_asked_and_the_nursery_lives_on(nursery):
    with pytest.raises(ProcessDied, match="No module named 'no_such_module'"):
        nursery.warm(["no_such_module"])
    nursery.warm(["json"])


def test_no_child_outlives_the_one_who_asked_for_it_however_that_one_dies():
    asker = subprocess.Popen([sys.executable, "-c", ASKER], stdout=subprocess.PIPE, text=True)
    assert asker.stdout is not None
    pids = [int(pid) for pid in asker.stdout.readline().split()]
    assert len(pids) == 2
    asker.kill()
    asker.wait()
    deadline = time.monotonic() + 20.0
    while any(psutil.pid_exists(pid) for pid in pids) and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not any(psutil.pid_exists(pid) for pid in pids)
