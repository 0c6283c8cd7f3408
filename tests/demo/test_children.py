"""Child processes of the demo: their words kept, their deaths told, none left behind."""

from __future__ import annotations

import contextlib
import os
import signal
import sys

import psutil
import pytest

from handrail.demo.children import ChildDied, Children


def python(code):
    return [sys.executable, "-c", code]


def test_a_line_that_is_waited_for_is_heard_and_kept_in_the_log(tmp_path):
    with Children(tmp_path) as children:
        child = children.start("plant", python("print('plant ready'); import signal; signal.pause()"))
        child.wait_for("plant ready", 10)
        child.check()
    assert (tmp_path / "plant.log").read_text() == "plant ready\n"


def test_a_child_that_dies_is_told_with_its_last_words(tmp_path):
    with Children(tmp_path) as children:
        child = children.start("plant", python("import sys; sys.exit('scene.yaml:3: no such kind')"))
        with pytest.raises(
            ChildDied, match=r"plant ended with status 1[\s\S]*scene.yaml:3: no such kind[\s\S]*plant.log"
        ):
            child.wait_for("plant ready", 10)


def test_a_child_that_stays_silent_is_given_up(tmp_path):
    with Children(tmp_path) as children:
        child = children.start("plant", python("import signal; signal.pause()"))
        with pytest.raises(ChildDied, match=r"did not say “plant ready” in 0\.1 s"):
            child.wait_for("plant ready", 0.1)


def test_nobody_is_left_behind_after_an_error_not_even_grandchildren_that_ignore_signals(tmp_path):
    stubborn = "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('here', flush=True); signal.pause()"
    code = (
        "import subprocess, sys, signal\n"
        f"child = subprocess.Popen([sys.executable, '-c', {stubborn!r}], stdout=subprocess.PIPE)\n"
        "child.stdout.readline()\n"
        "print('pid', child.pid, flush=True)\n"
        "signal.pause()\n"
    )
    lines = []
    with pytest.raises(RuntimeError), Children(tmp_path) as children:
        child = children.start("up", python(code), on_line=lines.append)
        child.wait_for("pid", 10)
        raise RuntimeError
    grandchild = int(lines[-1].split()[1])
    assert child.process.poll() is not None
    with contextlib.suppress(psutil.NoSuchProcess):  # gone already; else the kernel is about to end it
        psutil.Process(grandchild).wait(5)


def test_a_child_that_ignores_sigterm_is_killed(tmp_path):
    with Children(tmp_path) as children:
        code = "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('up', flush=True); signal.pause()"
        child = children.start("stubborn", python(code))
        child.wait_for("up", 10)
        child.end(patience_s=0.2)
        assert child.process.returncode == -signal.SIGKILL


def test_signals_to_our_group_do_not_reach_children(tmp_path):
    with Children(tmp_path) as children:
        child = children.start("plant", python("print('plant ready'); import signal; signal.pause()"))
        child.wait_for("plant ready", 10)
        assert os.getpgid(child.process.pid) != os.getpgid(0)
