"""`handrail top`: what the processes of the robot that is up use, how often they died, and what they said last."""

from __future__ import annotations

import contextlib
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, NoReturn

import msgspec
import typer
from rich.console import Console
from rich.live import Live
from rich.table import Table

from daemon.process_use import Processes, Row
from daemon.supervisor import State
from handrail.runtime import Runtime

_ONCE_S = 0.5
"""over which --once counts processor time"""
_CPU_STEP, _MEMORY_STEP_MB = 2.0, 4.0
"""a process that uses no more or less by this is shown as before: rows change when something does"""


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
    Where there is no terminal to show them on, it is one look, as with --once.
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
    if once or not console.is_terminal:
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
