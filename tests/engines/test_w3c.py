"""W3C's SCXML tests come to their state `pass`: as programs, or whole in a process node where they say more than a program can."""

from __future__ import annotations

import ast
import shutil
import time
from pathlib import Path

import pytest

from engines.activities.base import ActivityFailed
from engines.nodes.node import load
from engines.programs import program
from engines.programs.library import named
from engines.programs.statechart import Chart
from engines.releases.closure import bundle_of
from engines.runs.clock import RunClock
from handrail import messages as m
from handrail.config import ConfigError

from .test_statechart import Step

FOLDER = Path(__file__).parent / "w3c"
W3C = [file for file in sorted(FOLDER.glob("*.scxml")) if "sub" not in file.stem]
"""the others are machines that some of them invoke"""
NODE = load(Path(__file__).parents[2] / "rtc_programs" / "nodes" / "statechart.py")


class Whole(Step):
    """Does what `do: node` does with the node of the program's one state, in this process."""

    def run(self):
        node, until = NODE(), time.monotonic() + 30.0
        node.put("params", {name: ast.literal_eval(value) for name, value in self.values["params"].items()})
        node.start()
        node.step()
        while "final" not in node.values:
            if time.monotonic() > until:
                raise ActivityFailed("late", "it did not end")
            time.sleep(node.every)
            node.step()
        return {"final": node.final}


def test_all_that_the_library_passes_are_here():
    whole = [file.stem for file in W3C if program.read(file).whole_because]
    assert (len(W3C), len(whole)) == (172, 108)


@pytest.mark.parametrize("file", W3C, ids=lambda file: file.stem)
def test_a_test_of_w3c_comes_to_its_state_pass(file):
    clock, found = RunClock(), program.read(file)
    values = {name: state.file.with_ for state in found.roots for name in [state.id]}
    chart, time_ns = Chart(found, found.variables, lambda state, _: Whole(state, values[state.id]), clock=clock), 0
    chart.begin()
    if found.whole_because:
        while chart.ended is False:
            assert chart.step(60.0)
    while chart.ended is False and time_ns < 10e9:
        if not chart.step(0.0):
            time_ns += 50_000_000
            clock.tick(time_ns)
    assert chart.ended.id == "pass"


@pytest.fixture
def library(tmp_path, monkeypatch):
    """A workspace with a program of W3C's that invokes another file, passing it a value."""
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    folder = tmp_path / "rtc_programs"
    folder.mkdir()
    for name in ("test276", "test276sub1"):
        shutil.copy(FOLDER / f"{name}.scxml", folder)
    return folder


def test_an_engine_runs_one_whole_in_a_process_of_its_own(stack, library):
    stack.call(m.Run(deployment=stack.call(m.Deploy(program="test276", bindings={})).id))
    assert stack.ended().status == "succeeded"


def test_what_it_names_beside_it_travels_with_it_and_counts_as_its_version(library):
    files = bundle_of("test276").manifest.files
    assert {*files} == {"rtc_programs/test276.scxml", "rtc_programs/test276sub1.scxml", "nodes/statechart.py"}
    before = named("test276").hash
    (library / "test276sub1.scxml").write_text("<scxml/>")
    assert named("test276").hash != before


def test_a_file_that_asks_for_an_activity_is_a_program_or_it_is_wrong(library):
    file = library / "test276.scxml"
    file.write_text(file.read_text().replace('type="scxml"', 'type="prompt"'))
    with pytest.raises(ConfigError, match=r"test276.scxml:8: <invoke>: no program has its attribute 'src'"):
        program.read(file)


def test_a_machine_that_fails_ends_as_the_programs_failure(stack, library):
    (library / "lost.scxml").write_text(
        '<scxml datamodel="python"><state id="s"><transition target="nowhere"/></state><final id="end"/></scxml>'
    )
    stack.call(m.Run(deployment=stack.call(m.Deploy(program="lost", bindings={})).id))
    end = stack.ended()
    assert end.status == "failed" and "nowhere" in end.detail
