"""The course in examples/ runs from its first lesson to its last, and has every call of the client."""

from __future__ import annotations

import ast
import runpy
from pathlib import Path

import pytest

from handrail.client import Client
from tests.stack.conftest import Stack

COURSE = Path(__file__).parents[2] / "examples" / "course"
LESSONS = sorted(COURSE.glob("[0-9]*.py"))


@pytest.mark.stack
@pytest.mark.timeout(700)
def test_every_lesson_runs_in_its_order(start_stack, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    stack: Stack = start_stack()
    stack.wait_up()
    monkeypatch.setenv("HANDRAIL_ADDRESS", f"tcp://127.0.0.1:{stack.port}")
    for lesson in LESSONS:
        runpy.run_path(str(lesson), run_name="__main__")
    said = capsys.readouterr().out
    for words in (
        "approach: done",
        "back home: done",
        "home again: done",
        "fresh once that was executed: True",
        "succeeded: turned",
        "opened and closed",
    ):
        assert words in said
    assert abs(stack.truth().now().hinges["valve"]) > 2.5, said  # the valve of the plant, by two lessons' strokes


def test_every_call_of_the_client_stands_in_a_lesson() -> None:
    called = {
        node.attr
        for lesson in LESSONS
        for node in ast.walk(ast.parse(lesson.read_text()))
        if isinstance(node, ast.Attribute)
    }
    public = {name for name, member in vars(Client).items() if callable(member) and not name.startswith("_")}
    assert public - called - {"call", "close"} == set()


def test_every_lesson_stands_in_the_courses_list() -> None:
    listed = (COURSE / "README.md").read_text()
    assert [lesson.name for lesson in LESSONS if f"]({lesson.name})" not in listed] == []
