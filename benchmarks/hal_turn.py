"""Where the wall time of a turn goes in lock-step: ``handrail bench hal_turn``. About 20 s.

Plant, loop and server run as in `handrail bench hal`; plant and loop write down when each part of a turn is over
(benchmarks.turn_marks), by the one clock that they share. A turn is a period of the robot's, 2 ms of its time, from the moment at
which the loop has the drives' frames to the next such moment.

Its parts follow one another without a gap, so that their means add up to the whole turn's; where other work wants the cores, its
time is in whatever part it broke into. A hand-over is from the call that sends to the moment at which the other process has the
frames: the system calls on both sides, the hub's passing on, and whatever sleep there was between. What either does behind its
frames, while the other has its turn, costs wall time only where the other is done sooner: that is in the hand-over to it, and told
by itself, too. Last, how often either went to sleep, and how often another thread got its core, which it offers while it waits
awake.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.table import Table

from benchmarks import turn_marks
from benchmarks.hal import check_in_for, stack, sway
from benchmarks.rows import Row
from benchmarks.turn_marks import LoopMark, PlantMark
from handrail.topics import Caller

_TIMED_S = 5.0
_WHOLE = "whole turn"


@dataclass
class Account:
    """ns (turns,) each."""

    whole: npt.NDArray[np.int64]
    parts: dict[str, npt.NDArray[np.int64]]
    """one after the other; they add up to `whole`"""
    behind: dict[str, npt.NDArray[np.int64]]
    """what is done behind the frames that are sent, and what of it the other process had to wait for"""
    switches: dict[str, npt.NDArray[np.int64]]
    """how often, not ns"""


def account(loop: npt.NDArray[np.int64], plant: npt.NDArray[np.int64]) -> Account:
    """From the moments (turns, marks) of both processes, each in the order of time; turns that only one has are left out."""
    # The plant's turn that a loop's turn brings about is the first to hear after the sending.
    answer = np.searchsorted(plant[:, PlantMark.HEARD], loop[:, LoopMark.ENCODED])
    known = np.flatnonzero(answer[:-1] < len(plant))
    now, then, there = loop[known], loop[known + 1], plant[answer[known]]
    # Where the loop was restless (time was held, a reply was late), it is no usual turn.
    usual = then[:, LoopMark.HEARD] >= there[:, PlantMark.ENCODED]
    now, then, there = now[usual], then[usual], there[usual]
    ends = {
        "loop: decodes": now[:, LoopMark.DECODED],
        "loop: state, orders, end conditions": now[:, LoopMark.JUDGED],
        "loop: controllers, limits, guard": now[:, LoopMark.DECIDED],
        "loop: encodes": now[:, LoopMark.ENCODED],
        "hand-over, loop to plant": there[:, PlantMark.HEARD],
        "plant: decodes": there[:, PlantMark.DECODED],
        "plant: steps": there[:, PlantMark.STEPPED],
        "plant: encodes": there[:, PlantMark.ENCODED],
        "hand-over, plant to loop": then[:, LoopMark.HEARD],
    }
    began, parts = now[:, LoopMark.HEARD], {}
    for name, end in ends.items():
        parts[name], began = end - began, end
    behind = {
        "behind: loop sends": now[:, LoopMark.SENT] - now[:, LoopMark.ENCODED],
        "behind: loop publishes": now[:, LoopMark.PUBLISHED] - now[:, LoopMark.SENT],
        "behind: loop, until it waits again": then[:, LoopMark.WAITS] - now[:, LoopMark.PUBLISHED],
        "behind: the loop is not there yet for the plant's answer": np.maximum(
            0, then[:, LoopMark.WAITS] - there[:, PlantMark.SENT]
        ),
        "behind: plant sends": there[:, PlantMark.SENT] - there[:, PlantMark.ENCODED],
        "behind: the plant is not there yet for the loop's command": np.maximum(
            0, there[:, PlantMark.WAITS] - now[:, LoopMark.SENT]
        ),
    }
    switches = {
        "loop sleeps": then[:, LoopMark.SLEPT] - now[:, LoopMark.SLEPT],
        "loop gives way": then[:, LoopMark.OUSTED] - now[:, LoopMark.OUSTED],
        "plant sleeps": there[1:, PlantMark.SLEPT] - there[:-1, PlantMark.SLEPT],
        "plant gives way": there[1:, PlantMark.OUSTED] - there[:-1, PlantMark.OUSTED],
    }
    return Account(then[:, LoopMark.HEARD] - now[:, LoopMark.HEARD], parts, behind, switches)


class Part(Row, kw_only=True):
    """A part of the turn: `value` is its mean, `ratio` the mean's share of the whole turn's."""

    when: str
    """what the robot did meanwhile"""
    p10: float
    """what it takes where nothing breaks in, more or less"""
    p50: float
    p99: float


def rows() -> list[Part]:
    """For a robot that holds still, then for one that moves an arm: the whole turn, its parts, and what is done behind them."""
    with stack(marked=True) as (runtime, caller):
        spans = {"holding": _span(caller)}
        sway(caller)
        spans["an arm moves"] = _span(caller)
        accounts = {when: _read(runtime.folder, *span) for when, span in spans.items()}
    return [part for when, told in accounts.items() for part in _parts(when, told)]


def show(console: Console, rows: Sequence[Part]) -> None:
    """A table for people."""
    table = Table()
    table.add_column("wall time, µs a turn")
    for heading in ("mean", "share", "p10", "median", "p99"):
        table.add_column(heading, justify="right")
    for part in rows:
        if part.name == _WHOLE:
            table.add_section()
            table.add_row(f"[bold]{part.when}: {_WHOLE}[/]", *_figures(part))
        else:
            table.add_row(f"  {part.name}", *_figures(part))
    console.print(table)


def _figures(part: Part) -> tuple[str, ...]:
    if part.ratio is None:
        return f"{part.value:.2f} ×", "", f"{part.p10:.0f} ×", f"{part.p50:.0f} ×", f"{part.p99:.0f} ×"
    return f"{part.value:.1f}", f"{part.ratio:.1%}", f"{part.p10:.1f}", f"{part.p50:.1f}", f"{part.p99:.1f}"


def _span(caller: Caller) -> tuple[int, int]:
    began = time.perf_counter_ns()
    check_in_for(caller, _TIMED_S)
    return began, time.perf_counter_ns()


def _read(folder: Path, began: int, ended: int) -> Account:
    loop = turn_marks.read(turn_marks.loop_file(folder), LoopMark)
    plant = turn_marks.read(turn_marks.plant_file(folder), PlantMark)
    first, last = np.searchsorted(loop[:, LoopMark.HEARD], (began, ended))
    return account(loop[first:last], plant)


def _parts(when: str, told: Account) -> list[Part]:
    whole = float(told.whole.mean())
    timed = {_WHOLE: told.whole} | told.parts | told.behind
    return [
        *(_part(when, name, took * 1e-3, "µs", float(took.mean()) / whole) for name, took in timed.items()),
        *(_part(when, name, times, "times", None) for name, times in told.switches.items()),
    ]


def _part(when: str, name: str, each: npt.NDArray[Any], unit: str, share: float | None) -> Part:
    p10, p50, p99 = np.percentile(each, (10, 50, 99)).round(2).tolist()
    return Part(
        name=name,
        when=when,
        value=round(float(each.mean()), 2),
        unit=unit,
        goal="—",
        holds=True,
        ratio=None if share is None else round(share, 4),
        p10=p10,
        p50=p50,
        p99=p99,
    )
