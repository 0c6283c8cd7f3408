"""Code that is edited in the window: kept, checked, coloured, saved."""

from __future__ import annotations

from typing import Any

import pytest

from handrail.messages import (
    BundleState,
    GetNodeSource,
    ListNodes,
    NodeEntry,
    NodeLibrary,
    NodeSource,
    Refused,
    Release,
    ReloadNode,
    SaveNode,
)
from handrail.topics import RefusedError
from tablet_client.models.code import Code
from tablet_client.models.code_check import Problem, check, told
from tablet_client.models.indenting import back, enter, tab
from tests.tablet.test_output import _node

TEXT = "def step(self):\n    pass\n"


def source(name: str = "scale", text: str = TEXT, *, builtin: bool = False) -> NodeSource:
    return NodeSource(node=name, file=f"{name}.py", text=text, builtin=builtin)


def release(number: int = 3) -> BundleState:
    return BundleState(release=Release(number=number, program="nodes/scale", bundle="3" * 32, by="ada", at_ns=0))


@pytest.fixture
def code() -> Code:
    """With one node of its own open."""
    made = Code()
    made.open("node", "scale")
    (call,) = made.want()
    made.take(call, source())
    return made


def edit(code: Code, text: str) -> None:
    code.edit(code.current, text)


def read_again(code: Code, text: str) -> None:
    code.anew()
    (call,) = [each for each in code.want() if isinstance(each, GetNodeSource)]
    code.take(call, source(text=text))


def test_an_edit_is_saved_over_the_text_that_it_was_made_of(code):
    assert code.why_not_save() == "nothing_to_save" and code.save() is None
    edit(code, TEXT + "# more\n")
    call = code.save("why")
    assert isinstance(call, SaveNode)
    assert (call.was, call.text, call.note) == (TEXT, TEXT + "# more\n", "why")
    assert code.why_not_save() == "sending"
    edit(code, TEXT + "# more still\n")  # typed on, meanwhile
    code.take(call, release())
    assert code.document.was == call.text and code.document.dirty and code.document.release == 3


def test_edits_outlive_a_link_that_goes_and_a_save_whose_answer_got_lost(code):
    edit(code, "x = 1\n")
    call = code.save()
    code.failed(call, "no answer")
    read_again(code, "x = 1\n")  # it had been carried out
    assert code.document.text == "x = 1\n" and not code.document.dirty
    edit(code, "x = 2\n")
    read_again(code, "x = 1\n")
    assert code.document.text == "x = 2\n" and code.document.dirty and code.document.theirs is None


@pytest.mark.parametrize("keep", [True, False])
def test_what_somebody_else_saved_meanwhile_is_neither_lost_nor_overwritten_unasked(code, keep):
    edit(code, "mine = 1\n")
    read_again(code, "theirs = 1\n")
    assert code.document.text == "mine = 1\n" and code.why_not_save() == "saved_by_others"
    if keep:
        code.overrule()
        assert code.save().was == "theirs = 1\n"
    else:
        code.revert()
        assert code.document.text == "theirs = 1\n" and not code.document.dirty
    assert not code.close("node:nobody@")


def test_a_document_that_is_as_the_engine_has_it_follows_it_and_may_be_closed(code):
    before = code.document.revision
    read_again(code, "x = 3\n")
    assert code.document.text == "x = 3\n" and code.document.revision == before + 1
    edit(code, "x = 4\n")
    assert not code.close(code.current)
    code.revert()
    assert code.close(code.current) and code.document is None


def test_an_engines_refusal_stands_at_its_line_until_the_text_is_another_one(code):
    edit(code, "import nowhere\n")
    call = code.save()
    why = "the node can't be saved; field text, value scale, expected scale.py:1: node scale: ModuleNotFoundError: nowhere"
    code.failed(call, why)
    assert code.document.problem == Problem(1, "node scale: ModuleNotFoundError: nowhere")
    assert code.why_not_save() == ""  # it may be tried again: a module may have come
    edit(code, "import math\n")
    assert code.document.problem is None


def test_what_comes_with_handrail_is_copied_under_a_name_of_ones_own():
    code = Code()
    code.watched = True
    code.take(code.want()[0], NodeLibrary(nodes=[NodeEntry(name="low_pass", file="low_pass.py", builtin=True)]))
    code.open("node", "low_pass")
    code.take(code.want()[0], source("low_pass", builtin=True))
    edit(code, "x = 1\n")
    assert code.why_not_save() == "builtin"
    assert [code.why_not_begin(name) for name in ("low_pass", "2x", "class", "a b", "mine")] == [
        "name_taken", "no_name", "no_name", "no_name", "",
    ]  # fmt: skip
    code.begin("mine", code.document)
    assert code.document.text == "x = 1\n" and code.save().was == ""


def test_a_new_node_begins_as_one_that_an_engine_takes(tmp_path):
    from engines.nodes.node import load

    code = Code()
    code.begin("scale_it")
    file = tmp_path / code.document.file
    file.write_text(code.document.text)
    assert load(file).__name__ == "ScaleIt"


@pytest.mark.parametrize(
    ("text", "file", "line"),
    [
        ("x = 1\n", "a.py", None),
        ("x = 1\ndef f(:\n", "a.py", 2),
        ("x = (1,\n", "a.py", 1),
        ("return 1\n", "a.py", 1),
        ("x = '\\d'\n", "a.py", None),  # a warning is none
        ("x = 1\0", "a.py", 0),
        ("(" * 5000, "a.py", 1),
        ("a: 1\nb: [2\n", "a.yaml", 3),
        ("a: {b: 1}\n", "a.yaml", None),
        ("<scxml", "a.scxml", None),
    ],
)
def test_errors_are_found_while_one_types(text, file, line):
    found = check(text, file)
    assert (None if found is None else found.line) == line or (text == "x = 1\0" and found is not None)


