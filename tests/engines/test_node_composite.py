"""Composite nodes: wired in a file, checked at load, run as one node."""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from engines.nodes import cli, composite, library
from engines.nodes.host import NodeFailed, NodeProcess
from engines.nodes.node import Node
from engines.releases.closure import bundle_of
from handrail import workspace
from handrail.bundles import manifest
from handrail.config import ConfigError

ADD = """\
from engines.nodes import Input, Node, Output, Param

class Add(Node):
    '''Adds.'''
    a, b = Input("number", unit="N"), Input("number")
    total = Output("number", unit="N")
    more = Param(0.0, low=-5.0, high=5.0)

    def step(self):
        if self.a > 100:
            raise ArithmeticError("too much")
        self.total = self.a + self.b + self.more
"""
COUNT = """\
from engines.nodes import Input, Node, Output

class Count(Node):
    text = Input("text")
    length = Output("integer")

    def step(self):
        self.length = len(self.text)
"""
GOOD = """\
title: Adds three things
nodes:
  last: {node: add, params: {more: 1.0}}
  first: {node: add}
  letters: {node: count}
inputs:
  a: [first.a]
  word: letters.text
  c: last.b
wires:
  last.a: first.total
  first.b: letters.length
params:
  more: last.more
outputs:
  sum: last.total
  part: first.total
cases:
  - {inputs: [{a: 1.0, word: xyz, c: 10.0}], outputs: {sum: 15.0, part: 4.0}}
"""
PROGRAM = """\
title: Add
states:
  adding:
    do: node
    with: {node: three, inputs: {a: "1", word: "'xyz'", c: "10"}, outputs: [sum]}
    transitions: [{event: done.invoke.adding, target: good}, {event: error.execution, target: bad}]
  good: {final: true, outcome: succeeded}
  bad: {final: true, outcome: failed}
"""


@pytest.fixture
def nodes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """Writes a composite of this workspace: the good one with `old` as `new`."""
    folder = tmp_path / "nodes"
    folder.mkdir()
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    (folder / "add.py").write_text(ADD)
    (folder / "count.py").write_text(COUNT)

    def write(old: str = "", new: str = "", name: str = "three", text: str = GOOD) -> Path:
        assert old in text
        file = folder / f"{name}.yaml"
        file.write_text(textwrap.dedent(text.replace(old, new)))
        return file

    return write


def stepped(kind: type[Node], inputs: dict[str, Any], params: dict[str, Any] | None = None) -> dict[str, Any]:
    node = kind()
    node.put("params", params or {})
    node.start()
    node.put("inputs", inputs)
    node.step()
    return node.take_written()


def test_parts_step_in_the_order_of_their_wires_and_own_ports_are_theirs(nodes):
    kind = composite.read(nodes())
    assert (kind.__doc__, list(kind.parts)) == ("Adds three things", ["letters", "first", "last"])
    assert (kind.inputs["a"].unit, kind.params["more"].default, kind.params["more"].high) == ("N", 1.0, 5.0)
    assert stepped(kind, {"a": 1.0, "word": "xyz", "c": 10.0}) == {"sum": 15.0, "part": 4.0}
    assert stepped(kind, {"a": 1.0, "word": "xyz", "c": 10.0}, {"more": 2.0})["sum"] == 16.0


def test_it_is_one_node_in_one_process_found_by_its_name(nodes):
    nodes()
    nodes(
        name="twice", text="nodes: {x: {node: three}}\ninputs: {a: x.a, word: x.word, c: x.c}\noutputs: {sum: x.sum}\n"
    )
    with NodeProcess(library.find("twice"), restarts=0) as process:
        assert process.step({"a": 1, "word": "xyz", "c": 10.0}) == {"sum": 15.0}
        assert [port.kind for port in process.hello.inputs] == ["number", "text", "number"]
        with pytest.raises(NodeFailed, match=r"ArithmeticError: too much \(in part first\) \(in part x\)"):
            process.step({"a": 101.0})
    runner = CliRunner()
    assert "three" in runner.invoke(cli.app, ["list"]).output
    tried = runner.invoke(cli.app, ["test", "three"])
    assert (tried.exit_code, "passed  case 1" in tried.output) == (0, True), tried.output


def test_an_input_that_has_not_come_is_told_with_its_part(nodes):
    with NodeProcess(nodes(), restarts=0) as process:
        with pytest.raises(NodeFailed, match="part first: input a: nothing has come yet"):
            process.step({"word": "xyz"})
        assert process.step({"a": 1.0, "c": 0.0})["part"] == 4.0


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("node: count", "node: coint", r"three.yaml:5: nodes.letters.node: got 'coint'; expected one of add, "),
        ("node: count", "node: three", r"three.yaml:5: nodes.letters.node: is a part of itself: three → three"),
        ("more: 1.0", "more: 9.0", r"three.yaml:3: nodes.last.params: parameter more: got 9; expected -5 to 5"),
        ("first.total\n  first", "first.sum\n  first", r":11: wires.last.a: got 'first.sum': no such output; expected one of"),
        ("first.b: letters.length", "letters.text: first.total", r":12: wires.*: letters.text gets its value from inputs.word"),
        ("  word: letters.text\n", "", r"three.yaml:5: nodes.letters: its input text gets nothing"),
        ("a: [first.a]", "a: [first.a, letters.text]", r"three.yaml:7: inputs.a: letters.text takes text, first.a is number"),
        ("  a: [first.a]", "  a: []", r"three.yaml:7: inputs.a: goes nowhere"),
        ("sum: last.total", "a: last.total", r"three.yaml:16: outputs.a: got 'a'; expected a name that no other port"),
        ("  c: last.b\nwires:", "wires:\n  last.b: last.total", r":10: wires.last.b: goes round in circles: last → last"),
        ("  first.b: letters.length", "  first.b: last.total", r":1[12]: wires.*: goes round in circles: .*first → last"),
        ("more: last.more", "more: last.less", r"no such parameter; expected one of last.more"),
        ("sum: last.total", "step: last.total", r"a port can't be called 'step'"),
        ("title:", "titel:", r"three.yaml:1: titel"),
    ],
)  # fmt: skip
def test_what_does_not_fit_together_is_told_with_file_and_line(nodes, old, new, told):
    with pytest.raises(ConfigError, match=told):
        composite.read(nodes(old, new))


def test_a_program_takes_along_what_its_composite_is_made_of_and_finds_it_where_it_was_deployed(
    nodes, tmp_path, monkeypatch
):
    nodes()
    (tmp_path / "nodes" / "count.py").write_text("import words\n" + COUNT)
    (tmp_path / "nodes" / "words.py").write_text("")
    (tmp_path / "rtc_programs").mkdir()
    (tmp_path / "rtc_programs" / "adding.yaml").write_text(PROGRAM)
    bundle = bundle_of("adding")
    assert {"nodes/three.yaml", "nodes/add.py", "nodes/count.py", "nodes/words.py"} <= bundle.manifest.files.keys()
    there = tmp_path / "deployed"
    manifest.write(bundle.manifest, bundle.contents.get, there)
    monkeypatch.delenv("HANDRAIL_WORKSPACE")
    with workspace.pinned(there), NodeProcess(library.find("three"), restarts=0) as process:
        assert process.step({"a": 1, "word": "xyz", "c": 10.0})["sum"] == 15.0
