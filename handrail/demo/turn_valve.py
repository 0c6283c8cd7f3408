"""`handrail demo`: the whole stack turns a valve, and the plant's ground truth judges it.

For each seed a fresh stack is started as its own processes (plant, daemon, engine, link, recorder); this process is a client like
any other: it places the template, deploys and runs the program, and approves its prompts. The judge hears the ground truth, which
the robot does not.
"""

from __future__ import annotations

import contextlib
import enum
import os
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from handrail.demo import one_run, plots, report, scenario
from handrail.demo.children import ChildDied, Children
from handrail.demo.progress import Scene, Show
from handrail.demo.verdict import enough


class Clock(enum.StrEnum):
    """How time passes."""

    LOCKSTEP = "lockstep"
    WALL = "wall"


def demo(
    seed: Annotated[
        int, typer.Option(min=0, help="Where the valve stands and how wrongly the template is placed.")
    ] = 0,
    seeds: Annotated[int, typer.Option(min=0, help="Run this many seeds, 0, 1, 2 ..., and show a table.")] = 0,
    clock: Annotated[
        Clock, typer.Option(help="lockstep: as fast as it can, the same way each time; wall: in real time.")
    ] = Clock.LOCKSTEP,
    view: Annotated[bool, typer.Option("--view", help="Open the operator's window on each run.")] = False,
    json: Annotated[Path | None, typer.Option(metavar="PATH", help="Write one row a run to this file.")] = None,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where recordings, pictures and logs go.")] = Path(
        "demo_output"
    ),
    timeout: Annotated[float, typer.Option(min=1, help="How long a program may take, s of wall time.")] = 300.0,
) -> None:
    """Turn a valve with the whole stack, and judge it by the plant's ground truth.

    Exit status 0: turned by 270° or more at 100 N or less (of several seeds: at least 95 %); 1: not; 130: interrupted.
    """
    console = Console()
    options = one_run.Options(clock=clock.value, view=view, timeout_s=timeout)
    chosen = list(range(seeds)) if seeds else [seed]
    rows: list[report.Row] = []
    targets = [out / "report.json", *([json] if json else [])]
    try:
        out.mkdir(parents=True, exist_ok=True)
        os.environ.setdefault("HANDRAIL_LEARNED", str(out.absolute() / "runs.sqlite"))  # the engines' own
        with _ended_in_order():
            for number in chosen:
                place = out / f"seed_{number:02d}" if seeds else out
                rows.append(_one(number, options, place, console, pictures=not seeds))
                report.write(rows, *targets)
                if seeds:
                    report.show_line(console, rows[-1])
    except KeyboardInterrupt:
        console.print("\ninterrupted; everything has been ended")
        raise typer.Exit(130) from None
    except OSError as problem:
        console.print(f"handrail demo: {problem}", style="red", markup=False)
        raise typer.Exit(1) from problem

    if seeds:
        plots.seeds(rows, out / "seeds.png")
        report.show_many(console, rows)
    else:
        report.show_one(console, rows[0])
    console.print(f"\nrecordings (open them with Foxglove), pictures and logs are in {out.absolute()}", highlight=False)
    if not enough(sum(row.success for row in rows), len(rows)):
        raise typer.Exit(1)


def _one(seed: int, options: one_run.Options, out: Path, console: Console, *, pictures: bool) -> report.Row:
    """One seed's run, and what is left of it in `out`."""
    out.mkdir(parents=True, exist_ok=True)
    # What an earlier run left must not be taken for this one's.
    for old in (out / "recording.mcap", *out.glob("*.png"), *out.glob("logs/*.log")):
        old.unlink(missing_ok=True)
    drawn = scenario.draw(seed)
    x, y, z = drawn.valve_in_world.position
    title = f"seed {seed}: valve at ({x:.2f}, {y:.2f}, {z:.2f}) m, {options.clock} clock"
    with Show(console, Scene(title)) as show:
        outcome = one_run.run(drawn, options, out, show)
        row = outcome.row
        if pictures or not row.success:
            show.phase("drawing pictures and plots")
            _draw(outcome, out, row)
    return row


def _draw(outcome: one_run.Outcome, out: Path, row: report.Row) -> None:
    moments = {"before.png": outcome.before, "after.png": outcome.after}
    truths = {out / name: truth for name, truth in moments.items() if truth is not None}
    with Children(out / "logs") as children:
        try:
            one_run.pictures(out / "scene.yaml", truths, children)
        except (ChildDied, subprocess.TimeoutExpired) as problem:
            row.problems.append(str(problem))
    if outcome.recording is not None:
        try:
            plots.tracking(outcome.recording, out / "tracking.png")
        except ValueError as problem:
            row.problems.append(f"tracking.png: {problem}")


@contextlib.contextmanager
def _ended_in_order() -> Iterator[None]:
    """SIGTERM ends the demo as Ctrl-C does: children first."""

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
