"""Where a robot's processes meet."""

import os
from pathlib import Path

import pytest

from handrail.runtime import Runtime, memory_folder


def test_every_process_that_is_told_the_same_folder_finds_the_same_names(tmp_path, monkeypatch):
    folder = Path("/tmp") / f"hr-{os.getpid()}"
    monkeypatch.setenv("HANDRAIL_RUNTIME", str(folder))
    try:
        assert Runtime.at() == Runtime.at(folder)
        assert Runtime.at().endpoint("daemon.call") == f"ipc://{folder}/daemon.call"
    finally:
        folder.rmdir()


def test_a_folder_too_deep_for_unix_sockets_is_refused(tmp_path):
    with pytest.raises(ValueError, match="expected at most 86"):
        Runtime.at(tmp_path / ("x" * 90))


def test_a_folder_of_another_user_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "getuid", lambda: 4711)
    short = Path("/tmp") / f"hr-{os.getpid()}"
    try:
        with pytest.raises(ValueError, match="belongs to user"):
            Runtime.at(short)
    finally:
        short.rmdir()


def test_without_a_session_folder_the_runtime_lies_in_memory(monkeypatch):
    monkeypatch.delenv("XDG_RUNTIME_DIR", raising=False)
    assert memory_folder() == Path("/dev/shm")
