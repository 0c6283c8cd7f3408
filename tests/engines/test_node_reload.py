"""Hot reload: a node goes on in the file as it is now, between two calls, or as it was where that can't be."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from engines.nodes.host import NodeFailed, NodeProcess

NODE = """\
from engines.nodes import Input, Node, Output, Param

class Scale(Node):
    '''Times what comes.'''
    value = Input("number")
    result = Output("number")
    times = Param(2.0, high=100.0)
    offset = Param(0.0)

    def step(self):
        self.result = self.times * self.value + self.offset
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    found = tmp_path / "scale.py"
    found.write_text(NODE)
    return found


@pytest.fixture
def node(file: Path) -> Iterator[Callable[..., NodeProcess]]:
    running: list[NodeProcess] = []

    def start(**arguments: Any) -> NodeProcess:
        running.append(NodeProcess(file, restarts=0, **arguments))
        return running[-1]

    yield start
    for each in running:
        each.close()


def test_a_new_version_takes_over_with_the_parameters_and_inputs_that_it_still_has(node, file):
    notes: list[str] = []
    process = node(noted=notes.append)
    assert process.step({"value": 3.0}, {"times": 10.0, "offset": 1.0}) == {"result": 31.0}
    assert not process.reload() and not notes
    before = process.process
    file.write_text(NODE.replace("offset = Param(0.0)", "").replace("+ self.offset", "+ 0.5"))
    assert process.reload()
    assert process.step() == {"result": 30.5}
    assert before.poll() == 0 and process.process.pid != before.pid
    assert "it has no offset of that kind any more" in notes[0]


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("class", "clas", "SyntaxError"),
        ("high=100.0", "high=5.0", "parameter times: got 10; expected -inf to 5"),
        ("def step", "def start(self): raise OSError('no camera')\n    def step", "OSError: no camera"),
    ],
)
def test_a_new_version_that_can_not_run_leaves_the_node_in_the_one_that_it_had(node, file, old, new, why):
    notes: list[str] = []
    process = node(noted=notes.append)
    process.step({"value": 3.0}, {"times": 10.0})
    file.write_text(NODE.replace(old, new))
    with pytest.raises(NodeFailed, match=why):
        process.reload()
    assert notes[0].startswith("goes on in the version that it had: ") and why in notes[0]
    assert process.step() == {"result": 30.0}
    assert not process.reload(), "it was tried once"
    file.write_text(NODE.replace("+ self.offset", "- 1"))
    assert process.reload() and process.step() == {"result": 29.0}


def test_calls_while_a_version_takes_over_are_all_answered_by_one_or_the_other(node, file):
    process = node()
    answers: queue.SimpleQueue[float] = queue.SimpleQueue()
    enough = threading.Event()

    def ask() -> None:
        while not enough.is_set():
            answers.put(process.step({"value": 1.0})["result"])

    asking = threading.Thread(target=ask)
    asking.start()
    try:
        assert answers.get(timeout=60) == 2.0
        file.write_text(NODE.replace("times = Param(2.0", "times = Param(7.0"))
        assert process.reload()
        seen = [answers.get(timeout=60)]
        while seen[-1] != 7.0:
            seen.append(answers.get(timeout=60))
        assert set(seen) <= {2.0, 7.0}
    finally:
        enough.set()
        asking.join()


def test_a_node_that_has_ended_begins_anew_in_a_new_version(node, file):
    ended = threading.Event()
    process = node(ended=lambda failure: ended.set())
    process.process.kill()
    assert ended.wait(60)
    with pytest.raises(NodeFailed, match="SIGKILL"):
        process.step({"value": 1.0})
    file.write_text(NODE + "# corrected")
    assert process.reload() and process.step({"value": 1.0}) == {"result": 2.0}
