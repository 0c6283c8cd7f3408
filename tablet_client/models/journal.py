"""What happened, newest last: for the list beside the scene. Entries are codes with their details; the window has the words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Level = Literal["info", "good", "warning", "error"]

KEPT = 500


@dataclass(frozen=True)
class Entry:
    """One line. `code` `log` means that `details[0]` is the text itself, from the robot."""

    number: int
    clock: str
    """time of day at the tablet"""
    level: Level
    code: str
    details: tuple[str, ...] = ()


class Journal:
    """The last few hundred entries."""

    def __init__(self) -> None:
        self.entries: list[Entry] = []
        self._number = 0

    def add(self, clock: str, level: Level, code: str, *details: str) -> Entry:
        self._number += 1
        entry = Entry(self._number, clock, level, code, details)
        self.entries.append(entry)
        del self.entries[:-KEPT]
        return entry
