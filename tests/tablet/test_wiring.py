"""A node made of nodes as a picture: read, laid out, wired, undone; and in the window by mouse, saved to the engine."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import pytest

from handrail.messages import (
    BundleState,
    GetNodePorts,
    GetNodeSource,
    ListNodes,
    NodeEntry,
    NodeLibrary,
    NodePort,
    NodePorts,
    Nodes,
    NodeSource,
    NodeState,
    Release,
    SaveNode,
)
from tablet_client.models.canvas import graph_picture
from tablet_client.models.canvas.graph import IN, OUT, read
from tablet_client.models.canvas.wiring import NEW, NOTHING, Wiring
from tablet_client.models.code import Code
from tests.tablet.shown import judge

TEXT = """\
# What it is for.
title: How hard something presses
nodes:
  smooth: {node: low_pass, params: {cutoff: 5.0}} # against tremor
  halves: {node: doubler}
inputs: {wrench: smooth.wrench, time: smooth.time}
wires: {halves.value: smooth.force}
params: {cutoff: smooth.cutoff}
outputs: {halves: halves.result}
cases: [{inputs: [{wrench: [3, 4, 0, 0, 0, 0], time: 0}], outputs: {halves: 10.0}}]
"""


def port(name: str, way: Any, kind: str = "number", unit: str = "", **more: Any) -> NodePort:
    return NodePort(name=name, way=way, kind=kind, unit=unit, **more)


PORTS = {
    "low_pass": [
        port("wrench", "input", "wrench"),
        port("time", "input", unit="s"),
        port("smooth", "output", "wrench"),
        port("force", "output", unit="N"),
        port("cutoff", "parameter", unit="Hz", value=2.0, low=0.001, high=1000.0, doc="what is damped"),
    ],
    "doubler": [
        port("value", "input", unit="N"),
        port("result", "output", unit="N"),
        port("times", "parameter", value=2.0, low=0.0, high=10.0),
        port("how", "parameter", "text", value="fast", choices=["fast", "well"]),
    ],
    "mean": [port("values", "input", "numbers"), port("result", "output")],
}


def ports(call: GetNodePorts) -> NodePorts:
    return NodePorts(node=call.node, title=f"What {call.node} does", every=None, ports=PORTS[call.node])


@pytest.fixture
def code() -> Code:
    code = Code()
    code.nodes = [NodeEntry(name=name, file=f"{name}.py", builtin=False) for name in (*PORTS, "module")]
    code.nodes.append(NodeEntry(name="pressed", file="pressed.yaml", builtin=False))
    code.open("node", "pressed")
    (call,) = code.want()
    code.take(call, NodeSource(node="pressed", file="pressed.yaml", text=TEXT, builtin=False))
    return code


@pytest.fixture
def wiring(code: Code) -> Wiring:
    wiring = Wiring(code)
    wiring.watched = True
    while calls := list(wiring.want()):
        if calls[0].node in PORTS:
            wiring.known.take(calls[0], ports(calls[0]))
        else:
            assert wiring.known.failed(calls[0], "expected one class that is a Node")
    return wiring


def text(wiring: Wiring) -> str:
    assert wiring.document is not None
    return wiring.document.text


def at(wiring: Wiring, box: str, name: str, *, out: bool) -> tuple[float, float]:
    return next(each.at for each in wiring.picture.sockets if (each.box, each.port, each.out) == (box, name, out))


def test_parts_wires_and_own_ports_are_read_as_the_file_has_them():
    graph = read(TEXT)
    assert graph.title == "How hard something presses" and graph.parts["smooth"].params == {"cutoff": 5.0}
    wires = {(*wire.source, *wire.target) for wire in graph.all_wires()}
    assert wires == {
        ("smooth", "force", "halves", "value"),
        (IN, "wrench", "smooth", "wrench"),
        (IN, "time", "smooth", "time"),
        ("halves", "result", OUT, "halves"),
    }
    with pytest.raises(ValueError, match="nodes: missing"):
        read("title: Nothing")
    with pytest.raises(ValueError, match="line 2: not YAML"):
        read("title: [")


def test_it_is_drawn_from_left_to_right_without_overlaps_and_every_wire_between_its_ports(wiring):
    drawn = wiring.picture
    for a, b in combinations(drawn.boxes.values(), 2):
        assert a.x + a.width <= b.x or b.x + b.width <= a.x or a.y + a.height <= b.y or b.y + b.height <= a.y
    lefts = [drawn.boxes[name].x for name in (IN, "smooth", "halves", OUT)]
    assert lefts == sorted(lefts) and len(set(lefts)) == 4
    for curve, wire in zip(drawn.curves, drawn.wires, strict=True):
        assert curve.start == at(wiring, *wire.source, out=True)
        assert curve.pieces[-1][2] == at(wiring, *wire.target, out=False)
    for socket in drawn.sockets:
        assert drawn.boxes[socket.box].has(socket.at) and drawn.socket_at(socket.at) == socket
        assert socket.at[0] in (drawn.boxes[socket.box].x, drawn.boxes[socket.box].x + drawn.boxes[socket.box].width)
    assert all(box.x >= 0 and box.x + box.width <= drawn.width for box in drawn.boxes.values())


def test_ports_that_are_not_known_are_those_that_the_file_names(code):
    wiring = Wiring(code)
    known = {(each.box, each.port): each.known for each in wiring.picture.sockets}
    assert known["smooth", "wrench"] and known["halves", "result"] and ("smooth", "smooth") not in known
    wiring.watched = True
    (call,) = wiring.want()
    wiring.known.take(call, NodePorts(node="low_pass", title="", every=None, ports=[]))
    assert not next(each.known for each in wiring.picture.sockets if each.port == "wrench" and each.box == "smooth")


def test_what_a_finger_is_on_is_selected_and_a_wire_by_where_it_leads(wiring):
    picture = wiring.picture
    wiring.touch(at(wiring, "smooth", "force", out=True))
    assert (wiring.selected, wiring.port) == ("smooth", ("force", True))
    curve = picture.curves[0]
    middle = tuple((a + b) / 2 for a, b in zip(curve.start, curve.pieces[-1][2], strict=True))
    wiring.touch(middle)
    assert (wiring.selected, wiring.port) == ("halves", ("value", False))
    box = picture.boxes["smooth"]
    wiring.touch((box.x + box.width / 2, box.y + 10))
    assert (wiring.selected, wiring.port) == ("smooth", None)
    wiring.touch((0.0, 0.0))
    assert wiring.selected == ""
    wiring.beside(1)
    wiring.beside(1)
    assert wiring.selected == list(picture.boxes)[1]


def test_a_wire_is_drawn_from_port_to_port_and_to_the_first_port_of_a_box_that_fits(wiring):
    wiring.add("doubler")
    assert wiring.selected == "doubler" and "doubler: {node: doubler}" in text(wiring)
    box = wiring.picture.boxes["doubler"]
    wiring.join("smooth", "force", True, (box.x + box.width / 2, box.y + 10))
    assert read(text(wiring)).wires["doubler.value"] == "smooth.force" and wiring.port == ("value", False)
    wiring.join("doubler", "value", False, at(wiring, "halves", "result", out=True))
    assert read(text(wiring)).wires["doubler.value"] == "halves.result"
    box = wiring.picture.boxes["doubler"]
    wiring.join("smooth", "smooth", True, (box.x + box.width / 2, box.y + 10))
    assert wiring.said == "smooth.smooth → doubler.value: kind wrench, expected number"
    wiring.join("doubler", "value", False, at(wiring, IN, "time", out=True))
    assert wiring.said == ":in.time → doubler.value: unit s, expected N"
    wiring.add("mean")
    wiring.join("mean", "values", False, at(wiring, IN, "wrench", out=True))
    assert wiring.said == "" and read(text(wiring)).inputs["wrench"] == ("smooth.wrench", "mean.values")
    wiring.join("doubler", "result", True, at(wiring, OUT, "halves", out=False))
    assert read(text(wiring)).outputs["result"] == "doubler.result"
    wiring.join(IN, "time", True, at(wiring, OUT, "halves", out=False))
    assert "expected a wire from a part's output" in wiring.said
    wiring.touch(at(wiring, "smooth", "force", out=True))
    wiring.joining = True
    wiring.touch(at(wiring, "doubler", "value", out=False))
    assert read(text(wiring)).wires["doubler.value"] == "smooth.force" and not wiring.joining
    for _ in range(10):
        wiring.undo()
    assert text(wiring) == TEXT and not wiring.can_undo and wiring.can_redo


def test_an_input_is_offered_what_fits_it_and_gets_what_is_chosen(wiring):
    wiring.add("mean")
    assert [each.id for each in wiring.sources("halves.value")] == [
        NOTHING, "smooth.force", "mean.result", NEW,
    ]  # fmt: skip
    assert [each.id for each in wiring.sources("halves.value") if each.chosen] == ["smooth.force"]
    assert [each.id for each in wiring.sources("mean.values")] == [NOTHING, "smooth.smooth", f"{IN}.wrench", NEW]
    wiring.feed("halves.value", "mean.result")
    wiring.feed("mean.values", f"{IN}.wrench")
    wiring.feed("smooth.wrench", NEW)
    graph = read(text(wiring))
    assert graph.wires == {"halves.value": "mean.result"}
    assert graph.inputs == {"wrench": ("mean.values",), "time": ("smooth.time",), "wrench_2": ("smooth.wrench",)}
    wiring.feed("halves.value", NOTHING)
    assert read(text(wiring)).source_of("halves.value") == "" and "# against tremor" in text(wiring)


def test_parameters_are_set_within_their_bounds_and_can_be_its_own(wiring):
    wiring.select("halves")
    times, how = wiring.settings()
    assert (times.given.value, times.given.shown()["bounded"], times.set, times.own) == (2.0, True, False, "")
    assert how.given.shown()["choices"] == ["fast", "well"]
    for value in (2.5, 3.0, 3.5):  # a slider
        wiring.give("times", value)
    wiring.undo()
    assert text(wiring) == TEXT, "all of it is one step"
    wiring.redo()
    wiring.give("how", "well")
    assert read(text(wiring)).parts["halves"].params == {"times": 3.5, "how": "well"}
    wiring.give("times", 11.0)
    assert wiring.said == "times: got 11.0; expected 0 … 10"
    wiring.give("how", "badly")
    assert wiring.said == "how: got 'badly'; expected fast, well"
    wiring.give("times", 2.0)
    wiring.give("how", "fast")
    assert read(text(wiring)).parts["halves"].params == {}
    wiring.outside("times", True)
    assert read(text(wiring)).params == {"cutoff": ("smooth.cutoff",), "times": ("halves.times",)}
    assert wiring.settings()[0].own == "times"
    wiring.outside("times", False)
    assert read(text(wiring)).params == {"cutoff": ("smooth.cutoff",)}


def test_parts_and_own_ports_are_renamed_and_removed(wiring):
    wiring.select("smooth")
    wiring.rename("calm")
    assert wiring.selected == "calm" and read(text(wiring)).wires == {"halves.value": "calm.force"}
    wiring.rename("halves")
    assert "there already" in wiring.said
    wiring.select(IN, ("time", True))
    wiring.rename("when")
    assert wiring.port == ("when", True) and read(text(wiring)).inputs["when"] == ("calm.time",)
    wiring.remove()
    assert "when" not in read(text(wiring)).inputs
    wiring.select("halves", ("value", False))
    wiring.remove()
    assert read(text(wiring)).wires == {} and wiring.selected == "halves"
    wiring.select("halves")
    wiring.remove()
    graph = read(text(wiring))
    assert list(graph.parts) == ["calm"] and graph.outputs == {} and wiring.selected == ""
    wiring.tell("calm.force", True)
    wiring.tell("calm.force", True)
    assert read(text(wiring)).outputs == {"force": "calm.force"}
    wiring.tell("calm.force", False)
    assert read(text(wiring)).outputs == {}


def test_title_and_period_are_typed_and_what_is_none_is_said(wiring):
    wiring.put("title", "Pressing")
    wiring.put("every", "0.05")
    assert (wiring.graph.title, wiring.graph.every) == ("Pressing", 0.05)
    wiring.put("every", "often")
    assert "every: got 'often'; expected a time in s" in wiring.said
    wiring.put("every", "")
    assert wiring.graph.every is None and "every" not in text(wiring)


def test_what_is_no_node_is_not_offered_and_all_is_asked_anew_when_the_code_is_another(wiring):
    assert [name for name, _ in wiring.nodes()] == list(PORTS)
    assert wiring.known.why_not("module") == "expected one class that is a Node" and not wiring.known.title("module")
    assert dict(wiring.nodes())["doubler"] == "What doubler does"
    wiring.known.anew()
    assert [call.node for call in wiring.want()] == ["low_pass"]
    assert list(wiring.want()) == [], "one at a time"


def test_a_text_that_is_none_keeps_the_last_picture_and_says_why(wiring):
    before = wiring.picture
    wiring.document.text = TEXT.replace("title: How", "title: [")
    assert wiring.picture is before and "not YAML" in wiring.problem and wiring.why_not_edit() == "unsound"
    wiring.add("mean")
    assert "mean" not in wiring.graph.parts


def test_a_large_one_is_drawn_with_its_wires_apart():
    parts = [f"p{number}" for number in range(12)]
    lines = ["nodes:", *(f"  {part}: {{node: doubler}}" for part in parts), "wires:"]
    lines += [f"  p{number}.value: p{(number - 1) // 2}.result" for number in range(1, 12)]
    lines += ["inputs: {value: p0.value}", "outputs:", *(f"  r{part}: {part}.result" for part in parts)]
    graph = read("\n".join(lines) + "\n")
    drawn = graph_picture.of(graph, {"doubler": PORTS["doubler"]})
    for a, b in combinations(drawn.boxes.values(), 2):
        assert a.x + a.width <= b.x or b.x + b.width <= a.x or a.y + a.height <= b.y or b.y + b.height <= a.y
    assert len(drawn.curves) == 24


@pytest.mark.window
def test_by_mouse_a_node_is_begun_its_parts_are_added_wired_set_and_saved(robot: Any, show: Any) -> None:
    from PySide6.QtCore import QPoint, QPointF, Qt
    from PySide6.QtTest import QTest

    answer, saved = robot.answer, []

    def answers(call: Any) -> Any:
        if isinstance(call, ListNodes):
            return NodeLibrary(nodes=[NodeEntry(name=name, file=f"{name}.py", builtin=False) for name in PORTS])
        if isinstance(call, GetNodePorts):
            return ports(call)
        if isinstance(call, GetNodeSource):
            return NodeSource(node=call.node, file=f"{call.node}.py", text="# a node\n", builtin=False)
        if isinstance(call, SaveNode):
            saved.append(call)
            return BundleState(release=Release(number=1, program="nodes/calm", bundle="3" * 32, by="ada", at_ns=0))
        return answer(call)

    robot.answer = answers
    shown = show()
    shown.window.requestActivate()
    shown.until(shown.window.isActive)
    shown.press("tab_canvas")
    assert not shown.item("newGraph").isEnabled()
    shown.item("canvasNewName").forceActiveFocus()
    for key in (Qt.Key.Key_C, Qt.Key.Key_A, Qt.Key.Key_L, Qt.Key.Key_M):
        shown.key(key)
    shown.press("newGraph")
    view, wiring = shown.desk.workshop.graph, shown.desk.situation.wiring
    shown.until(lambda: shown.item("graphEmpty").isVisible())
    for node in ("low_pass", "doubler"):
        shown.press("canvasAdd")
        shown.until(lambda node=node: shown.there(f"add_{node}"))
        shown.press(f"add_{node}")
        shown.until(lambda node=node: view.view["name"] == node)
    shown.until(lambda: shown.there("port_doubler_value_in") and shown.there("port_low_pass_force_out"))

    def dot(name: str) -> Any:
        item = shown.item(f"port_{name}")
        return item.mapToScene(QPointF(0, 0)).toPoint()

    def drag(start: Any, end: Any) -> None:
        QTest.mousePress(shown.window, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, start)
        for step in range(1, 9):
            QTest.mouseMove(shown.window, start + (end - start) * step / 8)
            shown.turn()
        QTest.mouseRelease(shown.window, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, end)

    def settled() -> None:
        frames = shown.frames
        shown.window.update()
        shown.until(lambda: shown.frames > frames + 1 or shown.window.update())

    settled()
    drag(dot("low_pass_force_out"), dot("doubler_value_in"))
    shown.until(lambda: wiring.graph.wires == {"doubler.value": "low_pass.force"})
    settled()

    # Its inputs from outside by touch, in the form.
    at = dot("low_pass_wrench_in")
    QTest.mouseClick(shown.window, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, at + QPoint(8, 0))
    shown.until(lambda: view.view["port"] == "wrench")
    shown.press("source_new")
    shown.until(lambda: wiring.graph.inputs == {"wrench": ("low_pass.wrench",)})
    shown.press("input_time")
    shown.press("source_new")
    shown.until(lambda: "time" in wiring.graph.inputs)
    judge(shown, (1024, 640))
    shown.press("outside_cutoff")
    shown.until(lambda: wiring.graph.params == {"cutoff": ("low_pass.cutoff",)})
    item = shown.item("part_doubler")
    settled()
    title = item.mapToScene(QPointF(item.width() / 2, 12)).toPoint()
    QTest.mouseClick(shown.window, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, title)
    shown.until(lambda: view.view["name"] == "doubler" and not view.view["port"])
    shown.press("setting_how_well")
    shown.until(lambda: wiring.graph.parts["doubler"].params == {"how": "well"})
    shown.press("tell_result")
    shown.until(lambda: wiring.graph.outputs == {"result": "doubler.result"})
    shown.press("canvasUndo")
    shown.until(lambda: wiring.graph.outputs == {})
    shown.press("canvasRedo")
    shown.press("canvasSave")
    shown.until(lambda: saved)
    assert (saved[0].node, saved[0].wired, saved[0].was) == ("calm", True, "")
    assert read(saved[0].text).outputs == {"result": "doubler.result"}
    assert not robot.stopped

    running = NodeState(
        name="calm", node="calm", state="up", process=1, restarts=0, cpu_share=0.0, memory_mb=1.0, every=None,
        ports=[port("wrench", "input", "wrench"), port("result", "output", unit="N", value=5.25)],
    )  # fmt: skip
    robot.nodes = Nodes(nodes=[running])
    shown.until(lambda: [row["value"] for row in view.sockets.lines if row["box"] == OUT] == ["5.25 N"])
    assert all(row["active"] for row in view.boxes.lines)
    shown.item("canvasNewName").forceActiveFocus()
    shown.key(Qt.Key.Key_X)
    shown.press("copyGraph")
    shown.until(lambda: shown.desk.workshop.code.view["title"] == "x" and view.view["parts"] == 2)
    shown.press("canvas_node_calm")
    shown.until(lambda: shown.desk.workshop.code.view["title"] == "calm" and shown.there("part_doubler"))
    shown.desk.workshop.graph.touch("doubler")
    shown.press("graphOpen")
    shown.until(lambda: shown.words("Pages.current") == "code" and shown.desk.workshop.code.view["title"] == "doubler")
    shown.until(lambda: shown.desk.workshop.code.view["loaded"])
