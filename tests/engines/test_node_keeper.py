"""The nodes that an engine runs: started beside the program or by its states, and watched port by port."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from engines.nodes.host import NodeFailed
from engines.nodes.keeper import NodeKeeper
from handrail import messages as m

NODE = """\
import numpy as np
from engines.nodes import Input, Node, Output, Param

class Sum(Node):
    '''Adds up what comes.'''
    {more}
    value = Input("number", unit="N")
    total, picture = Output("number", unit="N"), Output("array")
    times = Param(1.0)

    def start(self):
        self._total = 0.0

    def step(self):
        if self.value < 0:
            raise ArithmeticError("less than nothing")
        self._total += self.times * self.value
        self.total = self._total
        self.picture = np.full((4, 50), self._total)
"""
PROGRAM = """\
title: Add
resources:
  arm: {kind: arm}
parameters: {begin: {default: 3.0}}
variables: {first: 0.0, second: 0.0}
states:
  one:
    do: node
    with: {node: sum, inputs: {value: begin}, outputs: [total], lives: LIVES}
    transitions:
      - {event: done.invoke.one, target: two, set: {first: _event.data.total}}
      - {event: error.execution, target: bad}
  two:
    do: node
    with: {node: sum, inputs: {value: begin}, outputs: [total], params: {times: 10.0}, lives: LIVES}
    transitions:
      - {event: done.invoke.two, target: good, set: {second: _event.data.total}}
      - {event: error.execution, target: bad}
  good: {final: true, outcome: succeeded, detail: "{first} {second}"}
  bad: {final: true, outcome: failed}
