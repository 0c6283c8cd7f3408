"""The actions that the loop was given and whose end has not been told yet, kept in a file of the runtime folder.

The loop knows an action by its serial number, everybody else by its id. The file lets a server that was started anew go on where
the old one was killed: it still cancels, pauses and reports by id.
"""

from __future__ import annotations

import os
from pathlib import Path

import msgspec

from handrail.messages import EndCondition


class Started(msgspec.Struct, frozen=True):
    """What must be known of an action while it runs."""

    serial: int
    id: str
    owner: str
    ends: list[EndCondition]
    joints: list[str] = []
    """that it moves"""
    steps: list[tuple[str, list[EndCondition]]] = []
    """of a behaviour: name and end conditions of each"""


class Journal:
    """Actions by serial and by id."""

    def __init__(self, file: Path):
        """Takes up what an earlier server left in `file`; a file that can't be read counts as empty."""
        self._file = file
        self._started: dict[int, Started] = {}
        try:
            left = msgspec.json.decode(file.read_bytes(), type=list[Started])
        except (FileNotFoundError, msgspec.DecodeError):
            left = []
        self._started = {started.serial: started for started in left}

    def begin(self, started: Started) -> None:
        """Remember an action before the loop gets it."""
        self._started[started.serial] = started
        self._write()

    def ended(self, serial: int) -> None:
        """Forget an action whose end has been told, or that the loop refused."""
        if self._started.pop(serial, None) is not None:
            self._write()

    def find(self, serial: int) -> Started | None:
        """The action that the loop knows by `serial`."""
        return self._started.get(serial)

    def named(self, action: str) -> Started | None:
        """The running action of this id."""
        return next((started for started in self._started.values() if started.id == action), None)

    def running(self) -> list[Started]:
        """All of them, in the order in which they began."""
        return list(self._started.values())

    def _write(self) -> None:
        fresh = self._file.with_suffix(".new")
        fresh.write_bytes(msgspec.json.encode(list(self._started.values())))
        os.replace(fresh, self._file)
