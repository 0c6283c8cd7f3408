"""The book of runs: what was known about each, and how it ended, in one SQLite file that outlives the robot's processes."""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from engines.learning.facts import Fact, Facts

_VERSION = 1
_BUSY_S = 10.0
_TABLES = """
CREATE TABLE run (
  id TEXT PRIMARY KEY, robot TEXT NOT NULL, program TEXT NOT NULL, hash TEXT NOT NULL, ended TEXT NOT NULL,
  duration_s REAL NOT NULL, status TEXT NOT NULL, detail TEXT NOT NULL
);
CREATE TABLE fact (
  run TEXT NOT NULL REFERENCES run(id) ON DELETE CASCADE, name TEXT NOT NULL, number REAL, word TEXT, unit TEXT NOT NULL,
  PRIMARY KEY (run, name)
);
CREATE INDEX run_of ON run (robot, program);
"""


class BookError(Exception):
    """The file can't be used; says which, and why."""


@dataclass(frozen=True)
class PastRun:
    """A run that has ended."""

    id: str
    robot: str
    program: str
    hash: str
    ended: str
    """UTC, ISO 8601"""
    duration_s: float
    """of the robot's clock"""
    status: str
    """succeeded, failed or stopped"""
    detail: str
    facts: Facts


def location() -> Path | None:
    """``$HANDRAIL_LEARNED`` (a file, or `off`: None), else `handrail/runs.sqlite` in this user's data folder."""
    chosen = os.environ.get("HANDRAIL_LEARNED", "")
    if chosen == "off":
        return None
    if chosen:
        return Path(chosen)
    home = os.environ.get("XDG_DATA_HOME") or Path.home() / ".local" / "share"
    return Path(home) / "handrail" / "runs.sqlite"


class RunBook:
    """One file. Every call opens it anew, so that any thread and any process may call. Raises BookError."""

    def __init__(self, file: Path):
        self.file = file

    def add(self, run: PastRun) -> None:
        """Keep a run; one of the same id is replaced (it was taken up again after its engine was killed)."""
        head = (run.id, run.robot, run.program, run.hash, run.ended, run.duration_s, run.status, run.detail)
        rows = [(run.id, name, *_split(fact), fact.unit) for name, fact in run.facts.items()]
        with self._open(write=True) as book:
            book.execute("INSERT OR REPLACE INTO run VALUES (?, ?, ?, ?, ?, ?, ?, ?)", head)
            book.execute("DELETE FROM fact WHERE run = ?", (run.id,))
            book.executemany("INSERT INTO fact VALUES (?, ?, ?, ?, ?)", rows)

    def runs(self, robot: str = "", program: str = "", last: int = 1000) -> list[PastRun]:
        """The last runs, oldest first; empty names: of all robots, all programs."""
        if not self.file.exists():
            return []
        where, wanted = "(? = '' OR robot = ?) AND (? = '' OR program = ?)", (robot, robot, program, program)
        chosen = f"SELECT * FROM run WHERE {where} ORDER BY ended DESC, rowid DESC LIMIT ?"
        with self._open() as book:
            heads = book.execute(chosen, (*wanted, last)).fetchall()
            facts: dict[str, dict[str, Fact]] = {head[0]: {} for head in heads}
            told = book.execute("SELECT fact.* FROM fact JOIN run ON run.id = fact.run WHERE " + where, wanted)
            for run, name, number, word, unit in told:
                if run in facts:
                    facts[run][name] = Fact(number if word is None else word, unit)
        return [PastRun(*(*head, facts[head[0]])) for head in reversed(heads)]

    def forget(self, robot: str = "", program: str = "") -> int:
        """Take runs out; returns how many."""
        if not self.file.exists():
            return 0
        with self._open(write=True) as book:
            where, wanted = "(? = '' OR robot = ?) AND (? = '' OR program = ?)", (robot, robot, program, program)
            return book.execute(f"DELETE FROM run WHERE {where}", wanted).rowcount

    @contextmanager
    def _open(self, *, write: bool = False) -> Iterator[sqlite3.Connection]:
        try:
            if write:
                self.file.parent.mkdir(parents=True, exist_ok=True)
            with closing(sqlite3.connect(self.file, timeout=_BUSY_S)) as book, book:
                book.execute("PRAGMA foreign_keys = ON")
                if write:
                    book.execute("BEGIN IMMEDIATE")
                (version,) = book.execute("PRAGMA user_version").fetchone()
                if version == 0 and not write:  # somebody may be making its tables just now
                    book.execute("BEGIN IMMEDIATE")
                    (version,) = book.execute("PRAGMA user_version").fetchone()
                if version not in (0, _VERSION):
                    raise BookError(f"{self.file}: format {version}; this version reads {_VERSION}")
                if version == 0:
                    for statement in filter(str.strip, _TABLES.split(";")):
                        book.execute(statement)
                    book.execute(f"PRAGMA user_version = {_VERSION}")
                yield book
        except (sqlite3.Error, OSError) as problem:
            raise BookError(f"{self.file}: {problem}") from problem


def _split(fact: Fact) -> tuple[float | None, str | None]:
    return (None, fact.value) if isinstance(fact.value, str) else (fact.value, None)
