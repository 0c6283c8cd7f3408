"""`handrail top`: the processes of a service with what they use, and rows that change only when something does."""

from __future__ import annotations

import os
import subprocess
import time
from dataclasses import replace
from pathlib import Path

import msgspec
import typer
from typer.testing import CliRunner

from daemon.serving.health import ProcessTold, clear_health, write_processes
from daemon.top import Processes, Row, settled, top
from engines.nodes import library
from engines.nodes.host import NodeProcess
from engines.nodes.launcher import LAUNCHER

app = typer.Typer()
app.command()(top)


def told(**changes: object) -> ProcessTold:
    """This very process, as a supervisor would tell of it."""
    return msgspec.structs.replace(
        ProcessTold("engine", "up", os.getpid(), time.time() - 60.0, 2, "engine: all is well"), **changes
    )


def test_a_row_has_what_its_process_uses_and_its_nodes_stand_below(tmp_path: Path) -> None:
    write_processes(tmp_path, [told(), told(name="link", process=None, state="back-off")])
    processes = Processes(tmp_path)
    with NodeProcess(library.find("low_pass")) as node:
        processes.look()
        began = time.process_time()
        while time.process_time() - began < 0.1:
            sum(range(10_000))
        rows = processes.look()
        below = {row.process: row for row in rows if row.name.startswith("  ")}
        assert below[node.process.pid].name.strip() == "low_pass" and LAUNCHER.warm_process in below
    first, last = rows[0], rows[-1]
    assert (first.name, first.restarts, first.last) == ("engine", 2, "engine: all is well")
    assert first.cpu > 0.5 and first.memory_mb > 10.0 and 60 <= first.up_s < 600
    assert (last.name, last.state, last.process, last.cpu) == ("link", "back-off", None, 0.0)


def test_rows_change_only_when_something_does() -> None:
    before = [Row("loop", "up", 7, 40.0, 200.0, 0, 5, "loop ready"), Row("link", "up", 8, 1.0, 50.0, 0, 5, "")]
    now = [replace(before[0], cpu=42.0, memory_mb=201.0, up_s=6), replace(before[1], cpu=30.0, up_s=6)]
    assert settled(before, now) == [before[0], now[1]]
    for change in ({"state": "back-off"}, {"restarts": 1}, {"last": "came back"}, {"memory_mb": 210.0}, {"process": 9}):
        changed = replace(before[0], **change)
        assert settled(before, [changed]) == [changed]


def test_one_look_is_for_scripts_and_says_by_its_status_whether_all_are_up(tmp_path: Path) -> None:
    def run(*words: str):
        return CliRunner().invoke(app, ["--runtime", str(tmp_path), *words])

    refused = run("--once")
    assert refused.exit_code == 2 and "no robot is up" in refused.output
    write_processes(tmp_path, [told()])
    good = run("--once")
    assert good.exit_code == 0 and "all is well" in good.output
    assert "all is well" in run().output, "nor does anybody look at a picture where there is no terminal"
    # Of a supervisor that was killed before it could say that its child had ended.
    child = subprocess.Popen(["true"])
    child.wait()
    write_processes(tmp_path, [told(), told(name="loop", process=child.pid)])
    bad = run("--once", "--json")
    assert bad.exit_code == 1
    row = next(each for each in map(msgspec.json.decode, bad.output.splitlines()) if each["name"] == "loop")
    assert (row["state"], row["restarts"]) == ("gone", 2)
    clear_health(tmp_path)
    assert run("--once").exit_code == 2
