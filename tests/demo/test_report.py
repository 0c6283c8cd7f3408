"""What the demo leaves behind: rows, tables, plots, and lines of progress."""

from __future__ import annotations

import io
import json

import numpy as np
import pytest
from mcap.writer import Writer
from PIL import Image
from rich.console import Console

from handrail.demo import plots, report
from handrail.demo.progress import Scene, Show, line, table
from handrail.demo.verdict import Truth
from handrail.messages import DaemonStatus, DriveStatus, LoopStatistics, RobotInfo, RobotState, RunState
from handrail.recorder import Recording

ROW = report.Row(seed=4, turned_deg=301.5, success=True, peak_force_n=31.0, misses=2, real_time_factor=2.4)
FAILED = report.Row(
    seed=5, turned_deg=12.0, success=False, peak_force_n=120.0, misses=0, real_time_factor=2.0, problems=["no\nlog"]
)


def text_of(show, *arguments):
    console = Console(file=io.StringIO(), width=160)
    show(console, *arguments)
    return console.file.getvalue()


def test_rows_have_the_promised_names(tmp_path):
    report.write([ROW], tmp_path / "a" / "rows.json", tmp_path / "report.json")
    (row,) = json.loads((tmp_path / "a" / "rows.json").read_text())
    assert {"seed", "turned_deg", "success", "peak_force_n", "misses", "real_time_factor"} <= row.keys()
    assert row["turned_deg"] == 301.5
    assert (tmp_path / "report.json").read_bytes() == (tmp_path / "a" / "rows.json").read_bytes()


def test_the_verdict_on_one_run_names_its_numbers_and_problems():
    assert "The valve turned." in text_of(report.show_one, ROW)
    failed = text_of(report.show_one, FAILED)
    assert "did not turn" in failed
    assert "120.0 N" in failed


def test_the_table_counts_successes():
    text = text_of(report.show_many, [ROW, FAILED])
    assert "1 of 2 seeds turned the valve" in text
    assert "302°" in text


def recording(path, cycles=200):
    robot = RobotInfo(
        name="r",
        joints=["a", "b"],
        lower=[],
        upper=[],
        velocity_limit=[],
        torque_limit=[],
        groups={},
        tools={},
        tips={},
        arms={},
        home={},
        period_ns=1,
    )
    with path.open("wb") as stream:
        written = Recording(stream, 1_700_000_000_000_000_000)
        written.describe(robot, None)
        for cycle in range(1, cycles + 1):
            angle = np.sin(0.05 * cycle).item()
            written.take(
                RobotState(
                    time_ns=cycle * 10_000_000,
                    cycle=cycle,
                    position=[angle - 0.01, 0.5],
                    velocity=[0.0, 0.0],
                    torque=[0.0, 0.0],
                    command=[angle, 0.5],
                )
            )
        written.finish()
    return path


def test_joints_are_read_back_from_a_recording(tmp_path):
    joints = plots.read_joints(recording(tmp_path / "r.mcap"))
    assert joints.names == ("a", "b")
    assert joints.measured.shape == joints.commanded.shape == (200, 2)
    np.testing.assert_allclose(joints.measured[:, 0] - joints.commanded[:, 0], -0.01, atol=1e-9)
    np.testing.assert_allclose(np.diff(joints.time_s), 0.01, atol=1e-6)


def test_tracking_is_drawn_from_a_recording(tmp_path):
    plots.tracking(recording(tmp_path / "r.mcap"), tmp_path / "tracking.png")
    assert np.asarray(Image.open(tmp_path / "tracking.png").convert("L")).std() > 5


def test_a_recording_without_joints_is_named(tmp_path):
    with (tmp_path / "empty.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        writer.finish()
    with pytest.raises(ValueError, match=r"empty\.mcap: has no joint states"):
        plots.tracking(tmp_path / "empty.mcap", tmp_path / "tracking.png")


def test_seeds_are_drawn(tmp_path):
    plots.seeds([ROW, FAILED], tmp_path / "seeds.png")
    assert np.asarray(Image.open(tmp_path / "seeds.png").convert("L")).std() > 5


@pytest.fixture
def scene():
    run = RunState(
        run="r", deployment="d", program="turn_valve", hash="0", status="running", active=["turning", "stroking"]
    )
    status = DaemonStatus(
        time_ns=1,
        clock="lockstep",
        enabled=True,
        stopped=False,
        drives=[DriveStatus(joint="a", state="operation_enabled"), DriveStatus(joint="b", state="operation_enabled")],
        controllers={},
        loop=LoopStatistics(misses=3),
        buses=[],
    )
    return Scene("seed 0", run=run, status=status, truth=Truth(5.0, np.pi / 2, 12.0, 20.0), start_angle=0.0)


def test_progress_tells_state_angle_and_misses(scene):
    assert "turning > stroking" in line(scene)
    assert "valve  +90.0° (judge)" in line(scene)
    assert "3 misses" in line(scene)
    shown = text_of(lambda console: console.print(table(scene)))
    assert "turning › stroking" in shown
    assert "2 operation_enabled" in shown
    assert "ground truth" in shown


def test_progress_is_plain_lines_where_there_is_no_terminal(scene):
    console = Console(file=io.StringIO(), width=160)
    with Show(console, scene) as show:
        show.phase("starting")
        show.update()
        show.update()
        scene.run.active = ["done"]
        show.update()
    lines = console.file.getvalue().splitlines()
    assert lines[:2] == ["seed 0", "  starting"]
    assert len(lines) == 4  # one line a state, not one an update
    assert "\x1b" not in console.file.getvalue()
