"""Process nodes: ports that take what they say, steps, clocks; whatever a node's code does ends the node alone, with the reason."""

from __future__ import annotations

import os
import queue
import signal
import socket
import sys
import textwrap
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from engines.nodes import Case, Input, Node, Output, Param, cli, composite, library
from engines.nodes.host import NodeFailed, NodeProcess
from engines.nodes.launcher import LAUNCHER
from engines.nodes.node import load
from engines.nodes.ports import PortError
from engines.nodes.wire import Beat, FromNode, Wire
from handrail.messages import Pose

NODE = """\
import os, time
from engines.nodes import Case, Input, Node, Output, Param

class Doubler(Node):
    '''Twice what comes.'''
    {more}
    what = Input("text")
    cloud = Input("cloud")
    twice = Output("text")
    centre = Output("numbers")
    times = Param(2, low=1, high=9)
    cases = [Case(name="two", inputs=[{{"what": "ab"}}], outputs={{"twice": "abab"}}),
             Case(name="wrong", inputs=[{{"what": "ab"}}], outputs={{"twice": "ab"}})]

    def step(self):
        print("a node may print")
        what = self.what
        if what == "points":
            self.centre = self.cloud.mean(axis=0)
        elif what == "raise":
            raise RuntimeError("no such thing")
        elif what == "hang":
            while True:
                pass
        elif what == "crash":
            os.abort()
        elif what == "leave":
            os._exit(3)
        elif what == "flood":
            self.twice = "x" * 2_000_000_000
        else:
            self.twice = what * self.times
"""


@pytest.fixture
def node(tmp_path: Path) -> Iterator[Callable[..., NodeProcess]]:
    """Starts nodes: `more` are lines of the class, the rest goes to NodeProcess."""
    running: list[NodeProcess] = []

    def start(more: str = "step_limit_s = 60.0", **arguments: Any) -> NodeProcess:
        file = tmp_path / "doubler.py"
        file.write_text(textwrap.dedent(NODE.format(more=more)))
        running.append(NodeProcess(file, **arguments))
        return running[-1]

    yield start
    for each in running:
        each.close()
        assert each.process.poll() is not None, "no process is left behind"


def test_a_step_gives_what_was_written_and_remembers_inputs_and_parameters(node):
    process = node()
    assert process.step({"what": "ab"}) == {"twice": "abab"}
    assert process.step(params={"times": 3}) == {"twice": "ababab"}
    points = np.arange(300_000.0).reshape(-1, 3)
    assert process.step({"what": "points", "cloud": points})["centre"] == pytest.approx(points.mean(axis=0))
    assert {port.name: port.kind for port in process.hello.inputs} == {"what": "text", "cloud": "cloud"}
    assert process.hello.doc == "Twice what comes."


def test_what_does_not_fit_is_declined_by_name_and_the_node_goes_on(node):
    process = node()
    for inputs, params, words in (
        ({"what": 3}, {}, "input what: got 3; expected a text"),
        ({"cloud": [[1, 2]]}, {}, "input cloud: got [[1, 2]]; expected points (n, 3) m, finite"),
        ({"who": "x"}, {}, "input who: there is none; expected one of what, cloud"),
        ({}, {"times": 10}, "parameter times: got 10; expected 1 to 9"),
        ({}, {"speed": 1}, "parameter speed: there is none; expected one of times"),
        ({}, {}, "input what: nothing has come yet"),
    ):
        with pytest.raises(NodeFailed) as caught:
            process.step(inputs, params)
        assert words in caught.value.why
    assert process.step({"what": "still there"}) == {"twice": "still there" * 2}


@pytest.mark.parametrize(
    ("what", "words"),
    [
        ("raise", "RuntimeError: no such thing"),
        ("crash", "was ended by SIGABRT"),
        ("leave", "ended with status 3"),
        ("flood", "MemoryError"),
    ],
)
def test_code_that_fails_ends_the_node_with_the_reason(node, what, words):
    process = node()
    with pytest.raises(NodeFailed) as caught:
        process.step({"what": what})
    assert words in caught.value.why
    assert ("in step" in caught.value.traceback) == (what in ("raise", "flood"))
    with pytest.raises(NodeFailed, match=words.split(":")[0]):
        process.step({"what": "more"})


def test_an_endless_step_is_ended_and_said_so(node):
    process = node(more="step_limit_s = 0.5")
    with pytest.raises(NodeFailed, match=r"has been in one step for \d.* s, allowed 0.5 s, and was killed"):
        process.step({"what": "hang"})


def test_a_node_that_gives_no_sign_of_life_is_killed(node):
    ended: queue.SimpleQueue[NodeFailed] = queue.SimpleQueue()
    process = node(ended=ended.put, silent_s=1.0)
    os.kill(process.process.pid, signal.SIGSTOP)
    assert "gave no sign of life for 1 s" in ended.get(timeout=60).why


def test_a_node_that_failed_is_started_again_as_often_as_it_may_with_its_inputs(node):
    ended: queue.SimpleQueue[NodeFailed] = queue.SimpleQueue()
    told: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
    process = node(more="every = 0.05", ended=ended.put, told=told.put, restarts=1)
    process.put({"what": "ab"})
    assert told.get(timeout=60) == {"twice": "abab"}
    os.kill(process.process.pid, signal.SIGKILL)
    assert "SIGKILL" in ended.get(timeout=60).why
    while not told.empty():
        told.get()
    assert told.get(timeout=60) == {"twice": "abab"}, "by itself, in a new process"
    os.kill(process.process.pid, signal.SIGKILL)
    ended.get(timeout=60)
    with pytest.raises(NodeFailed, match="SIGKILL"):
        process.put({"what": "cd"})


