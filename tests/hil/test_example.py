"""The documented example runs as users run it, and a test that fails leaves evidence that CAN tools and Foxglove open."""

import re
import subprocess
import sys
from pathlib import Path

import can
import pytest
from mcap.reader import make_reader

EXAMPLE = Path(__file__).parents[2] / "examples" / "test_my_controller.py"

FAILING = """
import pytest

@pytest.mark.handrail(scene="valve")
def test_that_fails(robot):
    robot.move("head_1_joint", 0.1, 0.2)
    assert robot.plant.truth().hinges["valve"] > 1.0

@pytest.mark.handrail(robo="talos_upper")
def test_that_is_marked_wrongly(plant):
    pass
"""


@pytest.mark.timeout(300)
def test_the_example_passes_and_a_failing_test_leaves_captures_and_a_recording(tmp_path):
    (tmp_path / "test_failing.py").write_text(FAILING)
    done = subprocess.run(
        [
            *(sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-c", "/dev/null"),
            *("--basetemp", str(tmp_path / "base"), str(EXAMPLE), str(tmp_path / "test_failing.py")),
        ],
        capture_output=True,
        text=True,
        timeout=290,
        check=False,
    )
    assert "2 passed" in done.stdout, done.stdout
    assert "1 failed" in done.stdout
    assert "robo; expected robot, scene, clock" in done.stdout
    evidence = dict(re.findall(r"^(capture|recording): (\S+)$", done.stdout, re.MULTILINE))
    with can.LogReader(evidence["capture"]) as log:
        assert sum(1 for _ in log) > 1000
    with open(evidence["recording"], "rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert {"/joint_states", "/daemon_status"} <= {channel.topic for channel in summary.channels.values()}
