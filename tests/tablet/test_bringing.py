"""Code of one engine brought to another from the window: read there, saved here, and refusals said."""

from __future__ import annotations

from typing import Any

import pytest

from handrail.messages import (
    BundleState,
    EngineInfo,
    Engines,
    GetEngines,
    GetNodeSource,
    GetProgram,
    GetReleases,
    NodeSource,
    ProgramSource,
    Release,
    Releases,
    SaveNode,
    SaveProgram,
)
from handrail.topics import refuse
from tablet_client.models.bringing import Bringing

SOURCE = ProgramSource(program="press", file="press.yaml", text="title: Press\n")


def due(bringing: Bringing) -> Any:
    (call,) = bringing.want()
    assert bringing.want() == [], "once"
    return call


def test_a_program_is_read_at_both_and_saved_over_what_the_other_has():
    bringing = Bringing()
    bringing.begin("press", "engine", "far")
    first = due(bringing)
    assert first == GetProgram(program="press", engine="engine") and bringing.busy
    bringing.begin("other", "engine", "far")
    bringing.take(GetProgram(program="press", engine="engine"), SOURCE)  # somebody else's
    assert bringing.want() == []
    bringing.take(first, SOURCE)
    there = due(bringing)
    assert there == GetProgram(program="press", engine="far")
    bringing.take(there, ProgramSource(program="press", file="press.yaml", text="title: Older\n"))
    save = due(bringing)
    assert isinstance(save, SaveProgram)
    assert (save.text, save.was, save.engine, save.note) == (SOURCE.text, "title: Older\n", "far", "as engine has it")
    bringing.take(save, BundleState())
    assert bringing.said == ("brought", "press", "far", "") and not bringing.busy


def test_a_node_that_the_other_does_not_have_is_new_there():
    bringing = Bringing()
    bringing.begin("nodes/contact", "engine", "far")
    first = due(bringing)
    assert first == GetNodeSource(node="contact", engine="engine")
    bringing.take(first, NodeSource(node="contact", file="contact.yaml", text="nodes: {}\n", builtin=False))
    there = due(bringing)
    assert bringing.failed(there, "no such node", refused=True)
    save = due(bringing)
    assert isinstance(save, SaveNode) and (save.was, save.wired, save.engine) == ("", True, "far")
    assert bringing.failed(save, "contact.yaml:3: no such part", refused=True)
    assert bringing.said == ("not_brought", "nodes/contact", "far", "contact.yaml:3: no such part")


def test_what_is_not_answered_ends_it():
    bringing = Bringing()
    bringing.begin("press", "engine", "far")
    first = due(bringing)
    bringing.take(first, SOURCE)
    assert bringing.failed(due(bringing), "no answer", refused=False)
    assert bringing.said[0] == "not_brought" and not bringing.failed(first, "late", refused=False)
    bringing.begin("press", "engine", "far")
    bringing.anew()
    assert bringing.said[0] == "not_brought" and not bringing.busy


@pytest.mark.window
def test_by_a_button_and_only_where_there_is_another_engine(robot: Any, show: Any) -> None:
    answer = robot.answer

    def answers(call: Any) -> Any:
        if isinstance(call, GetEngines):
            return Engines(engines=[EngineInfo(name="engine"), EngineInfo(name="far", host="rack")])
        if isinstance(call, GetReleases):
            there = call.engine == "engine"
            release = Release(number=3, program="press", bundle="3" * 32, by="ada", at_ns=0)
            return Releases(
                engine=call.engine, releases=[release] if there else [], programs={"press": "3" * 32} if there else {}
            )
        if isinstance(call, GetProgram):
            if call.engine == "far":
                raise refuse("no such program", "program", "press", "one of: none")
            return SOURCE
        if isinstance(call, SaveProgram):
            return BundleState(release=Release(number=1, program="press", bundle="3" * 32, by="ada", at_ns=0))
        return answer(call)

    robot.answer = answers
    shown = show()
    shown.press("tab_library")
    shown.page("library")
    shown.item("page_library").property("item").setProperty("part", "engines")
    shown.until(lambda: shown.there("bring_press_far"))
    shown.press("bring_press_far")
    shown.until(lambda: robot.calls_of(SaveProgram) or shown.desk.library.view["brought"]["code"] == "brought")
    shown.until(lambda: "press is at far now" in shown.item("brought").property("text").lower())
    assert not robot.stopped
