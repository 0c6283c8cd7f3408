"""`handrail shell`, as a process of its own beside a gate."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

RUN = [sys.executable, "-c", "import typer; from handrail.shell import shell; typer.run(shell)"]


@pytest.fixture
def ask(stand, tmp_path):
    def ask(*words: str, typed: str = "") -> subprocess.CompletedProcess[str]:
        where = ("--connect", stand.address, "--keys", str(stand.keys))
        own = {**os.environ, "IPYTHONDIR": str(tmp_path / "ipython"), "NO_COLOR": "1", "TERM": "dumb"}
        return subprocess.run(
            [*RUN, *where, *words], input=typed, capture_output=True, text=True, timeout=120, env=own, check=False
        )

    return ask


def test_runs_a_line_on_the_robot_and_leaves(stand, ask):
    stand.daemon(), stand.engine(), stand.gate()
    done = ask("-c", "print(robot.robot().name, m.Pose().position)")
    assert (done.returncode, done.stdout.strip()) == (0, "talos_upper (0.0, 0.0, 0.0)"), done.stderr


def test_greets_takes_lines_and_shows_what_is_refused(stand, ask):
    stand.daemon(), stand.engine(), stand.gate()
    done = ask(typed="robot.plan('wheel_1', 'turn')\n6 * 7\nexit\n")
    assert done.returncode == 0, done.stderr
    for words in ("talos_upper at tcp://", "not enabled: robot.enable()", "out of reach", "42"):
        assert words in done.stdout


def test_a_line_that_fails_fails_the_command(stand, ask):
    stand.daemon(), stand.engine(), stand.gate()
    assert ask("-c", "robot.plan('wheel_1', 'turn')").returncode == 1


def test_an_address_that_is_none_is_told_in_a_line(ask):
    gone = ask("--connect", "robot", "-c", "1")
    assert gone.returncode == 1
    assert gone.stderr.startswith("handrail shell: address: 'robot'; expected tcp://HOST:PORT")
    assert "Traceback" not in gone.stderr
