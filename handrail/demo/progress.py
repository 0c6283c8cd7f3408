"""The demo as it runs: a live table on a terminal, plain lines anywhere else."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from handrail.demo.verdict import FORCE_LIMIT_N, NEEDED_DEG, Truth
from handrail.messages import DaemonStatus, RunState

_PLAIN_EVERY_S = 5.0


@dataclass
class Scene:
    """What there is to show."""

    title: str
    phase: str = ""
    run: RunState | None = None
    status: DaemonStatus | None = None
    truth: Truth | None = None
    start_angle: float = 0.0
    """rad, the hinge when the program began"""
    started_wall_s: float | None = None
    started_plant_s: float = 0.0
    notes: list[str] = field(default_factory=list)

    @property
    def turned_deg(self) -> float:
        return math.degrees(self.truth.angle - self.start_angle) if self.truth else 0.0

    @property
    def wall_s(self) -> float:
        return time.monotonic() - self.started_wall_s if self.started_wall_s is not None else 0.0

    @property
    def simulated_s(self) -> float:
        return self.truth.time_s - self.started_plant_s if self.truth and self.started_wall_s is not None else 0.0


class Show:
    """Shows a scene while it changes. Call `update` often; it decides what to print."""

    def __init__(self, console: Console, scene: Scene):
        self._console, self.scene = console, scene
        self._live = Live(console=console, refresh_per_second=8, get_renderable=lambda: table(scene), transient=True)
        self._plain = not console.is_terminal
        self._last_state: tuple[str, ...] = ()
        self._last_line_s = -math.inf

    def __enter__(self) -> Show:
        if self._plain:
            self._console.print(self.scene.title)
        else:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if not self._plain:
            self._live.stop()

    def phase(self, text: str) -> None:
        """What the demo itself does now."""
        self.scene.phase = text
        if self._plain:
            self._console.print(f"  {text}", highlight=False, markup=False, soft_wrap=True)

    def note(self, text: str) -> None:
        """Something worth keeping on the screen."""
        self.scene.notes.append(text)
        self._console.print(f"  {text}", highlight=False, markup=False, soft_wrap=True)

    def update(self) -> None:
        """Print a plain line when the program's state has changed or a while has passed."""
        if not self._plain:
            return
        state = tuple(self.scene.run.active) if self.scene.run else ()
        now = time.monotonic()
        if state != self._last_state or now - self._last_line_s >= _PLAIN_EVERY_S:
            self._last_state, self._last_line_s = state, now
            self._console.print(f"  {line(self.scene)}", highlight=False, markup=False, soft_wrap=True)


def line(scene: Scene) -> str:
    """The scene as one line."""
    parts = [f"{scene.simulated_s:6.1f} s simulated, {scene.wall_s:6.1f} s wall"]
    if scene.truth:
        parts.append(f"valve {scene.turned_deg:+6.1f}° (judge)")
    if scene.run:
        parts.append(f"{scene.run.status}: {' > '.join(scene.run.active) or '-'}")
    if scene.status:
        parts.append(f"{scene.status.loop.misses} misses")
    return " | ".join(parts)


def table(scene: Scene) -> RenderableType:
    """The scene as a table."""
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="dim", justify="right")
    grid.add_column()
    grid.add_row("now", scene.phase)
    if run := scene.run:
        believed = run.data.get("turned_deg")
        told = f"   believes {believed:.0f}°" if isinstance(believed, int | float) else ""
        states = " › ".join(run.active) or "-"
        grid.add_row("program", Text.assemble((run.program, "bold"), f"  {run.status}  ", (states, "cyan"), told))
    if truth := scene.truth:
        style = "green" if scene.turned_deg >= NEEDED_DEG else "yellow"
        bar = ProgressBar(total=NEEDED_DEG, completed=max(0.0, min(NEEDED_DEG, scene.turned_deg)), width=30)
        grid.add_row("valve", Text(f"{scene.turned_deg:+.1f}° of {NEEDED_DEG:g}°, by the judge's ground truth", style))
        grid.add_row("", bar)
        grid.add_row("contact", f"{truth.force:.0f} N now, {truth.peak_force:.0f} N at most (limit {FORCE_LIMIT_N:g})")
    if status := scene.status:
        loop = status.loop
        grid.add_row(
            "loop",
            f"{loop.cycles} cycles, {loop.misses} missed, {loop.stale_replies} stale replies, {loop.crc_errors} CRC errors, "
            f"work {loop.work_p50_us:.0f}/{loop.work_p99_us:.0f} µs p50/p99",
        )
        buses = ", ".join(f"{bus.channel} {bus.load:.0%}" for bus in status.buses)
        grid.add_row("drives", f"{drives(status)}   buses {buses or '-'}")
    factor = f"{scene.simulated_s / scene.wall_s:.1f}× real time" if scene.wall_s > 1 else ""
    grid.add_row("time", f"{scene.simulated_s:.1f} s simulated, {scene.wall_s:.1f} s wall   {factor}")
    return Group(Text(scene.title, "bold"), grid)


def drives(status: DaemonStatus) -> str:
    """The drives' states, counted, e.g. ``18 operation_enabled``."""
    states = [drive.state for drive in status.drives]
    return ", ".join(f"{states.count(state)} {state}" for state in dict.fromkeys(states)) or "-"
