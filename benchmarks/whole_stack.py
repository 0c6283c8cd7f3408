"""How fast the whole stack turns the valve in lock-step, and how soon it is ready: three seeds of the demo, one after the other."""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.rows import Row

_SEEDS = 3
_REAL_TIME_GOAL = 2.0
_START_UP_GOAL_S = 10.0


def rows() -> list[Row]:
    """Medians over the seeds. About a minute and a half."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "rows.json"
        command = [sys.executable, "-m", "handrail.cli", "demo", "--seeds", str(_SEEDS), "--json", str(report)]
        subprocess.run([*command, "--out", folder], check=True, stdout=subprocess.DEVNULL)
        runs = json.loads(report.read_text())
    speed = statistics.median(run["real_time_factor"] for run in runs)
    start_up = statistics.median(run["start_up_s"] for run in runs)
    turned = min(run["turned_deg"] for run in runs)
    return [
        Row(
            name="turning the valve, whole stack, lock-step",
            value=speed,
            unit="× real time",
            goal=f"≥ {_REAL_TIME_GOAL:g}",
            holds=speed >= _REAL_TIME_GOAL,
        ),
        Row(
            name="from the first process to the robot enabled",
            value=start_up,
            unit="s",
            goal=f"≤ {_START_UP_GOAL_S:g}",
            holds=start_up <= _START_UP_GOAL_S,
        ),
        Row(name="turned, the least", value=turned, unit="°", goal="≥ 270", holds=turned >= 270.0),
    ]
