"""What every benchmark makes: rows for people and for machines, each against a goal."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
from rich.console import Console
from rich.table import Table


class Row(msgspec.Struct, kw_only=True):
    """One measured figure. `holds`: whether the goal is met."""

    name: str
    value: float
    unit: str
    goal: str
    holds: bool
    peer: str = ""
    """what it was measured against, in the same run"""
    peer_value: float | None = None
    ratio: float | None = None
    """value / peer_value"""


def against(
    name: str, value: float, unit: str, peer: str, peer_value: float, *, at_most: float, unnoticed: float = 0.0
) -> Row:
    """A row that holds when value / peer_value is at most `at_most`, or the value itself at most `unnoticed`."""
    ratio = value / peer_value
    return Row(
        name=name,
        value=round(value, 3),
        unit=unit,
        goal=f"ratio ≤ {at_most:g}, or {unnoticed:g} {unit}" if unnoticed else f"ratio ≤ {at_most:g}",
        holds=ratio <= at_most or value <= unnoticed,
        peer=peer,
        peer_value=round(peer_value, 3),
        ratio=round(ratio, 4),
    )


def show(console: Console, rows: Sequence[Row]) -> None:
    """A table for people."""
    table = Table()
    for heading in ("", "ours", "unit", "peer", "its", "ratio", "goal", "holds"):
        table.add_column(heading, justify="right" if heading in ("ours", "its", "ratio") else "left")
    for row in rows:
        peer_value = "" if row.peer_value is None else f"{row.peer_value:.3g}"
        ratio = "" if row.ratio is None else f"{row.ratio:.3f}"
        verdict = "[green]yes[/]" if row.holds else "[red]no[/]"
        table.add_row(row.name, f"{row.value:.3g}", row.unit, row.peer, peer_value, ratio, row.goal, verdict)
    console.print(table)