def test_a_refusal_names_the_last_place_that_is_in_the_file():
    why = "can't be saved; expected press.yaml:4: states.a: as rtc_programs/press.yaml:7: states.b.with: got 4"
    assert told(why, "press.yaml") == Problem(7, "states.b.with: got 4")
    assert told("other.yaml:4: no", "press.yaml") == Problem(0, "other.yaml:4: no")


def after(text: str, change: Any) -> str:
    return text[: change.start] + change.text + text[change.end :]


def test_tab_shift_tab_and_enter_keep_code_in_line():
    assert after("ab", tab("ab", 1, 1, ".py")) == "a   b"
    assert after("a:\n\nb\n", tab("a:\n\nb\n", 0, 5, ".py")) == "    a:\n\n    b\n"
    assert after("a\nb\nc", tab("a\nb\nc", 0, 2, ".yaml")) == "  a\nb\nc"
    assert after("    a\n  b\n", back("    a\n  b\n", 0, 9, ".py")) == "a\nb\n"
    assert after("  a", enter("  a", 3, 3, ".yaml")) == "  a\n  "
    line = "    def f():  # why"
    assert after(line, enter(line, len(line), len(line), ".py")) == line + "\n        "
    assert enter("if x:", 5, 5, ".py").selected == (10, 10)
    assert back("    a", 5, 5, ".py").selected == (1, 1)


def test_texts_over_several_lines_are_told_from_code_and_comments():
    from tablet_client.highlighter import pieces

    assert pieces('x = """a', 0) == ([(0, 4, False), (4, 8, True)], 2)
    assert pieces("b ''' c", 2) == ([(0, 7, True)], 2)
    assert pieces('c""" + 1', 2) == ([(0, 4, True), (4, 8, False)], 0)
    assert pieces('x = 1  # not """ a text', 0)[1] == 0
    assert pieces("s = 'it\\'s \"\"\" one'", 0)[1] == 0


def typed(shown: Any, words: str) -> None:
    for letter in words:
        shown.test.keyClick(shown.window, letter)


@pytest.mark.window
def test_a_node_is_typed_marked_where_it_is_wrong_saved_refused_and_saved_again(robot, show):
    from PySide6.QtCore import Qt

    from tests.tablet.shown import judge

    answer, saved = robot.answer, []

    def answers(call: Any) -> Any:
        if isinstance(call, ListNodes):
            return NodeLibrary(nodes=[NodeEntry(name="scale", file="scale.py", builtin=False)])
        if isinstance(call, GetNodeSource):
            return source(text=saved[-1] if saved else TEXT)
        if isinstance(call, SaveNode):
            robot.calls.append(call)
            if "nowhere" in call.text:
                told = "scale.py:1: node scale: no module nowhere"
                raise RefusedError(Refused(message="no", field="text", value="scale", expected=told))
            saved.append(call.text)
            return release()
        return answer(call)

    robot.answer = answers
    robot.nodes.nodes.append(_node("scale"))
    shown = show()
    shown.press("tab_code")
    shown.until(lambda: shown.there("code_node_scale"))
    shown.press("code_node_scale")
    area = shown.until(lambda: next((each for each in shown.all_items() if each.objectName() == "area_scale"), None))
    area.forceActiveFocus()
    view = shown.desk.workshop.code

    for key in (Qt.Key.Key_I, Qt.Key.Key_F, Qt.Key.Key_Space, Qt.Key.Key_1, Qt.Key.Key_Colon, Qt.Key.Key_Return):
        shown.key(key)
    shown.until(lambda: view.view["problem"]["line"] == 3 and "indent" in view.view["problem"]["message"])
    assert not robot.stopped  # Space is typed here
    assert area.property("text").startswith("if 1:\n    def")
    assert not shown.item("saveCode").isEnabled()
    shown.test.keyClick(shown.window, Qt.Key.Key_Z, Qt.KeyboardModifier.ControlModifier)
    shown.until(lambda: not area.property("text").startswith("if 1:\n"))
    while shown.item("undoCode").isEnabled():
        shown.press("undoCode")
        shown.turn(0.02)
    shown.until(lambda: area.property("text") == TEXT and not view.view["dirty"])

    area.forceActiveFocus()
    area.setProperty("cursorPosition", 0)
    typed(shown, "import nowhere")
    shown.key(Qt.Key.Key_Return)
    shown.page("task")  # what is typed outlives the page, and the link
    robot.reachable = False
    shown.until(lambda: shown.desk.header["link"] == "lost")
    robot.reachable = True
    shown.until(lambda: shown.desk.header["link"] == "attached" and shown.desk.header["engine"])
    shown.page("code")
    assert area.property("text") == "import nowhere\n" + TEXT
    shown.press("saveCode")
    shown.until(lambda: view.view["problem"]["message"] == "node scale: no module nowhere")
    assert view.view["problem"]["line"] == 1

    found = view.find(view.view["current"], "NOWHERE", 0, False)
    assert (found["start"], found["end"]) == (7, 14)
    area.forceActiveFocus()
    area.select(7, 14)
    typed(shown, "math")
    shown.turn(0.4)
    judge(shown, (1024, 640))
    shown.test.keyClick(shown.window, Qt.Key.Key_S, Qt.KeyboardModifier.ControlModifier)
    shown.until(lambda: view.view["release"] == 3 and not view.view["dirty"])
    assert saved == ["import math\n" + TEXT] and robot.calls_of(SaveNode)[-1].was == TEXT
    shown.press("reloadCode")
    shown.until(lambda: robot.calls_of(ReloadNode))
    area.forceActiveFocus()
    shown.key(Qt.Key.Key_Escape)
    shown.until(lambda: robot.stopped)
