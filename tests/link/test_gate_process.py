"""The gate as the process that `handrail up` starts."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest


@pytest.fixture
def start(stand):
    """Start the gate's process; all that were started are ended."""
    started = []

    def start(port: int) -> subprocess.Popen:
        command = [sys.executable, "-m", "handrail.link.gate", "--runtime", str(stand.runtime.folder)]
        command += ["--port", str(port), "--keys", str(stand.keys)]
        started.append(subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.communicate()


def test_says_that_it_is_ready_serves_and_ends_on_sigterm(stand, start):
    stand.daemon()
    process = start(stand.port)
    assert process.stdout.readline() == "link ready\n"
    assert stand.client().robot().name == "talos_upper"
    process.send_signal(signal.SIGTERM)
    assert process.wait(5) == 0
    assert process.stdout.read() == ""


def test_a_port_that_is_taken_is_named(stand, start):
    stand.gate()
    process = start(stand.port)
    assert process.wait(20) == 1
    assert f"tcp://127.0.0.1:{stand.port}: can't listen there" in process.stderr.read()
