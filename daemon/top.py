"""`handrail top`: what the processes of the robot that is up use, how often they died, and what they said last."""

from __future__ import annotations

import contextlib
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, NoReturn

import msgspec
import typer
from rich.console import Console
from rich.live import Live
from rich.table import Table

from daemon.serving.health import ProcessTold, read_processes
from daemon.supervisor import State
from handrail import usage
from handrail.runtime import Runtime

_ONCE_S = 0.5
"""over which --once counts processor time"""
_GONE = "gone"
_CPU_STEP, _MEMORY_STEP_MB = 2.0, 4.0
"""a process that uses no more or less by this is shown as before: rows change when something does"""


@dataclass(frozen=True)
class Row:
    """One process. What it has started itself (process nodes) follows in rows of their own."""

    name: str
    state: str
    process: int | None
    cpu: float
    """% of a core"""
    memory_mb: float
    """resident"""
    restarts: int
    up_s: int
    """wall time in its state"""
    last: str


class Processes:
    """Looks at all processes of a service, again and again."""

    def __init__(self, folder: Path):
        self._folder = folder
        self._used: dict[int, tuple[float, float]] = {}
        """process → monotonic s and processor s when it was last looked at"""

    def look(self) -> list[Row]:
        """As they are now; processor time is counted since the last look. Empty: no service runs here."""
        told = read_processes(self._folder)
        started = usage.descendants() if told else {}
        before, self._used = self._used, {}
        rows = []
        for each in told:
            rows.append(self._row(each, each.name, each.process, before))
            rows += self._below(each, started, before) if each.process is not None else []
        return rows

    def _below(
        self, told: ProcessTold, started: dict[int, list[tuple[int, str]]], before: dict[int, tuple[float, float]]
    ) -> list[Row]:
        rows, waiting = [], [(process, name, 1) for process, name in started.get(told.process or 0, ())]
        while waiting:
            process, name, depth = waiting.pop(0)
            of_its_own = ProcessTold(name, told.state, process, told.since, 0, "")
            row = self._row(of_its_own, "  " * depth + name, process, before)
            if row.state != _GONE:  # it ended by itself, while it was looked at
                rows.append(row)
            waiting = [(*each, depth + 1) for each in started.get(process, ())] + waiting
        return rows

    def _row(self, told: ProcessTold, name: str, process: int | None, before: dict[int, tuple[float, float]]) -> Row:
        cpu, memory_mb, state = 0.0, 0.0, told.state
        if process is not None:
            try:
                now, used = time.monotonic(), usage.processor_s(process)
                self._used[process] = now, used
                memory_mb = usage.resident_mb(process)
                at, used_then = before.get(process, (now, used))
                cpu = 100.0 * (used - used_then) / (now - at) if now > at else 0.0
            except OSError:  # and its supervisor has not said so (yet)
                state = _GONE
        up_s = max(0, int(time.time() - told.since))
        return Row(name, state, process, cpu, memory_mb, told.deaths, up_s, told.last)


def settled(before: list[Row], now: list[Row]) -> list[Row]:
    """The rows to show: each as it was shown before, unless something of it has changed that a person would look at."""
    shown = {(row.name, row.process): row for row in before}

    def same(old: Row, new: Row) -> bool:
        return (
            (old.state, old.restarts, old.last) == (new.state, new.restarts, new.last)
            and abs(old.cpu - new.cpu) < max(_CPU_STEP, 0.1 * old.cpu)
            and abs(old.memory_mb - new.memory_mb) < max(_MEMORY_STEP_MB, 0.02 * old.memory_mb)
        )

    rows = []
    for row in now:
        old = shown.get((row.name, row.process))
        rows.append(old if old is not None and same(old, row) else row)
    return rows


def _table(rows: list[Row]) -> Table:
    table = Table(box=None)
    for heading in ("process", "state", "number", "CPU", "memory", "died", "last words"):
        right = heading in ("number", "CPU", "memory", "died")
        table.add_column(heading, justify="right" if right else "left", no_wrap=True, overflow="ellipsis")
    for row in rows:
        colour = "" if row.state == State.UP.value else "yellow" if row.state == State.STARTING.value else "red"
        table.add_row(
            row.name,
            row.state,
            "" if row.process is None else str(row.process),
            f"{row.cpu:.0f} %",
            f"{row.memory_mb:.0f} MB",
            str(row.restarts) if row.restarts else "",
            row.last,
            style=colour,
        )
    return table


def top(
    runtime: Annotated[
        Path | None, typer.Option(help="Folder where the robot's processes meet (default: yours).")
    ] = None,
    once: Annotated[
        bool, typer.Option("--once", help="One look, for scripts. Exit status 0: all are up; 1: not.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="With --once: a line of JSON a process.")] = False,
    every: Annotated[float, typer.Option(min=0.1, help="Seconds between two looks.")] = 1.0,
) -> None:
    """Show the processes of the robot that is up, until Ctrl-C: state, processor, memory, deaths, last words.

    A row changes only when something of it does. Process nodes stand below their engine. Exit status 2: no robot is up.
    """
    console = Console()
    try:
        place = Runtime.at(runtime, make=False)
    except ValueError as problem:
        _refuse(str(problem))
    if json and not once:
        _refuse("--json: goes with --once")
    processes = Processes(place.folder)
    if not processes.look():
        _refuse(f"no robot is up in {place.folder}; start one (handrail up), or say where it is (--runtime)")
    time.sleep(_ONCE_S)
    rows = processes.look()
    if once:
        if json:
            for row in rows:
                print(msgspec.json.encode(asdict(row)).decode())
        else:
            console.width = max(console.width, 120)  # a table that is piped somewhere keeps its columns
            console.print(_table(rows))
        raise typer.Exit(int(not rows or any(row.state != State.UP.value for row in rows)))
    with contextlib.suppress(KeyboardInterrupt), Live(_table(rows), console=console, auto_refresh=False) as live:
        while rows:
            time.sleep(every)
            fresh = settled(rows, processes.look())
            if fresh != rows:
                live.update(_table(fresh), refresh=True)
            rows = fresh
    if not rows:
        print("the service has ended")


def _refuse(text: str) -> NoReturn:
    print(f"handrail top: {text}", file=sys.stderr)
    raise typer.Exit(2)
