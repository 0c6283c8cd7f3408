"""`handrail campaign`: runs the fault campaign, goes on where it was interrupted, prints its table."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import msgspec
import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from benchmarks.campaign.kinds import KINDS

if TYPE_CHECKING:
    # All else is imported where it is used: plant and planner take seconds, help takes none.
    from benchmarks.campaign.run import Row


def campaign(
    runs: Annotated[
        int, typer.Option(min=1, help=f"How many runs; every {len(KINDS)} have each kind of fault once.")
    ] = 200,
    seed: Annotated[int, typer.Option(help="What the faults are drawn from.")] = 0,
    out: Annotated[
        Path, typer.Option(metavar="FILE", help="One line a run (JSON); what is there is not run again.")
    ] = Path("campaign.jsonl"),
    only: Annotated[str, typer.Option(help=f"Only this kind of fault: {', '.join(KINDS)}.")] = "",
    number: Annotated[list[int] | None, typer.Option(help="Only these runs, by number, and anew.")] = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Begin anew instead of going on.")] = False,
    workers: Annotated[int, typer.Option(min=1, max=64, help="Runs at the same time.")] = 2,
    write: Annotated[Path | None, typer.Option(metavar="PAGE", help="Put the table into this Markdown page.")] = None,
) -> None:
    """Lay each kind of fault on the robot at random moments of a short valve turn, and judge what the plant really did.

    Exit status 0: every run ended in success or in the safe state, never in motion beyond limits; 1: not.
    """
    from benchmarks.campaign.report import markdown, table, write_into

    console = Console()
    if only and only not in KINDS:
        raise typer.BadParameter(f"got {only!r}; expected one of {', '.join(KINDS)}", param_hint="--only")
    if fresh:
        out.unlink(missing_ok=True)
    done = {} if number else {row.case.number: row for row in _read(out, seed)}
    numbers = [i for i in (number or range(runs)) if i not in done and (not only or KINDS[i % len(KINDS)] == only)]
    rows = [row for i, row in done.items() if i < runs and (not only or row.case.kind == only)]
    if numbers:
        rows += _run(numbers, seed, out, min(workers, len(numbers)), console)
    rows.sort(key=lambda row: row.case.number)
    console.print(table(rows))
    for row in rows:
        if row.verdict.outcome == "unsafe":
            what = row.broken or "; ".join(row.verdict.problems)
            console.print(
                f"run {row.case.number}, {row.case.kind} at {row.case.at:g} s ({row.case.words}), ended {row.verdict.end}: {what}",
                style="red", markup=False, highlight=False, soft_wrap=True,
            )  # fmt: skip
    if write is not None:
        write_into(write, markdown(rows))
    if any(row.verdict.outcome == "unsafe" for row in rows):
        raise typer.Exit(1)


def _run(numbers: Sequence[int], seed: int, out: Path, workers: int, console: Console) -> list[Row]:
    """Run these cases, each written to the file as soon as it is over."""
    from benchmarks.campaign.cases import draw
    from benchmarks.campaign.run import Line, carry_out
    from benchmarks.campaign.turn import ROBOT, SCENE, plan
    from hal.hil.nursery import Nursery
    from hal.hil.rig import PLANT_MODULE
    from handrail.robot import library as robots

    with console.status("planning the stroke"):
        turn = plan()
    description = robots.load(ROBOT)
    rows: list[Row] = []
    progress = Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn(), console=console
    )
    nursery = Nursery()
    stopping = threading.Event()

    def one(number: int) -> Row | None:
        return None if stopping.is_set() else carry_out(draw(number, seed, description), turn, nursery)

    try:
        nursery.warm(
            [PLANT_MODULE, "daemon.loop"],
            [(f"{PLANT_MODULE}:warm_up", [ROBOT, SCENE]), ("daemon.hil:warm_up", [ROBOT])],
        )
        with progress, ThreadPoolExecutor(workers) as pool, out.open("ab") as file:
            if file.tell():
                file.write(b"\n")  # behind a line that was cut off; empty lines are passed over
            bar = progress.add_task("faults", total=len(numbers))
            try:
                for future in as_completed([pool.submit(one, number) for number in numbers]):
                    row = future.result()
                    assert row is not None
                    rows.append(row)
                    file.write(msgspec.json.encode(Line(seed=seed, row=row)) + b"\n")
                    file.flush()
                    bad = sum(row.verdict.outcome == "unsafe" for row in rows)
                    progress.update(bar, advance=1, description=f"faults ([red]{bad} unsafe[/])" if bad else "faults")
            except KeyboardInterrupt:
                stopping.set()
                nursery.close()  # the runs under way end with their processes, and are not written down
                console.print("interrupted; what is done is in the file, and the campaign goes on from there")
                raise typer.Exit(130) from None
    finally:
        nursery.close()
    return rows


def _read(file: Path, seed: int) -> Iterator[Row]:
    """The runs of a campaign that was begun earlier. A last line that was cut off does not count."""
    if not file.exists():
        return
    from benchmarks.campaign.run import Line

    for line in file.read_bytes().splitlines():
        try:
            read = msgspec.json.decode(line, type=Line)
        except msgspec.DecodeError:
            continue
        if read.seed == seed:
            yield read.row