def test_a_node_that_can_not_be_loaded_or_started_says_why(tmp_path, node):
    for text, words in (
        ("x = 1", "got the nodes none; expected one subclass"),
        ("import nothing_like_that", "nothing_like_that"),
        ("from engines.nodes import Node, Input\nclass A(Node):\n    x = Input('colour')", "got kind 'colour'; expected"),
    ):  # fmt: skip
        file = tmp_path / "odd.py"
        file.write_text(text)
        with pytest.raises(NodeFailed, match=words):
            NodeProcess(file)
    with pytest.raises(NodeFailed, match="parameter times: got 12; expected 1 to 9"):
        node(params={"times": 12})


@pytest.mark.parametrize(
    ("kind", "good", "bad"),
    [
        ("number", 2, [True, "2", float("nan"), None]),
        ("integer", 2, [True, 2.5]),
        ("flag", True, [1]),
        ("joints", {"a": 1.0}, [{"a": "x"}, {1: 2.0}, [1.0]]),
        ("pose", {"position": (1, 2, 3)}, [{"orientation": (0, 0, 0, 2)}, {"place": 1}, Pose(position=(float("inf"), 0, 0))]),
        ("wrench", [1, 2, 3, 4, 5, 6], [[1, 2, 3], ["a"] * 6, [float("inf")] * 6]),
        ("array", np.eye(2, dtype=np.int16), [["a"], {"shape": [2], "dtype": "<f8", "data": b"123"}]),
    ],
)  # fmt: skip
def test_a_port_takes_its_kind_over_the_wire_and_nothing_else(kind, good, bad):
    port = Input(kind)
    port.name = "x"
    value = port.taken(good)
    again = port.taken(port.kind.pack(value))
    assert np.array_equal(again, value) if isinstance(value, np.ndarray) else again == value
    for wrong in bad:
        with pytest.raises(PortError, match="input x: got"):
            port.taken(wrong)


def test_a_node_is_tested_without_a_process(tmp_path):
    class Sum(Node):
        a, b = Input("number"), Input("number")
        out = Output("number")
        gain = Param(1.0, choices=(), low=0.0)

        def step(self):
            self.out = self.gain * (self.a + self.b)

    node = Sum()
    node.put("inputs", {"a": 1, "b": 2})
    node.step()
    assert (node.out, node.take_written(), node.take_written()) == (3.0, {"out": 3.0}, {})
    case = Case(inputs=[], outputs={"out": 3.1}, tolerance=0.05)
    assert "got 3.0; expected 3.1" in case.missed(Sum.outputs["out"], node.out)


def test_every_node_of_the_library_keeps_its_own_cases(monkeypatch):
    monkeypatch.delenv("HANDRAIL_WORKSPACE", raising=False)
    assert "low_pass" in library.files()
    for file in library.files().values():
        assert (composite.read(file) if file.suffix == ".yaml" else load(file)).__doc__
        tried = CliRunner().invoke(cli.app, ["test", str(file)])
        assert tried.exit_code == 0, tried.output


def test_the_command_tries_cases_and_runs_nodes_of_a_workspace(tmp_path, monkeypatch):
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    (tmp_path / "nodes").mkdir()
    (tmp_path / "nodes" / "doubler.py").write_text(NODE.format(more="every = 0.01"))
    runner = CliRunner()

    def handrail(*words: str):
        return runner.invoke(cli.app, list(words))

    assert "doubler" in handrail("list").output
    tried = handrail("test", "doubler")
    assert tried.exit_code == 1
    assert "passed  two" in tried.output and "failed  wrong: output twice: got abab; expected ab" in tried.output
    ran = handrail("run", "doubler", "--input", "what=ab", "--set", "times=3", "--steps", "2")
    assert ran.exit_code == 0 and ran.output.count('{"twice": "ababab"}') == 2
    failed = handrail("run", "doubler", "--input", "what=raise")
    assert failed.exit_code == 1 and "no such thing" in failed.output
    assert "expected one of beyond, contact, doubler, low_pass" in handrail("show", "nothing").output


@pytest.fixture
def endless(tmp_path: Path) -> Path:
    """A node whose file never ends when it is imported."""
    file = tmp_path / "endless.py"
    file.write_text("while True:\n    pass\n")
    return file


def test_a_node_that_never_ends_its_import_does_not_outlive_its_host(endless):
    ours, theirs = socket.socketpair()
    process = LAUNCHER.start(endless, theirs, sys.stderr.fileno())
    try:
        theirs.close()
        assert isinstance(Wire(ours, FromNode).receive(60), Beat)
        ours.close()
        assert process.wait(60) == 1
    finally:
        process.kill()
        process.wait()


def test_a_node_that_nobody_wants_any_more_while_it_is_loaded_is_killed_at_once(endless):
    closing = threading.Event()
    closing.set()
    with pytest.raises(NodeFailed, match="was not wanted any more, and was killed"):
        NodeProcess(endless, closing=closing)


def test_a_nodes_file_may_have_dataclasses_whose_annotations_are_looked_up_later(tmp_path):
    file = tmp_path / "held.py"
    file.write_text(
        "from __future__ import annotations\n"
        "from dataclasses import dataclass\n"
        "from engines.nodes import Node\n"
        "@dataclass\nclass Held:\n    force: float = 2.0\n"
        "class Keeps(Node):\n    held = Held()\n"
    )
    assert load(file).held.force == 2.0
