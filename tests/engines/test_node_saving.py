"""Process nodes read, edited and saved over the link."""

from __future__ import annotations

import pytest

from handrail import messages as m

NODE = '''from engines.nodes import Input, Node, Output


class Double(Node):
    """Twice what comes."""

    value = Input("number")
    doubled = Output("number")

    def step(self):
        self.doubled = 2.0 * self.value
'''

WIRED = """nodes: {one: {node: double}, two: {node: double}}
inputs: {value: one.value}
wires: {two.value: one.doubled}
outputs: {doubled: two.doubled}
"""


def doubled(stack) -> float:
    state = stack.call(m.PutNode(name="double", inputs={"value": 4.0}, step=True))
    return next(port.value for port in state.ports if port.name == "doubled")


@pytest.fixture
def with_node(stack):
    stack.call(m.SaveNode(node="double", text=NODE, by="anna", note="new"))
    return stack


def test_a_node_is_written_saved_run_edited_and_reloaded(with_node):
    stack = with_node
    entries = {each.name: each for each in stack.call(m.ListNodes()).nodes}
    assert entries["low_pass"].builtin and not entries["double"].builtin
    stack.call(m.StartNode(node="double"))
    assert doubled(stack) == 8.0
    there = stack.call(m.GetNodeSource(node="double"))
    assert (there.file, there.text, there.builtin) == ("double.py", NODE, False)
    release = stack.call(
        m.SaveNode(node="double", text=there.text.replace("2.0", "3.0"), was=there.text, note="thrice")
    ).release
    assert (release.program, release.note, release.changed) == ("nodes/double", "thrice", ["nodes/double.py"])
    assert doubled(stack) == 8.0  # what runs goes on as it was
    stack.call(m.ReloadNode(name="double"))
    assert doubled(stack) == 12.0
    old = stack.refusal(m.SaveNode(node="double", text=NODE, was=there.text))
    assert "read it anew" in old.message
    stack.call(m.RollBack())
    assert stack.call(m.GetNodeSource(node="double")).text == NODE


def test_the_ports_of_a_node_of_the_library_are_told_with_their_bounds(with_node):
    told = with_node.call(m.GetNodePorts(node="low_pass"))
    assert told.title.startswith("First-order low pass") and told.every is None
    assert told.title.startswith("First-order low pass") and told.every is None
    cutoff = next(port for port in told.ports if port.name == "cutoff")
    assert (cutoff.way, cutoff.kind, cutoff.unit) == ("parameter", "number", "Hz") and cutoff.doc
    assert cutoff.low is not None and cutoff.low <= cutoff.value <= (cutoff.high or float("inf"))
    assert {port.way for port in told.ports} == {"input", "output", "parameter"}
    refused = with_node.refusal(m.GetNodePorts(node="nothing"))
    assert "got 'nothing'; expected one of beyond, contact, double, low_pass" in refused.message


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (NODE.replace("2.0 *", "2.0 * * "), "double.py:11: invalid syntax"),
        (NODE.replace('Input("number")', 'Input("nonsense")'), "double.py:7: "),
        (NODE.replace("Output\n", "Output\nimport nowhere_to_be_found\n"), "double.py:2: "),
        (NODE + "\n\nclass Other(Node):\n    pass\n", "got the nodes Double, Other"),
    ],
    ids=["syntax", "port", "import", "two nodes"],
)
def test_what_can_not_be_loaded_is_refused_at_its_line_and_changes_nothing(with_node, text, told):
    refused = with_node.refusal(m.SaveNode(node="double", text=text, was=NODE))
    assert refused.field == "text" and told in refused.expected, refused.expected
    assert "/tmp" not in refused.expected
    assert with_node.call(m.GetNodeSource(node="double")).text == NODE


def test_nodes_that_come_with_handrail_can_be_read_and_saved_under_another_name_only(stack):
    there = stack.call(m.GetNodeSource(node="low_pass"))
    refused = stack.refusal(m.SaveNode(node="low_pass", text=there.text + "\n", was=there.text))
    assert "name of its own" in refused.message
    stack.call(m.SaveNode(node="smoother", text=there.text))
    assert stack.call(m.GetNodeSource(node="smoother")).text == there.text


def test_no_other_file_of_the_robot_is_opened_or_written(stack):
    assert "one of: " in stack.refusal(m.GetNodeSource(node="../press")).expected
    assert stack.refusal(m.SaveNode(node="../x", text=NODE)).field == "node"


def test_nodes_are_wired_together_and_modules_beside_them_found(with_node):
    stack = with_node
    stack.call(m.SaveNode(node="helper", text="def twice(value):\n    return 2.0 * value\n"))
    using = NODE.replace("from engines", "from helper import twice\nfrom engines")
    using = using.replace("2.0 * self.value", "twice(self.value)")
    stack.call(m.SaveNode(node="double", text=using, was=NODE))
    stack.call(m.SaveNode(node="chain", text=WIRED, wired=True))
    stack.call(m.StartNode(node="chain"))
    state = stack.call(m.PutNode(name="chain", inputs={"value": 1.0}, step=True))
    assert next(port.value for port in state.ports if port.name == "doubled") == 4.0
    wrong = stack.refusal(m.SaveNode(node="chain", text=WIRED.replace("one.doubled", "one.tripled"), was=WIRED))
    assert "chain.yaml" in wrong.expected and "tripled" in wrong.expected
