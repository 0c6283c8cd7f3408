"""Calls and events of a robot that has several engines."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from handrail import engines
from handrail.client import connect
from handrail.messages import (
    AnswerPrompt,
    EngineCall,
    EngineInfo,
    Engines,
    GetEngines,
    GetNodes,
    Ok,
    PauseRun,
    Prompt,
    StopRun,
)
from handrail.topics import RefusedError


@pytest.fixture
def two(stand, tmp_path):
    """A robot with the engines `engine` and `vision`, a client of it, and what vision's lock says."""
    stand.daemon()
    first = stand.engine()
    vision = stand.service("vision", EngineCall)
    first.answers[GetEngines] = lambda _: Engines(
        engines=[EngineInfo(name="engine", program="press", status="running")]
    )
    vision.answers[GetEngines] = lambda _: Engines(engines=[EngineInfo(name="vision", release=3)])
    lock = Path(engines.lock(stand.runtime, "vision"))
    lock.write_text(f"{os.getpid()}\n")
    stand.gate()
    return first, vision, stand.client(), lock


def asked(service, kind):
    return [each for each in service.asked if isinstance(each, kind)]


def test_calls_go_to_the_engine_that_they_name(two, stand):
    first, vision, client, _ = two
    client.pause_run()
    client.at("vision").stop_run()
    assert client.at("vision").call(GetNodes()) == Ok()
    assert asked(vision, GetNodes) == [GetNodes(engine="vision")]
    with connect(f"{stand.address}/vision", stand.keys, timeout_s=30) as direct:
        direct.pause_run()
    assert (asked(first, PauseRun), asked(first, StopRun)) == ([PauseRun()], [])
    assert (asked(vision, PauseRun), asked(vision, StopRun)) == (
        [PauseRun(engine="vision")],
        [StopRun(engine="vision")],
    )


def test_an_answer_finds_the_engine_that_asked(two):
    first, vision, client, _ = two
    with client.events(Prompt) as prompts:
        vision.publish(Prompt(id="prompt-1@vision", run="run-1@vision", text="?", options=["go"]))
        client.answer(prompts.next(30).id, "go")
    assert not asked(first, AnswerPrompt)
    assert [each.id for each in asked(vision, AnswerPrompt)] == ["prompt-1@vision"]


def test_an_engine_that_is_not_there_is_refused_with_those_that_are(two):
    *_, client, _ = two
    with pytest.raises(RefusedError, match="field engine, value arm, expected one of: engine, vision"):
        client.at("arm").pause_run()


def test_all_are_listed_and_told_of_when_they_go_and_come_again(two):
    _, vision, client, lock = two
    # The first one holds no lock here, and answers all the same.
    assert [(each.name, each.up, each.release, each.program) for each in client.engines()] == [
        ("engine", True, 0, "press"),
        ("vision", True, 3, ""),
    ]
    with client.events(EngineInfo) as told:
        lock.write_text("999999999\n")  # killed: its lock is there, its process is not
        assert told.next(30) == EngineInfo(name="vision", up=False)
        with pytest.raises(RefusedError, match="no such engine"):
            client.at("vision").pause_run()
        lock.write_text(f"{os.getpid()}\n")
        assert told.next(30) == EngineInfo(name="vision", release=3)
    client.at("vision").pause_run()
    assert asked(vision, PauseRun)


@pytest.mark.parametrize("name", ["daemon", "Vision", "a/b", "", "much_too_long_a_name"])
def test_a_name_that_no_engine_can_have_is_refused(name):
    with pytest.raises(ValueError, match="engine: got"):
        engines.checked(name)
