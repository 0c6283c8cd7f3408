"""Nodes that flood, hog or leak are slowed down or ended, and told; they are forked from one warm process and share its memory."""

from __future__ import annotations

import contextlib
import os
import queue
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from engines.nodes.host import NodeFailed, NodeProcess
from engines.nodes.launcher import LAUNCHER
from engines.nodes.log import LINES_A_SECOND
from engines.nodes.pace import Rates, Share
from handrail import usage

NODE = """\
import mmap, threading
import numpy as np
from engines.nodes import Input, Node, Output

class Busy(Node):
    '''Does what it is told to.'''
    {more}
    what = Input("text")
    slow, count = Output("number", rate=20.0), Output("integer")

    def start(self):
        self._steps, self._kept = 0, []

    def step(self):
        self._steps += 1
        if self.what == "print":
            for k in range(5000):
                print("line", k)
        elif self.what == "share":
            self._kept.append(mmap.mmap(-1, 300_000_000))
            for k in range(300):
                self._kept[0].write(bytes(1_000_000))
        elif self.what == "spin":
            def spin():
                while True: pass
            threading.Thread(target=spin, daemon=True).start()
        elif self.what == "work":
            sum(range(200_000))
        self.slow, self.count = float(self._steps), self._steps
"""


@pytest.fixture
def node(tmp_path: Path) -> Iterator[Callable[..., NodeProcess]]:
    """Starts nodes: `more` is a line of the class, the rest goes to NodeProcess."""
    running: list[NodeProcess] = []

    def start(more: str = "", **arguments: Any) -> NodeProcess:
        file = tmp_path / "busy.py"
        file.write_text(NODE.format(more=more))
        running.append(NodeProcess(file, **arguments))
        return running[-1]

    yield start
    for each in running:
        each.close()


def test_an_output_faster_than_its_rate_is_told_that_often_with_its_newest_value():
    notes: list[str] = []
    rates = Rates({"fast": 10.0, "fine": 100.0}, notes.append)
    told = {"fast": 0, "fine": 0}
    for step in range(1000):  # 10 s at 100 Hz
        for name in rates.due({"fast", "fine"}, step / 100):
            told[name] += 1
    assert told["fine"] == 1000 and 90 <= told["fast"] <= 112
    (note,) = notes
    assert (
        note == "output fast: is written 100 times a second, declared 10: told that often, its newest value each time"
    )


def test_two_values_in_quick_succession_are_no_flood():
    notes: list[str] = []
    rates = Rates({"value": 10.0}, notes.append)
    times = [k + late for k in range(60) for late in (0.0, 0.01)]
    due = [rates.due({"value"}, now) for now in times]
    assert due == [["value"], []] * 60 and not notes


def test_a_value_that_had_to_wait_is_told_when_its_turn_comes_though_nothing_new_was_written():
    rates = Rates({"value": 10.0}, [].append)
    written = [{"value"}, {"value"}, (), (), ()]
    assert [rates.due(each, 0.05 * k) for k, each in enumerate(written)] == [["value"], [], ["value"], [], []]


def test_a_step_that_uses_more_than_its_share_is_followed_by_rest():
    notes: list[str] = []
    share = Share(0.25, notes.append)
    assert share.rest_until(100.0, 0.1, 100.1) == pytest.approx(100.4)
    assert share.rest_until(200.0, 0.01, 200.1) == pytest.approx(200.1)
    assert notes == ["a step uses 0.1 s of a core, its share is 25 %: it steps every 0.4 s"]
    assert Share(1.0, notes.append).rest_until(0.0, 5.0, 0.1) == 0.1


def test_a_flooding_output_is_slowed_down_and_told(node):
    notes: queue.SimpleQueue[str] = queue.SimpleQueue()
    told: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
    process = node("every = 0.001", noted=notes.put, told=told.put)
    process.put({"what": "count"})
    while "output slow" not in (note := notes.get(timeout=60)):
        assert (
            "output count" in note
        )  # where a thousand steps a second are kept, it is more than undeclared outputs may be told
    assert "declared 20: told that often" in note
    values = [told.get(timeout=60)]
    while "slow" in values[-1] and len(values) < 2000:  # on a busy machine it may step as seldom as it may tell
        values.append(told.get(timeout=60))
    assert "count" in values[-1] and "slow" not in values[-1], "whatever was written was told"
    slow = [value["slow"] for value in values if "slow" in value]
    assert slow == sorted(slow)


