"""The engine as a process: it says when it is ready, answers, and ends cleanly."""

from __future__ import annotations

import signal
import subprocess
import sys

from handrail.messages import GetEngine
from handrail.topics import Caller


def test_it_says_when_it_is_ready_and_ends_on_sigterm(runtime):
    command = [sys.executable, "-m", "engines.engine", "--robot", "talos_upper", "--runtime", str(runtime.folder)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "engine ready\n"
        caller = Caller(runtime.endpoint("engine.call"))
        assert caller.call(GetEngine()).run is None
        caller.close()
        process.send_signal(signal.SIGTERM)
        assert process.wait(10) == 0
        assert process.stdout.read() == ""
    finally:
        process.kill()
        process.wait()


def test_an_unknown_robot_is_told_with_those_that_there_are(runtime):
    command = [sys.executable, "-m", "engines.engine", "--robot", "nobody", "--runtime", str(runtime.folder)]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert ended.returncode == 2
    assert "talos_upper" in ended.stderr
