"""`handrail bench NAME`: runs a benchmark of this folder; exit status 0 only when every goal holds."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.console import Console

import benchmarks
from benchmarks.rows import show

_NOT_BENCHMARKS = {
    "cli", "deploying", "engines_peer", "peers", "planning_peers", "rows", "sea_pictures", "tablet_peer",
    "tablet_scene", "turn_marks", "wake_ups", "wbc_peers",
}  # fmt: skip


def names() -> list[str]:
    """The benchmarks that there are."""
    return sorted(
        module.name for module in pkgutil.iter_modules(benchmarks.__path__) if module.name not in _NOT_BENCHMARKS
    )


def bench(
    name: Annotated[str, typer.Argument(help="Which benchmark; leave it out to see what there is.")] = "",
    json: Annotated[Path | None, typer.Option(metavar="PATH", help="Write the rows to this file, too.")] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Write pictures here, for a benchmark that draws some.")
    ] = None,
) -> None:
    """Measure against peers in one run, and print a table. Exit status 0: every goal holds; 1: not; 2: no such benchmark."""
    console = Console()
    console.width = max(console.width, 120)  # a table that is piped somewhere keeps its columns
    if name not in names():
        console.print(f"handrail bench: got {name!r}; expected one of {', '.join(names())}", markup=False)
        raise typer.Exit(2)
    benchmark = importlib.import_module(f"benchmarks.{name}")
    measure = benchmark.rows
    draws = "out" in inspect.signature(measure).parameters
    if out and not draws:
        console.print(f"handrail bench: --out {out}: {name} draws no pictures; leave it out", markup=False)
        raise typer.Exit(2)
    rows = measure(out=out) if draws else measure()
    getattr(benchmark, "show", show)(console, rows)  # some have a table of their own
    if json:
        json.write_bytes(msgspec.json.format(msgspec.json.encode(rows), indent=2) + b"\n")
    if not all(row.holds for row in rows):
        raise typer.Exit(1)
