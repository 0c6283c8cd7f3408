"""A program as a picture: read, laid out, edited, undone; and in the window by mouse, saved while it runs."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import pytest

from engines.programs import library, program
from handrail.messages import (
    BundleState,
    GetProgram,
    Library,
    LibraryEntry,
    ListLibrary,
    ProgramSource,
    Release,
    SaveProgram,
)
from tablet_client.models.canvas import picture
from tablet_client.models.canvas.canvas import Canvas
from tablet_client.models.canvas.chart import read
from tablet_client.models.code import Code
from tests.tablet.shown import judge

TEXT = """\
# What it is for.
title: Turn
variables: {why: ""}
states:
  # asks
  asking:
    do: prompt # of the operator
    with: {text: "Go on?", options: [yes, no]}
    transitions:
      - {event: done.invoke.asking, cond: _event.data.answer == 'yes', target: turning} # gladly
      - {event: error.execution, target: failed, set: {why: failure}}
  turning:
    title: Turn it
    states:
      pushing:
        title: Push
        transitions:
          - {after: 2, target: drawing}
      drawing:
        transitions:
          - {target: pushing}
          - {target: done}
  done: {final: true, outcome: succeeded}
  failed: {final: true, outcome: failed, detail: "{why}"}
"""


@pytest.fixture
def canvas() -> Canvas:
    code = Code()
    code.open("program", "turn")
    (call,) = code.want()
    code.take(call, ProgramSource(program="turn", file="turn.yaml", text=TEXT))
    return Canvas(code)


def text(canvas: Canvas) -> str:
    assert canvas.document is not None
    return canvas.document.text


def test_states_ways_and_marks_are_read_as_the_file_has_them():
    chart = read(TEXT)
    assert chart.title == "Turn" and chart.within("turning") == ["pushing", "drawing"]
    assert [state.name for state in chart.states.values() if state.initial] == ["asking", "pushing"]
    assert chart.states["asking"].does == "prompt: Go on?"
    assert [way.label for way in chart.states["asking"].ways] == ["done [_event.data.answer == 'yes']", "failed"]
    assert chart.states["pushing"].ways[0].label == "after 2 s"
    assert [chart.states[name].kind for name in ("turning", "done", "failed")] == ["state", "succeeded", "failed"]
    with pytest.raises(ValueError, match="states: missing"):
        read("title: Nothing")
    with pytest.raises(ValueError, match="line 2: not YAML"):
        read("title: [")


@pytest.mark.parametrize("name", sorted(library.files()))
def test_every_program_of_the_library_is_drawn_without_overlaps_and_with_all_its_ways(name):
    file = library.files()[name]
    chart = read(file.read_text())
    drawn = picture.of(chart)
    known = {state.id for state in program.read(file, library.files()).states() if "/" not in state.id}
    assert known == {state.name for state in chart.states.values() if not state.remembers}
    for a, b in combinations(drawn.boxes, 2):
        box, other = drawn.boxes[a], drawn.boxes[b]
        inside = a in chart.above(b) or b in chart.above(a)
        apart = (
            box.x + box.width <= other.x or other.x + other.width <= box.x
            or box.y + box.height <= other.y or other.y + other.height <= box.y
        )  # fmt: skip
        within = other.has((box.x, box.y)) and other.has((box.x + box.width, box.y + box.height))
        within |= box.has((other.x, other.y)) and box.has((other.x + other.width, other.y + other.height))
        assert within if inside else apart, f"{a} and {b}"
    ways = {
        (way.source, target, way.place)
        for state in chart.states.values()
        for way in state.ways
        for target in way.targets
    }
    assert {(curve.source, curve.target, place) for curve in drawn.curves for place in curve.places} == ways
    for curve in drawn.curves:
        for point, box in ((curve.start, drawn.boxes[curve.source]), (curve.pieces[-1][2], drawn.boxes[curve.target])):
            on_edge = point[1] in (box.y, box.y + box.height) or point[0] == box.x + box.width
            assert box.has(point) and on_edge, f"{curve.source} to {curve.target}"
        assert 0 <= curve.at[0] <= drawn.width + 40 and 0 <= curve.at[1] <= drawn.height


def test_an_edit_keeps_what_it_does_not_concern_and_is_undone_and_done_again(canvas):
    canvas.select("asking")
    canvas.put("title", "Ask first")
    canvas.rename("confirming")
    canvas.connect("turning", "failed")
    edited = text(canvas)
    assert "# What it is for." in edited and "do: prompt # of the operator" in edited and "# gladly" in edited
    assert "done.invoke.confirming" in edited and "asking" not in edited.replace("# asks", "")
    assert (canvas.selected, canvas.way) == ("turning", 0) and canvas.state.ways[0].targets == ("failed",)
    kept = [line for line in TEXT.splitlines() if "asking" not in line and "turning" not in line]
    assert [line for line in kept if line not in edited.splitlines()] == []
    for _ in range(3):
        canvas.undo()
    assert text(canvas) == TEXT and not canvas.can_undo
    for _ in range(3):
        canvas.redo()
    assert text(canvas) == edited and not canvas.can_redo


def test_states_are_added_nested_moved_and_deleted_with_the_ways_that_lead_there(canvas):
    canvas.select("pushing")
    canvas.add()
    assert canvas.selected == "state_1" and canvas.chart.within("turning") == ["pushing", "state_1", "drawing"]
    canvas.add(within=True)
    assert canvas.chart.within("state_1") == ["state_2"]
    canvas.move("")
    canvas.select("done")
    canvas.nest("ends")
    assert canvas.chart.within("ends") == ["done"]
    canvas.select("drawing")
    canvas.remove()
    assert "drawing" not in canvas.chart.states and not canvas.chart.states["pushing"].ways
    canvas.select("asking", 1)
    canvas.remove()
    assert [way.targets for way in canvas.chart.states["asking"].ways] == [("turning",)] and canvas.selected == "asking"


def test_what_is_typed_anew_keeps_the_comments_of_what_it_does_not_change():
    code = Code()
    code.open("program", "turn")
    (call,) = code.want()
    given = """\
    with:
      text: Go on? # asked kindly
      options: [yes, no] # in this order
      details: {force: "12"}
