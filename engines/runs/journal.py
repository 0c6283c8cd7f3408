"""The run on disk, at every change: what an engine that was killed had under way is there, paused, when it is started anew."""

from __future__ import annotations

import logging
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from engines.programs import program as programs
from engines.programs import scxml
from engines.programs.deployment import Deployed
from engines.programs.program import Program
from engines.runs.edit import Waiting
from handrail.config import ConfigError
from handrail.messages import RunState

_log = logging.getLogger(__name__)


class Version(msgspec.Struct, kw_only=True):
    """Another version of the program, which waits until what is active has its place in it."""

    deployment: str
    program: str
    parts: dict[str, str]
    parameters: dict[str, Any]
    """that get these values with it"""
    release: str = ""
    """as of an Entry"""


class Entry(msgspec.Struct, kw_only=True):
    """A run as it stood last."""

    state: RunState
    bindings: dict[str, str]
    program: str
    """the program's text, as it was deployed: its file may be another one by now"""
    parts: dict[str, str] = {}
    """name → text of the programs that it runs"""
    release: str = ""
    """folder of the release that it was made from, where its nodes and behaviours are; "": of none"""
    edit: Version | None = None


class RunJournal:
    """One file, of the last run."""

    def __init__(self, folder: Path, prefix: str = ""):
        """`folder`: where the robot's processes meet; `prefix`: of the files' names, which tells the engines apart."""
        self._file = folder / f"{prefix}run.json"
        self._program = folder / f"{prefix}run"

    def write(self, deployed: Deployed, state: RunState, edit: Waiting | None = None) -> None:
        """Keep a run's state, and the version that waits. A disk that takes nothing is logged: the run goes on."""
        entry = Entry(
            state=state,
            bindings=dict(deployed.bindings),
            program=deployed.program.text,
            parts=dict(deployed.program.texts),
            release=str(deployed.folder or ""),
            edit=_version(edit) if edit else None,
        )
        fresh = self._file.with_suffix(".new")
        try:
            fresh.write_bytes(msgspec.json.encode(entry))
            os.replace(fresh, self._file)
        except OSError as full:
            _log.warning("the run could not be kept in %s: %s", self._file, full)

    def unfinished(self) -> tuple[Program, Entry] | None:
        """The run that was under way when the engine ended without ending it. Raises ValueError when it can't be read."""
        try:
            entry = msgspec.json.decode(self._file.read_bytes(), type=Entry)
        except FileNotFoundError:
            return None
        except (OSError, msgspec.DecodeError) as unreadable:
            raise ValueError(f"{self._file}: {unreadable}") from unreadable
        if entry.state.status not in ("ready", "running", "paused"):
            return None
        return _read(self._program, entry.state.program, entry.program, entry.parts), entry

    def edited(self, entry: Entry) -> Program | None:
        """The version that waited; None where none did. Raises ValueError when it can't be read."""
        edit = entry.edit
        if edit is None:
            return None
        return _read(
            self._program.with_name(f"{self._program.name}.edit"), entry.state.program, edit.program, edit.parts
        )


def _version(waiting: Waiting) -> Version:
    newer = waiting.newer
    return Version(
        deployment=newer.id,
        program=newer.program.text,
        parts=dict(newer.program.texts),
        parameters=dict(waiting.parameters),
        release=str(newer.folder or ""),
    )


def _read(folder: Path, program: str, text: str, parts: Mapping[str, str]) -> Program:
    """A program that was kept, written to files of their own in `folder` first. Raises ValueError."""
    folder.mkdir(exist_ok=True)
    files = {}
    for name, each in {**parts, program: text}.items():
        files[name] = folder / f"{name}{scxml.SUFFIX if each.lstrip().startswith('<') else '.yaml'}"
        files[name].write_text(each, encoding="utf-8")
    try:
        return programs.read(files[program], files)
    except ConfigError as unsound:
        raise ValueError(str(unsound)) from unsound
