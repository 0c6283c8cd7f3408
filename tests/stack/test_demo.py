"""The demo as a user runs it: the valve really turns, and what it leaves behind can be opened."""

import json
import os
import subprocess
import sys

import pytest
from mcap.reader import make_reader
from PIL import Image

pytestmark = [pytest.mark.stack]


def demo(folder, *arguments: str, timeout_s: float, **environment: str) -> tuple[int, list[dict], str]:
    done = subprocess.run(
        [
            *(sys.executable, "-m", "handrail.cli", "demo", *arguments),
            *("--out", str(folder / "out"), "--json", str(folder / "rows.json")),
        ],
        capture_output=True,
        text=True,
        timeout=timeout_s,
        check=False,
        env={**os.environ, **environment},
    )
    rows = json.loads((folder / "rows.json").read_text()) if (folder / "rows.json").exists() else []
    return done.returncode, rows, done.stdout + done.stderr


@pytest.mark.timeout(600)
def test_the_valve_turns_in_lock_step_and_leaves_a_recording_pictures_and_a_plot(tmp_path):
    status, rows, text = demo(tmp_path, "--timeout", "500", timeout_s=580)
    assert status == 0, text
    (row,) = rows
    assert row["seed"] == 0
    assert row["success"], text
    assert row["turned_deg"] >= 270
    assert row["peak_force_n"] <= 100
    assert row["misses"] == 0
    assert row["real_time_factor"] > 0
    left_behind(tmp_path / "out")
    replayed = subprocess.run(
        [sys.executable, "-m", "handrail.cli", "replay", str(tmp_path / "out" / "recording.mcap"), "--cycles", "4000"],
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert replayed.returncode == 0, replayed.stdout + replayed.stderr
    assert "4000 cycles (8.0 s) compared: every command is the same" in replayed.stdout


@pytest.mark.soak
@pytest.mark.timeout(300)
def test_the_valve_turns_on_the_wall_clock(tmp_path):
    status, rows, text = demo(tmp_path, "--seed", "3", "--clock", "wall", timeout_s=280)
    assert status == 0, text
    assert rows[0]["turned_deg"] >= 270
    assert isinstance(rows[0]["misses"], int)
    left_behind(tmp_path / "out")


def left_behind(out):
    """Pictures that show something, and a recording that any reader of MCAP opens."""
    for picture in ("before.png", "after.png", "tracking.png"):
        with Image.open(out / picture) as image:
            assert len(image.convert("RGB").getcolors(1 << 24)) > 20, f"{picture} shows something"
    with (out / "recording.mcap").open("rb") as stream:
        summary = make_reader(stream).get_summary()
        assert summary is not None
        counts = {
            channel.topic: summary.statistics.channel_message_counts.get(number, 0)
            for number, channel in summary.channels.items()
        }
    assert sum("joint" in topic for topic in counts), counts
    assert max(counts.values()) > 1000


@pytest.mark.soak
@pytest.mark.timeout(1200)
def test_nothing_is_compiled_in_mid_motion_on_a_machine_where_nothing_is_compiled_yet(tmp_path):
    """A kernel compiled while the robot moves would hold the loop up until the drives' watchdogs trip."""
    status, rows, text = demo(tmp_path, "--seed", "0", timeout_s=1180, NUMBA_CACHE_DIR=str(tmp_path / "kernels"))
    assert status == 0, text
    assert rows[0]["drive_faults"] == 0
    compiled = list((tmp_path / "kernels").rglob("*.nbc"))
    assert len(compiled) > 20, "the kernels were compiled anew"
