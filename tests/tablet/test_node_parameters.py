"""Parameters of nodes that run: set while they do, the latest value, one call at a time; in the window by a slider."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from handrail.messages import (
    GetNodeSource,
    ListNodes,
    NodeEntry,
    NodeLibrary,
    NodePort,
    Nodes,
    NodeSource,
    NodeState,
    PutNode,
)
from tablet_client.models.code import Code
from tablet_client.models.node_parameters import NodeParameters
from tests.tablet.shown import judge

PORTS = [
    NodePort(name="force", way="output", kind="number", unit="N"),
    NodePort(
        name="cutoff", way="parameter", kind="number", unit="Hz", value=2.0, low=0.5, high=10.0, doc="damped above"
    ),
    NodePort(name="order", way="parameter", kind="integer", value=1, low=1, high=4),
    NodePort(name="how", way="parameter", kind="text", value="fast", choices=["fast", "well"]),
]
STATE = NodeState(
    name="smooth", node="low_pass", state="up", process=1, restarts=0, cpu_share=0.0, memory_mb=1.0, every=None,
    ports=PORTS,
)  # fmt: skip


def with_values(state: NodeState, values: dict[str, Any]) -> NodeState:
    ports = [msgspec.structs.replace(port, value=values.get(port.name, port.value)) for port in state.ports]
    return msgspec.structs.replace(state, ports=ports)


@pytest.fixture
def parameters() -> NodeParameters:
    code = Code()
    code.open("node", "low_pass")
    (call,) = code.want()
    code.take(call, NodeSource(node="low_pass", file="low_pass.py", text="", builtin=True))
    code.running = [STATE, msgspec.structs.replace(STATE, name="other", node="another")]
    return NodeParameters(code)


def values(parameters: NodeParameters) -> dict[str, Any]:
    return {each.given.parameter.name: each.given.value for each in parameters.all()}


def test_those_of_the_document_that_is_open_are_shown_and_the_newest_value_is_sent_once_the_one_before_is_there(
    parameters,
):
    assert values(parameters) == {"cutoff": 2.0, "order": 1, "how": "fast"}
    assert {each.node for each in parameters.all()} == {"smooth"}
    parameters.put("smooth", "cutoff", 3.0)
    (first,) = parameters.want()
    assert first == PutNode(name="smooth", params={"cutoff": 3.0})
    for value in (4.0, 5.0):
        parameters.put("smooth", "cutoff", value)
    parameters.put("smooth", "order", 3.0)
    assert list(parameters.want()) == [] and values(parameters) == {"cutoff": 5.0, "order": 3, "how": "fast"}
    parameters.take(first, with_values(STATE, {"cutoff": 3.0}))
    (second,) = parameters.want()
    assert second.params == {"cutoff": 5.0, "order": 3}
    parameters.take(second, with_values(STATE, second.params))
    assert list(parameters.want()) == [] and values(parameters)["cutoff"] == 5.0


def test_what_its_node_would_decline_is_not_sent_and_what_it_declines_is_said(parameters):
    for name, value, said in (
        ("cutoff", 11.0, "cutoff: got 11.0; expected 0.5 … 10 Hz"),
        ("order", 2.5, "order: got 2.5; expected 1 … 4"),
        ("how", "badly", "how: got 'badly'; expected fast, well"),
    ):
        parameters.put("smooth", name, value)
        assert parameters.problem == said and list(parameters.want()) == []
    parameters.put("smooth", "cutoff", 3.0)
    assert parameters.problem == ""
    (call,) = parameters.want()
    assert parameters.failed(call, "node smooth has ended") and parameters.problem == "node smooth has ended"
    assert values(parameters)["cutoff"] == 2.0 and list(parameters.want()) == []
    assert not parameters.failed(call, "anything")


@pytest.mark.window
def test_by_a_slider_and_a_choice_a_node_that_runs_is_set(robot: Any, show: Any) -> None:
    answer = robot.answer
    robot.nodes = Nodes(nodes=[STATE])

    def answers(call: Any) -> Any:
        if isinstance(call, ListNodes):
            return NodeLibrary(nodes=[NodeEntry(name="low_pass", file="low_pass.py", builtin=True)])
        if isinstance(call, GetNodeSource):
            return NodeSource(node="low_pass", file="low_pass.py", text="# a node\n", builtin=True)
        if isinstance(call, PutNode):
            robot.nodes = Nodes(nodes=[with_values(robot.nodes.nodes[0], call.params)])
            return robot.nodes.nodes[0]
        return answer(call)

    robot.answer = answers
    shown = show()
    shown.press("tab_code")
    shown.until(lambda: shown.there("code_node_low_pass"))
    shown.press("code_node_low_pass")
    shown.press("tuneCode")
    shown.until(lambda: shown.there("running_smooth_cutoff"))
    shown._settle("running_smooth_cutoff")
    slider = shown.item("running_smooth_cutoff")
    spot = shown.middle("running_smooth_cutoff")
    with shown.finger(spot) as finger:
        finger.to(spot + spot.__class__(slider.width() // 4, 0))
    now = lambda: {port.name: port.value for port in robot.nodes.nodes[0].ports}  # noqa: E731
    shown.until(lambda: now()["cutoff"] > 6.0)
    shown.press("running_smooth_how_well")
    shown.until(lambda: now()["how"] == "well")
    shown.until(lambda: slider.property("value") == now()["cutoff"])
    judge(shown, (1024, 640))
    assert not robot.stopped
