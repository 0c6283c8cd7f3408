"""`do: node`: a program goes on with what a node finds; a node that fails is the program's to answer, and a stop ends it."""

from __future__ import annotations

import pytest

from engines.programs import program
from handrail import messages as m
from handrail.config import ConfigError

NODE = """\
from engines.nodes import Input, Node, Output, Param

class Scale(Node):
    '''A number and its list, times something.'''
    value, tail = Input("number"), Input("numbers")
    result, all = Output("number"), Output("numbers")
    times = Param(2.0)
    {more}

    def step(self):
        if self.value < 0:
            raise ArithmeticError("less than nothing")
        while self.value > 100:
            pass
        self.result, self.all = self.times * self.value, self.times * self.tail
"""
PROGRAM = """\
title: Scale
resources:
  arm: {kind: arm}
parameters: {begin: {default: 3.0}}
variables: {result: 0.0, all: "", why: ""}
states:
  scaling:
    do: node
    with: {node: scale, inputs: {value: begin + 1, tail: [begin, 7]}, params: {times: 10.0}, outputs: [result, all]}
    transitions:
      - {event: done.invoke.scaling, target: good, set: {result: _event.data.result, all: _event.data.all}}
      - {event: error.execution, target: failed, set: {why: failure}}
  good: {final: true, outcome: succeeded, detail: "{result}"}
  failed: {final: true, outcome: failed, detail: "{why}"}
"""


@pytest.fixture
def library(tmp_path, monkeypatch):
    """A workspace; returns a function that writes the program and its node."""
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    for folder in ("nodes", "rtc_programs"):
        (tmp_path / folder).mkdir()

    def write(more: str = "") -> None:
        (tmp_path / "nodes" / "scale.py").write_text(NODE.format(more=more))
        (tmp_path / "rtc_programs" / "scale.yaml").write_text(PROGRAM)

    write()
    return write


@pytest.mark.parametrize("more", ["", "every = 0.01"], ids=["one step", "steps by itself"])
def test_a_state_gives_inputs_from_expressions_and_goes_on_with_the_outputs(stack, library, more):
    library(more)
    stack.run("scale")
    end = stack.ended()
    assert (end.status, end.detail) == ("succeeded", "40.0")
    assert end.data["all"] == [30.0, 70.0]


def test_a_node_that_raises_is_the_programs_to_answer_and_its_traceback_is_told(stack, library):
    stack.run("scale", begin=-5.0)
    end = stack.ended()
    assert end.status == "failed" and "node scale: ArithmeticError: less than nothing" in end.detail
    told = stack.wait(lambda e: isinstance(e, m.LogLine) and "in step" in e.text)
    assert (told.level, told.source) == ("error", "engine/scale")


def test_a_run_that_is_stopped_ends_a_node_in_an_endless_step(stack, library):
    library("step_limit_s = 600.0")
    run = stack.run("scale", begin=200.0)
    stack.wait(lambda e: isinstance(e, m.RunState) and e.run == run.run and e.active == ["scaling"])
    stack.call(m.StopRun())
    assert stack.ended().status == "stopped"


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("node: scale,", "node: scall,", r"scale.yaml:9: states.scaling.with.node: got 'scall'; expected one of beyond, "),
        ("value: begin + 1", "value: begun + 1", r"with.inputs.value.*begun"),
        ("outputs: [result, all]", "outputs: [all]", r"_event.data has no 'result' here; expected one of all"),
        (", outputs: [result, all]", "", r"with.outputs: missing; node needs it"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_call_is_found_before_anything_runs(library, tmp_path, old, new, told):
    assert old in PROGRAM
    file = tmp_path / "rtc_programs" / "scale.yaml"
    file.write_text(PROGRAM.replace(old, new))
    with pytest.raises(ConfigError, match=told):
        program.read(file)
