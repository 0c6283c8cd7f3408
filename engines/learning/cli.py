"""`handrail learn`: what past runs tell about success."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from engines.learning.book import BookError, PastRun, RunBook, location
from engines.learning.predictors import CHANCE, FEWEST, splits

app = typer.Typer(
    help="What past runs of programs tell about success.", no_args_is_help=True, rich_markup_mode="markdown"
)
_out = Console()

Program = Annotated[str, typer.Argument(help="A program's name; none: all of them.", show_default=False)]
Robot = Annotated[str, typer.Option(help="Only runs of this robot.", show_default="any")]
Book = Annotated[
    Path | None, typer.Option(help="The book of runs.", show_default="$HANDRAIL_LEARNED, else this user's")
]


@app.command("list")
def list_(program: Program = "", robot: Robot = "", book: Book = None, last: int = 30) -> None:
    """The last runs: when, how long, how they ended."""
    table = Table(box=None, header_style="bold")
    for column in ("ended (UTC)", "robot", "program", "s", "", "detail"):
        table.add_column(column)
    for run in _runs(book, robot, program, last):
        style = {"succeeded": "green", "failed": "red"}.get(run.status, "yellow")
        when = run.ended[:19].replace("T", " ")
        table.add_row(
            when, run.robot, run.program, f"{run.duration_s:.1f}", f"[{style}]{run.status}[/]", escape(run.detail)
        )
    _out.print(table)


@app.command()
def report(
    program: Annotated[str, typer.Argument(help="A program's name.")],
    png: Annotated[Path | None, typer.Option(help="Plot success against every fact into this file.")] = None,
    robot: Robot = "",
    book: Book = None,
) -> None:
    """Which facts tell success from failure, and how surely; with --png as plots."""
    runs = _runs(book, robot, program, 1000)
    ended = [run for run in runs if run.status in ("succeeded", "failed")]
    if not ended:
        sys.exit(
            f"handrail learn report: no run of {program} has succeeded or failed yet; expected some (handrail learn list)"
        )
    succeeded = sum(run.status == "succeeded" for run in ended)
    _out.print(f"{program}: {succeeded} of {len(ended)} runs succeeded, {len(runs) - len(ended)} more were stopped")
    found = splits(ended)
    if not found:
        why = (
            f"at least {FEWEST} runs"
            if len(ended) < FEWEST
            else "runs that succeeded, runs that failed, facts that differ"
        )
        _out.print(f"nothing can be told from them: {why} are needed")
    else:
        table = Table(box=None, header_style="bold")
        for column in ("worst where", "failed", "others", "by chance", ""):
            table.add_column(column)
        for each in found:
            sure = "[red]warns[/]" if each.chance < CHANCE and 2 * each.failed > each.of else ""
            where = each.words().split(" with ", 1)[1].split(" failed", 1)[0]
            failed, others = f"{each.failed} of {each.of}", f"{each.others_failed} of {each.others}"
            table.add_row(where, failed, others, f"{each.chance:.2g}", sure)
        _out.print(table)
    if png is not None:
        from engines.learning.picture import draw

        try:
            draw(program, ended, found, png)
        except (OSError, ValueError) as problem:
            sys.exit(f"handrail learn report: {png}: {problem}")
        _out.print(f"plotted: {png}", soft_wrap=True)


@app.command()
def forget(program: Program = "", robot: Robot = "", book: Book = None) -> None:
    """Take runs out of the book: of a program, of a robot, or all."""
    try:
        gone = _book(book).forget(robot, program)
    except BookError as problem:
        sys.exit(f"handrail learn: {problem}")
    _out.print(f"{gone} runs forgotten")


def _book(book: Path | None) -> RunBook:
    file = book or location()
    if file is None:
        sys.exit("handrail learn: HANDRAIL_LEARNED is off; name a file with --book")
    return RunBook(file)


def _runs(book: Path | None, robot: str, program: str, last: int) -> list[PastRun]:
    try:
        return _book(book).runs(robot, program, last)
    except BookError as problem:
        sys.exit(f"handrail learn: {problem}")
