"""The campaign's table, for people at a terminal and for a page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.table import Table

from benchmarks.campaign.kinds import KINDS
from benchmarks.campaign.run import Row

COLUMNS = ("fault", "runs", "success", "safe state", "unsafe", "largest contact force", "fastest joint / its limit")
_BEGIN, _END = "<!-- campaign -->", "<!-- /campaign -->"


def lines(rows: Sequence[Row]) -> list[tuple[str, ...]]:
    """One line a kind, and the sum."""
    told = [_line(kind, [row for row in rows if row.case.kind == kind]) for kind in KINDS]
    return [line for line in told if line[1] != "0"] + [_line("all", rows)]


def _line(name: str, rows: Sequence[Row]) -> tuple[str, ...]:
    outcomes = [row.verdict.outcome for row in rows]
    force = max((row.verdict.peak_force_n for row in rows), default=0.0)
    speed = max((row.verdict.speed_share for row in rows), default=0.0)
    counts = (len(rows), *(outcomes.count(outcome) for outcome in ("success", "safe", "unsafe")))
    return (name, *(str(count) for count in counts), f"{force:.0f} N", f"{speed:.2f}")


def table(rows: Sequence[Row]) -> Table:
    """For the terminal."""
    shown = Table(title="The fault campaign", pad_edge=False)
    for name in COLUMNS:
        shown.add_column(name, justify="left" if name == "fault" else "right")
    for line in lines(rows):
        shown.add_row(*line, style="red" if line[4] != "0" else None)
    return shown


def markdown(rows: Sequence[Row]) -> str:
    """For a page."""
    head = [f"| {' | '.join(COLUMNS)} |", f"| --- |{' ---: |' * (len(COLUMNS) - 1)}"]
    return "\n".join([*head, *(f"| {' | '.join(line)} |" for line in lines(rows))])


def write_into(page: Path, text: str) -> None:
    """Replace what stands between the page's two marks. Raises ValueError where they are missing."""
    old = page.read_text(encoding="utf-8")
    begin, end = old.find(_BEGIN), old.find(_END)
    if not 0 <= begin < end:
        raise ValueError(f"{page}: no place for the table; expected the lines {_BEGIN} and {_END}")
    page.write_text(f"{old[: begin + len(_BEGIN)]}\n{text}\n{old[end:]}", encoding="utf-8")
