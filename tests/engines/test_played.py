"""Programs played through with activities of the test's own; the example that shows it holds."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from engines.activities.base import ActivityFailed
from engines.programs.on_paper import Played

EXAMPLE = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "test_my_node.py"))


def test_the_example_of_a_nodes_and_a_programs_test_holds(tmp_path):
    EXAMPLE["test_a_peak_is_kept_and_fades"]()
    EXAMPLE["test_the_program_presses_again_until_the_node_finds_enough_force"](tmp_path)


@pytest.fixture
def program(tmp_path: Path) -> Path:
    file = tmp_path / "press_on.yaml"
    file.write_text(EXAMPLE["PROGRAM"])
    return file


def test_a_fake_that_fails_takes_the_programs_own_way_out(program):
    def failing(given):
        raise ActivityFailed("collision", "the door is in the way")

    played = Played(program, {"behave": failing, "node": lambda given: {"force": 9.0}}, arm="left")
    assert (played.outcome, played.visits) == ("failed", ["pressing"])


def test_a_fake_that_is_missing_is_named(program):
    with pytest.raises(ValueError, match="fakes: node is missing; expected all of behave, node"):
        Played(program, {"behave": lambda given: {}}, arm="left")


def test_a_program_that_runs_another_one_needs_fakes_of_what_is_done_alone(program, tmp_path, monkeypatch):
    (tmp_path / "rtc_programs").mkdir()
    program.rename(tmp_path / "rtc_programs" / program.name)
    outer = tmp_path / "outer.yaml"
    outer.write_text("""\
title: Outer
resources: {arm: {kind: arm}}
states:
  calling:
    do: program
    with: {program: press_on, bind: {arm: arm}}
    transitions: [{event: done.invoke.calling, target: good}, {event: error.execution, target: bad}]
  good: {final: true, outcome: succeeded}
  bad: {final: true, outcome: failed}
""")
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    played = Played(outer, {"behave": lambda given: {}, "node": lambda given: {"force": 9.0}}, arm="left")
    assert (played.outcome, played.visits) == ("succeeded", ["calling/pressing", "calling/looking"])