def test_a_node_that_steps_on_and_on_rests_until_it_has_its_share(node):
    notes: queue.SimpleQueue[str] = queue.SimpleQueue()
    process = node("every = 0.0; cpu_share = 0.3", noted=notes.put)
    process.put({"what": "work"})
    assert "its share is 30 %" in notes.get(timeout=60)


def test_lines_that_nobody_could_read_are_left_out_and_counted(node):
    lines: queue.SimpleQueue[str] = queue.SimpleQueue()
    node(said=lines.put).step({"what": "print"})
    said = [lines.get(timeout=60)]
    while "left out" not in said[-1]:
        said.append(lines.get(timeout=1) if not lines.empty() else lines.get(timeout=60))
        if len(said) == LINES_A_SECOND:
            break
    assert said[:2] == ["line 0", "line 1"] and len(said) <= LINES_A_SECOND


@pytest.mark.parametrize(
    ("what", "more", "words"),
    [
        ("spin", "cpu_share = 0.01; nice = 0", "of a core over 0.5 s, allowed 1 %"),
        ("share", "memory_mb = 100", "MB of memory of its own, allowed 100 MB"),
    ],
)
def test_what_the_node_can_not_be_slowed_down_in_is_ended(node, what, more, words):
    ended: queue.SimpleQueue[NodeFailed] = queue.SimpleQueue()
    process = node(more, ended=ended.put, window_s=0.5, restarts=0)
    process.put({"what": what})
    with contextlib.suppress(NodeFailed):  # while it is in its step
        process.step()
    why = ended.get(timeout=60).why
    assert words in why and why.endswith("and was killed")


def test_nodes_share_what_they_import_and_the_warm_process_has_one_thread(node):
    process = node()
    process.step({"what": "count"})
    own_mb, share_mb = usage.memory_mb(process.process.pid)
    assert 0.5 < own_mb <= 20.0, "of its own, beyond what it was forked with"
    assert share_mb < usage.resident_mb(process.process.pid)
    assert len(os.listdir(f"/proc/{LAUNCHER.warm_process}/task")) == 1


def test_when_the_warm_process_is_killed_its_nodes_end_and_are_started_anew_from_another(node):
    ended: queue.SimpleQueue[NodeFailed] = queue.SimpleQueue()
    told: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
    process = node("every = 0.05", ended=ended.put, told=told.put, restarts=2)
    process.put({"what": "count"})
    told.get(timeout=60)
    before = LAUNCHER.warm_process
    assert before is not None
    os.kill(before, signal.SIGKILL)
    assert "SIGKILL" in ended.get(timeout=60).why
    while told.get(timeout=60).get("count") != 1:
        pass
    assert LAUNCHER.warm_process not in (None, before)


def test_a_node_that_can_not_come_up_again_is_tried_as_often_as_it_may_and_then_left(node, tmp_path):
    ended: queue.SimpleQueue[NodeFailed] = queue.SimpleQueue()
    notes: queue.SimpleQueue[str] = queue.SimpleQueue()
    process = node("restarts = 2", ended=ended.put, noted=notes.put)
    (tmp_path / "busy.py").write_text("raise ImportError('gone')")
    process.process.kill()
    whys = [ended.get(timeout=60).why for _ in range(3)]
    assert "SIGKILL" in whys[0] and whys[1:] == ["node busy: ImportError: gone"] * 2
    assert "is started anew in 0.2 s (1 of 2 times)" in notes.get(timeout=60)
    assert "is started anew in 0.4 s (2 of 2 times)" in notes.get(timeout=60)
    with pytest.raises(NodeFailed, match="gone"):
        process.step({"what": "count"})
