"""A node and a program of your own, tested without an engine and without a robot: `pytest examples/test_my_node.py`."""

from engines.nodes import Input, Node, Output, Param
from engines.programs.on_paper import Played

PROGRAM = """
title: Press until it holds
resources: {arm: {kind: arm}}
variables: {tries: 0}
states:
  pressing:
    do: behave
    with: {behaviour: press, arm: arm}
    transitions: [{event: done.invoke.pressing, target: looking, set: {tries: tries + 1}}, {event: error.execution, target: bad}]
  looking:
    do: node
    with: {node: low_pass, inputs: {wrench: "[0, 0, 9, 0, 0, 0]", time: "0"}, outputs: [force]}
    transitions:
      - {event: done.invoke.looking, cond: _event.data.force > 5, target: good}
      - {event: done.invoke.looking, target: pressing}
      - {event: error.execution, target: bad}
  good: {final: true, outcome: succeeded, detail: "after {tries}"}
  bad: {final: true, outcome: failed}
"""


class Peak(Node):
    """The largest value so far, forgotten bit by bit."""

    value, peak = Input("number"), Output("number")
    keeps = Param(0.5, low=0.0, high=1.0)

    def start(self):
        self._peak = 0.0

    def step(self):
        self._peak = max(self.value, self.keeps * self._peak)
        self.peak = self._peak


def test_a_peak_is_kept_and_fades():
    node = Peak()
    node.start()
    found = []
    for value in (4.0, 1.0, 0.0):
        node.put("inputs", {"value": value})
        node.step()
        found.append(node.peak)
    assert found == [4.0, 2.0, 1.0]


def test_the_program_presses_again_until_the_node_finds_enough_force(tmp_path):
    file = tmp_path / "press_on.yaml"
    file.write_text(PROGRAM)
    forces = iter([1.0, 3.0, 8.0])
    played = Played(file, {"behave": lambda given: {}, "node": lambda given: {"force": next(forces)}}, arm="right")
    assert (played.outcome, played.detail) == ("succeeded", "after 3")
    assert played.visits == ["pressing", "looking"] * 3
    assert played.given[0] == ("pressing", {"behaviour": "press", "arm": "right"})
