"""What a run of the demo leaves behind for machines and people."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec
from rich.console import Console
from rich.table import Table

from handrail.demo.verdict import enough


class Row(msgspec.Struct, kw_only=True):
    """One run."""

    seed: int
    turned_deg: float
    """by the plant's ground truth, 1 s after the last release"""
    success: bool
    peak_force_n: float
    misses: int
    """of the daemon's loop"""
    real_time_factor: float
    """simulated time over wall time, from the program's start to its end"""
    drive_faults: int = 0
    """drives that were seen in a fault or a quick stop, or with an error"""
    simulated_s: float = 0.0
    wall_s: float = 0.0
    start_up_s: float = 0.0
    """wall, from the first process to the robot enabled"""
    clock: str = ""
    program: str = ""
    """the program's last word"""
    believed_deg: float | None = None
    """what the program believes that it turned"""
    prompts: int = 0
    """approved by the scripted operator"""
    position_error_mm: float = 0.0
    angle_error_deg: float = 0.0
    """how wrongly the template was placed"""
    problems: list[str] = []


def write(rows: Sequence[Row], *paths: Path) -> None:
    """Write the rows as a JSON list, to each of the paths."""
    text = msgspec.json.format(msgspec.json.encode(rows), indent=2)
    for path in paths:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(text + b"\n")


def show_one(console: Console, row: Row) -> None:
    """The verdict on one run, for people."""
    console.print()
    console.print("[bold green]The valve turned.[/]" if row.success else "[bold red]The valve did not turn.[/]")
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="dim", justify="right")
    grid.add_column()
    believed = "" if row.believed_deg is None else f"   (the program believes {row.believed_deg:.0f}°)"
    grid.add_row("turned", f"{row.turned_deg:.1f}° by the plant's ground truth, 1 s after the last release{believed}")
    grid.add_row("peak contact force", f"{row.peak_force_n:.1f} N")
    grid.add_row("loop misses", str(row.misses))
    grid.add_row("drive faults", str(row.drive_faults))
    grid.add_row(
        "time",
        f"{row.simulated_s:.1f} s simulated in {row.wall_s:.1f} s: {row.real_time_factor:.2f}× real time ({row.clock})",
    )
    grid.add_row("start-up", f"{row.start_up_s:.1f} s from the first process to the robot enabled")
    grid.add_row(
        "template placed", f"{row.position_error_mm:.0f} mm and {row.angle_error_deg:.1f}° off, unknown to the robot"
    )
    console.print(grid)
    for problem in row.problems:
        console.print(f"  problem: {problem}", style="yellow", markup=False, highlight=False, soft_wrap=True)


def show_line(console: Console, row: Row) -> None:
    """One of several runs, as soon as it is over."""
    told = "turned" if row.success else "did not turn"
    console.print(
        f"  seed {row.seed} {told}: {row.turned_deg:.0f}°, {row.peak_force_n:.0f} N, {row.real_time_factor:.2f}× real time",
        style="green" if row.success else "red",
        highlight=False,
    )
    for problem in row.problems:
        console.print(f"    {problem}", style="yellow", markup=False, highlight=False, soft_wrap=True)


def show_many(console: Console, rows: Sequence[Row]) -> None:
    """The verdict on several runs, for people."""
    table = Table(title="The demo, seed by seed", pad_edge=False)
    for name in ("seed", "turned", "success", "peak", "misses", "faults", "speed", "template off by"):
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(
            str(row.seed),
            f"{row.turned_deg:.0f}°",
            "[green]yes[/]" if row.success else "[red]no[/]",
            f"{row.peak_force_n:.0f} N",
            str(row.misses),
            str(row.drive_faults),
            f"{row.real_time_factor:.2f}×",
            f"{row.position_error_mm:.0f} mm, {row.angle_error_deg:.1f}°",
        )
    console.print()
    console.print(table)
    good = sum(row.success for row in rows)
    style = "green" if enough(good, len(rows)) else "red"
    console.print(f"[bold {style}]{good} of {len(rows)} seeds turned the valve.[/]")
