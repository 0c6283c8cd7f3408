"""The run on disk, at every change: what an engine that was killed had under way is there, paused, when it is started anew."""

from __future__ import annotations

import logging
import os
from pathlib import Path

import msgspec

from engines.programs import program as programs
from engines.programs import scxml
from engines.programs.deployment import Deployed
from handrail.config import ConfigError
from handrail.messages import RunState

_log = logging.getLogger(__name__)


class Entry(msgspec.Struct, kw_only=True):
    """A run as it stood last."""

    state: RunState
    bindings: dict[str, str]
    program: str
    """the program's text, as it was deployed: its file may be another one by now"""
    parts: dict[str, str] = {}
    """name → text of the programs that it runs"""


class RunJournal:
    """One file, of the last run."""

    def __init__(self, folder: Path, prefix: str = ""):
        """`folder`: where the robot's processes meet; `prefix`: of the files' names, which tells the engines apart."""
        self._file = folder / f"{prefix}run.json"
        self._program = folder / f"{prefix}run"

    def write(self, deployed: Deployed, state: RunState) -> None:
        """Keep a run's state. A disk that takes nothing is logged: the run goes on."""
        entry = Entry(
            state=state,
            bindings=dict(deployed.bindings),
            program=deployed.program.text,
            parts=dict(deployed.program.texts),
        )
        fresh = self._file.with_suffix(".new")
        try:
            fresh.write_bytes(msgspec.json.encode(entry))
            os.replace(fresh, self._file)
        except OSError as full:
            _log.warning("the run could not be kept in %s: %s", self._file, full)

    def unfinished(self) -> tuple[programs.Program, Entry] | None:
        """The run that was under way when the engine ended without ending it. Raises ValueError when it can't be read."""
        try:
            entry = msgspec.json.decode(self._file.read_bytes(), type=Entry)
        except FileNotFoundError:
            return None
        except (OSError, msgspec.DecodeError) as unreadable:
            raise ValueError(f"{self._file}: {unreadable}") from unreadable
        if entry.state.status not in ("ready", "running", "paused"):
            return None
        self._program.mkdir(exist_ok=True)
        files = {}
        for name, text in {**entry.parts, entry.state.program: entry.program}.items():
            files[name] = self._program / f"{name}{scxml.SUFFIX if text.lstrip().startswith('<') else '.yaml'}"
            files[name].write_text(text, encoding="utf-8")
        try:
            return programs.read(files[entry.state.program], files), entry
        except ConfigError as unsound:
            raise ValueError(str(unsound)) from unsound
