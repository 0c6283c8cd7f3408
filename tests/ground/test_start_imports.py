"""What a robot's processes do without: each import that only tools or an empty cache need would make every start slower."""

from __future__ import annotations

import subprocess
import sys

import pytest

_PROTOCOL = """
from hal.drives.protocol import LimbProtocol
from handrail.robot import library as robots
LimbProtocol(robots.load("talos_upper"))
"""


@pytest.mark.parametrize(
    ("modules", "then", "unwanted"),
    [
        (
            "hal.plant.world, hal.plant.service, daemon.loop, engines.engine, engines.planning.strokes.manipulation",
            _PROTOCOL,
            {"cantools", "can", "matplotlib", "networkx", "scipy.stats", "trimesh"},
        ),
        ("daemon.server", "", {"cantools", "numba", "pinocchio"}),
        ("handrail.link.gate", "", {"numba", "numpy"}),
    ],
    ids=["plant, loop and engine", "server", "link"],
)
def test_a_process_starts_without_what_only_tools_need(modules, then, unwanted):
    told = subprocess.run(
        [sys.executable, "-c", f"import sys, {modules}\n{then}\nprint(*sys.modules)"],
        capture_output=True,
        text=True,
        check=True,
        timeout=200,
    )
    assert not unwanted & set(told.stdout.split())