"""
    whole = TEXT.replace('    with: {text: "Go on?", options: [yes, no]}\n', given)
    code.take(call, ProgramSource(program="turn", file="turn.yaml", text=whole))
    canvas = Canvas(code)
    canvas.select("asking")
    canvas.put("with", canvas.with_text().replace("12", "15") + "\nseverity: warning")
    edited = text(canvas)
    assert "# asked kindly" in edited and "# in this order" in edited and 'force: "15"' in edited.replace("'", '"')
    assert "severity: warning" in edited
    canvas.put("with", "text: Go on?")
    assert canvas.state.fields["with"] == {"text": "Go on?"} and "# asked kindly" in text(canvas)
    canvas.undo()
    assert text(canvas) == edited


def test_fields_of_states_and_ways_are_typed_and_what_is_wrong_is_said(canvas):
    canvas.select("asking")
    canvas.put("with", "text: Really?\noptions: [yes]")
    assert canvas.state.fields["with"] == {"text": "Really?", "options": ["yes"]}
    canvas.put("with", "no mapping")
    assert "with: got 'no mapping'; expected name: value" in canvas.said
    canvas.put("with", "")
    assert "with" not in canvas.state.fields and canvas.said == ""
    canvas.select("asking", 0)
    canvas.put("cond", "")
    canvas.put("after", "3.5")
    assert dict(canvas.state.ways[0].fields) == {"event": "done.invoke.asking", "target": "turning", "after": 3.5}
    canvas.select("asking", 1)
    canvas.put("set", "{why: failure, n: n + 1}")
    assert canvas.state.ways[1].fields["set"] == {"why": "failure", "n": "n + 1"}
    canvas.put("set", "why")
    assert "set: got 'why'; expected" in canvas.said
    for field, typed, said in (
        ("target", "turning nowhere", "target: no state 'nowhere'; expected one of asking, turning, "),
        ("after", "-2", "after: got -2; expected a time in s above 0"),
        ("after", "[1]", "after: got [1]; expected a time"),
    ):
        before = text(canvas)
        canvas.put(field, typed)
        assert said in canvas.said and text(canvas) == before
    canvas.put("after", "most * 2")
    assert canvas.state.ways[1].fields["after"] == "most * 2" and canvas.said == ""
    canvas.select("drawing")
    canvas.mark("initial", True)
    assert canvas.state.initial and not canvas.chart.states["pushing"].initial
    canvas.rename("turning")
    assert "there already" in canvas.said and canvas.selected == "drawing"
    canvas.rename("a b")
    assert "expected a name" in canvas.said
    canvas.mark("parallel", True)
    canvas.mark("parallel", False)
    assert "parallel" not in canvas.state.fields


def test_what_is_typed_elsewhere_is_drawn_and_while_it_is_no_program_the_last_one_stays(canvas):
    before = canvas.picture
    canvas.document.text = TEXT.replace("title: Push", "title: [")
    assert canvas.picture is before and "not YAML" in canvas.problem and canvas.why_not_edit() == "unsound"
    canvas.select("done")
    canvas.remove()
    assert "done" in canvas.chart.states
    canvas.document.text = TEXT.replace("drawing", "pulling")
    assert "pulling" in canvas.chart.states and canvas.problem == ""


def test_a_program_that_is_no_yaml_says_so(canvas):
    canvas.document.file = "turn.scxml"
    assert canvas.picture is None and "expected a program in YAML" in canvas.problem


@pytest.mark.window
def test_by_mouse_a_state_is_edited_connected_and_saved_while_the_program_runs(robot: Any, show: Any) -> None:
    from PySide6.QtCore import QPoint, QPointF, Qt
    from PySide6.QtTest import QTest

    answer, saved = robot.answer, []

    def answers(call: Any) -> Any:
        if isinstance(call, ListLibrary):
            return Library(entries=[LibraryEntry(name="turn", kind="program", title="Turn")])
        if isinstance(call, GetProgram):
            return ProgramSource(program=call.program, file="turn.yaml", text=saved[-1].text if saved else TEXT)
        if isinstance(call, SaveProgram):
            saved.append(call)
            return BundleState(release=Release(number=len(saved), program="turn", bundle="3" * 32, by="ada", at_ns=0))
        return answer(call)

    robot.answer = answers
    robot.run = robot.running(program="turn", active=["turning", "pushing"])
    shown = show()
    shown.window.requestActivate()
    shown.until(shown.window.isActive)
    shown.press("tab_canvas")
    shown.press("canvas_program_turn")
    view = shown.desk.workshop.canvas
    shown.until(lambda: {"turning", "pushing"} == {row["name"] for row in view.boxes.lines if row["active"]})

    def middle(state: str, share: float = 0.5) -> Any:
        item = shown.item(f"state_{state}")
        return item.mapToScene(QPointF(item.width() / 2, item.height() * share)).toPoint()

    def click(at: Any) -> None:
        QTest.mouseClick(shown.window, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, at)

    shown.until(lambda: shown.item("state_asking").width() > 20)
    click(middle("asking"))
    shown.until(lambda: view.view["state"].get("name") == "asking")
    title = shown.item("canvas_title")
    title.forceActiveFocus()
    for key in (Qt.Key.Key_S, Qt.Key.Key_U, Qt.Key.Key_R, Qt.Key.Key_E):
        shown.key(key)
    shown.key(Qt.Key.Key_Return)
    shown.until(lambda: "title: sure" in shown.desk.situation.canvas.document.text)

    # From its dot to another state.
    start, end = middle("asking", 1.0) + QPoint(0, 4), middle("done")
    QTest.mousePress(shown.window, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, start)
    for step in range(1, 9):
        QTest.mouseMove(shown.window, start + (end - start) * step / 8)
        shown.turn()
    QTest.mouseRelease(shown.window, Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier, end)
    shown.until(lambda: view.view["way"] == 2)
    assert view.view["state"]["target"] == "done" and view.view["state"]["event"] == "done.invoke.asking"
    shown.press("canvasUndo")
    shown.until(lambda: len(view.view["state"]["ways"]) == 2)
    shown.press("canvasRedo")

    assert not shown.window.close() and shown.window.isVisible(), "what was not saved is asked about first"
    judge(shown, (1024, 640))
    shown.press("keepOpen")
    assert shown.words("Pages.current") == "code"
    shown.press("tab_canvas")
    shown.press("canvasSave")
    shown.until(lambda: saved)
    assert saved[0].was == TEXT and "# gladly" in saved[0].text and "target: done" in saved[0].text
    shown.until(lambda: not shown.desk.workshop.code.view["dirty"])
    assert not robot.stopped

    zoom = shown.item("page_canvas").property("item").property("zoom")
    shown.press("canvasIn")
    shown.until(lambda: shown.item("page_canvas").property("item").property("zoom") > zoom)

    click(middle("failed"))
    shown.until(lambda: view.view["state"].get("name") == "failed")
    shown.press("canvasRemove")
    shown.until(lambda: shown.desk.workshop.code.view["unsaved"] == 1)
    shown.window.close()
    shown.press("closeAnyway")
    shown.until(lambda: not shown.window.isVisible())
