"""What engines, nodes and the daemon say: chosen, filtered, held, and not in the way when it is too much."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from handrail.messages import LogLine, Nodes, NodeState
from tablet_client.models.output import KEPT, SHOWN, Output
from tests.tablet.behind import Behind


def line(text: str, source: str = "engine/low_pass", level: Any = "info") -> LogLine:
    return LogLine(source=source, level=level, text=text)


@pytest.fixture
def output() -> Output:
    made = Output(lambda: "12:00:00")
    made.take(line("3.2 N"))
    made.take(line("too slow", "engine/follow", "warning"))
    made.take(line("ArithmeticError: no force", level="error"))
    made.take(line("anna did not check in", "daemon", "warning"))
    return made


def texts(output: Output) -> list[str]:
    return [each.text for each in output.shown()]


def sent(output: Output, *lines: LogLine) -> list[str]:
    """What of these lines would travel."""
    return [each.text for each in lines for chosen in output.wanted() if chosen.wants(each)]


def test_lines_are_filtered_by_level_by_source_and_by_what_is_searched_for(output):
    assert texts(output) == ["too slow", "ArithmeticError: no force", "anna did not check in"]
    output.switch("info")
    assert texts(output)[0] == "3.2 N"
    output.choose("engine/low_pass")
    assert texts(output) == ["3.2 N", "ArithmeticError: no force"]
    output.switch("error")
    assert texts(output) == ["3.2 N"]
    output.choose("engine/low_pass")
    output.find(" FOLLOW ")
    assert texts(output) == ["too slow"]
    assert output.written() == "12:00:00 warning engine/follow: too slow\n"


def test_only_what_is_asked_for_travels_and_no_line_twice(output):
    lines = (line("a"), line("b", "engine/follow"), line("c", "engine"), line("d", "daemon", "error"))
    assert sent(output, *lines) == ["c", "d"]
    output.switch("info")
    assert sent(output, *lines) == ["a", "b", "c", "d"]
    output.choose("engine/follow")
    assert sent(output, *lines) == ["b", "c", "d"]
    output.choose("")
    output.choose("engine/[ab]*")
    assert sent(output, line("literally", "engine/[ab]*"), line("pattern", "engine/a2")) == ["literally"]


def test_held_lines_wait_and_then_show(output):
    output.hold(True)
    output.take(line("meanwhile", level="error"))
    assert "meanwhile" not in texts(output) and output.waiting == 1
    output.hold(False)
    assert texts(output)[-1] == "meanwhile"


def test_a_flood_leaves_the_newest_lines_and_no_more_memory(output):
    output.switch("info")
    for number in range(3 * KEPT):
        output.take(line(f"{number} " + 100_000 * "x" if number % 1000 == 0 else str(number)))
    assert len(output.kept) == KEPT and len(output.shown()) == SHOWN
    assert texts(output)[-1] == str(3 * KEPT - 1)
    assert max(len(each.text) for each in output.kept) <= 4000
    assert [each.text for each in output.shown(after=output.kept[-1].number - 2)] == texts(output)[-2:]


def test_through_a_real_gate_what_a_node_prints_comes_once_it_is_asked_for(behind: Behind, wait: Callable[..., Any]):
    output = Output()
    behind.open_gate()
    behind.open_tablet()
    assert behind.session is not None
    behind.session.hear(output.wanted())

    def told(text: str, level: str) -> list[LogLine]:
        behind.publish_prompt(line(text, level="info"))
        behind.publish_prompt(line("marker", level=level))
        return behind.has(LogLine, text="marker", level=level)

    wait(lambda: told("not asked for", "warning"))
    assert not behind.has(LogLine, text="not asked for")
    output.switch("info")
    behind.session.hear(output.wanted())
    wait(lambda: told("asked for", "error") and behind.has(LogLine, text="asked for"))


@pytest.mark.window
def test_the_page_shows_a_flood_filters_it_by_node_and_copies_what_is_shown(robot, show):
    from PySide6.QtCore import Qt
    from PySide6.QtGui import QGuiApplication

    from tests.tablet.shown import judge

    robot.nodes = Nodes(nodes=[_node("quiet")])
    shown = show()
    shown.press("tab_output")
    shown.until(lambda: shown.there("source_engine/quiet"))
    shown.press("level_info")
    shown.until(lambda: robot.chosen and any(each.wants(line("x")) for each in robot.chosen[-1].chosen))
    robot.publish(*(line(f"value {number}", "engine/noisy") for number in range(20_000)), line("over", level="error"))
    lines = shown.desk.workshop.output.lines
    shown.until(lambda: lines.rowCount() == SHOWN)
    shown.until(lambda: shown.desk.situation.output.kept[-1].text == "over")
    shown.press("source_engine/low_pass")
    shown.until(lambda: lines.rowCount() == 1)
    shown.item("searchOutput").forceActiveFocus()
    for key in (Qt.Key.Key_O, Qt.Key.Key_X):
        shown.key(key)
    shown.until(lambda: lines.rowCount() == 0)
    shown.key(Qt.Key.Key_Backspace)
    shown.until(lambda: lines.rowCount() == 1)
    shown.press("copyOutput")
    shown.until(lambda: "engine/low_pass: over" in QGuiApplication.clipboard().text())
    judge(shown, (1024, 640))


def _node(name: str) -> NodeState:
    return NodeState(
        name=name, node=name, state="up", process=1, restarts=0, cpu_share=0.0, memory_mb=1.0, every=None, ports=[]
    )