"""


@pytest.fixture
def own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for folder in ("nodes", "rtc_programs"):
        (tmp_path / folder).mkdir()
    (tmp_path / "nodes" / "sum.py").write_text(NODE.format(more=""))
    (tmp_path / "nodes" / "sums.py").write_text(NODE.format(more="every = 0.01"))
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    return tmp_path


class Told:
    """What a keeper publishes and says."""

    def __init__(self) -> None:
        self.events: list[Any] = []
        self.lines: list[tuple[str, str]] = []
        self.keeper = NodeKeeper(
            self.events.append, lambda level, text, node: self.lines.append((level, f"{node}: {text}"))
        )

    def of(self, port: str) -> list[Any]:
        return [event.value for event in self.events if event.port == port]


@pytest.fixture
def told(own: Path) -> Iterator[Told]:
    found = Told()
    yield found
    found.keeper.close()


def test_a_node_that_was_started_is_told_with_its_ports_and_newest_values(told):
    keeper = told.keeper
    keeper.start("sum", "adder", {"times": 2.0}).step({"value": 4.0})
    (state,) = keeper.states()
    assert (state.name, state.node, state.state, state.every) == ("adder", "sum", "up", None)
    ports = {port.name: (port.way, port.value, port.unit) for port in state.ports}
    assert ports["value"] == ("input", 4.0, "N") and ports["total"] == ("output", 8.0, "N")
    assert (ports["picture"][1], ports["times"][:2]) == (None, ("parameter", 2.0))
    with pytest.raises(ValueError, match="'adder' runs already"):
        keeper.start("sum", "adder")
    keeper.stop("adder")
    assert keeper.states() == []
    with pytest.raises(ValueError, match="got 'adder'; expected one of those that run: none"):
        keeper.stop("adder")


def test_a_node_that_is_stopped_while_it_is_loaded_does_not_come_up(told, own, wait_until):
    (own / "nodes" / "slow.py").write_text(
        f"import time\nopen({str(own / 'begun')!r}, 'w').close()\ntime.sleep(600)\n" + NODE.format(more="")
    )
    failed: list[NodeFailed] = []

    def start() -> None:
        try:
            told.keeper.start("slow")
        except NodeFailed as problem:
            failed.append(problem)

    starting = threading.Thread(target=start)
    starting.start()
    wait_until((own / "begun").exists)
    told.keeper.stop("slow")
    starting.join(30.0)
    assert [each.why for each in failed] == ["node slow was not wanted any more, and was killed"]
    assert told.keeper.states() == []


def test_a_port_is_told_while_it_is_watched_no_more_often_than_asked(told):
    keeper = told.keeper
    process = keeper.start("sum")
    process.step({"value": 1.0})
    assert told.events == []
    keeper.watch("sum", "total", rate=1e-2, lasts=60.0)
    keeper.watch("sum", "picture", rate=100.0, lasts=60.0)
    assert told.of("total") == [1.0], "the newest at once"
    process.step({"value": 1.0})
    assert told.of("total") == [1.0], "its turn has not come again"
    pictures = [event for event in told.events if event.port == "picture"]
    assert pictures[-1].value is None and pictures[-1].summary.startswith("float64 4 × 50, ")
    keeper.watch("sum", "value", rate=100.0, lasts=1e-9)
    told.events.clear()
    process.step({"value": 2.0})
    assert told.of("value") == [], "a watch that is over"


@pytest.mark.parametrize(
    ("name", "port", "words"),
    [("sum", "tottal", "sum has no 'tottal'; expected one of value, total"), ("som", "x", "got 'som'; expected one of")],
)  # fmt: skip
def test_what_can_not_be_watched_is_told(told, name, port, words):
    told.keeper.start("sum")
    with pytest.raises(ValueError, match=words):
        told.keeper.watch(name, port, 5.0, 10.0)


def test_a_node_that_does_not_run_yet_can_be_watched(told):
    told.keeper.watch("sum", "total", 100.0, 60.0)
    told.keeper.start("sum").step({"value": 3.0})
    assert told.of("total") == [3.0]


def test_a_watch_lasts_as_long_as_whoever_wants_it_longest(told):
    told.keeper.watch("sum", "total", rate=1e6, lasts=60.0)
    told.keeper.watch("sum", "total", rate=1e6, lasts=1e-9)
    told.keeper.start("sum").step({"value": 3.0})
    assert told.of("total") == [3.0]


def test_a_started_node_that_fails_is_said_and_shown_until_it_is_stopped(told):
    told.keeper.start("sum", params={}).put({"value": 1.0})
    process = told.keeper.process("sum")
    process._restarts = 0
    with pytest.raises(NodeFailed, match="less than nothing"):
        process.step({"value": -1.0})
    ended = threading.Event()
    while not (states := told.keeper.states()) or states[0].state != "ended":
        ended.wait(0.01)
    assert "less than nothing" in states[0].why and any(
        "in step" in text for level, text in told.lines if level == "error"
    )


def test_values_of_a_node_that_steps_by_itself_are_waited_for(told):
    process = told.keeper.start("sums")
    before = told.keeper.counts("sums")
    process.put({"value": 1.0})
    found = told.keeper.next_values(
        "sums", lambda now: now.get("total", 0) > before.get("total", 0) + 2, threading.Event()
    )
    assert found["total"] >= 3.0 and np.all(found["picture"] >= 3.0)
    cancelled = threading.Event()
    cancelled.set()
    with pytest.raises(NodeFailed, match="was cancelled"):
        told.keeper.next_values("sums", lambda now: False, cancelled)


@pytest.mark.parametrize(("lives", "detail"), [("state", "3.0 30.0"), ("run", "3.0 33.0")])
def test_a_node_lives_as_long_as_its_state_or_the_run(stack, own, lives, detail):
    (own / "rtc_programs" / "add.yaml").write_text(PROGRAM.replace("LIVES", lives))
    for _ in range(2):
        stack.run("add")
        end = stack.ended()
        assert (end.status, end.detail) == ("succeeded", detail), "and a new run begins anew"


def test_the_engine_starts_watches_and_stops_nodes_by_call(stack, own):
    started = stack.call(m.StartNode(node="sum", name="adder", inputs={"value": 1.0}))
    assert (started.name, started.state) == ("adder", "up")
    stack.call(m.WatchPort(name="adder", port="total", rate=50.0))
    stack.call(m.PutNode(name="adder", inputs={"value": 2.0}, step=True))
    event = stack.wait(lambda e: isinstance(e, m.PortValue))
    assert (event.name, event.port, event.value, event.count) == ("adder", "total", 2.0, 1)
    (own / "nodes" / "sum.py").write_text(NODE.format(more="").replace("+= self.times", "+= 100 * self.times"))
    stack.call(m.ReloadNode(name="adder"))
    state = stack.call(m.PutNode(name="adder", step=True))
    assert next(port.value for port in state.ports if port.name == "total") == 200.0
    for wrong, words in (
        (m.StartNode(node="som"), "expected one of beyond, contact, low_pass, statechart, sum"),
        (
            m.StartNode(node=str(own / "nodes" / "sum.py"), name="x"),
            "expected one of beyond, contact, low_pass, statechart, sum",
        ),
        (m.StartNode(node="sum", name="adder"), "'adder' runs already"),
        (
            m.StartNode(node="sum", name="other", inputs={"valu": 1.0}),
            "input valu: there is none; expected one of value",
        ),
        (m.PutNode(name="nobody"), "expected one of those that run: adder"),
        (m.PutNode(name="adder", inputs={"value": "x"}), "input value: got x; expected a finite number"),
    ):
        assert words in stack.refusal(wrong).message
    assert [node.name for node in stack.call(m.GetNodes()).nodes] == ["adder"]
    stack.call(m.StopNode(name="adder"))
    assert stack.call(m.GetNodes()).nodes == []
