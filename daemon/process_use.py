"""What the processes of a robot's service use, as Linux counts it, with those that they have started themselves."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from daemon.serving.health import ProcessTold, read_processes
from handrail import usage

GONE = "gone"
"""state of a process that has ended, which its supervisor has not said (yet)"""
_BELOW = "  "


@dataclass(frozen=True)
class Row:
    """One process. What it has started itself (process nodes) follows in rows of their own."""

    name: str
    state: str
    process: int | None
    cpu: float
    """% of a core"""
    memory_mb: float
    """resident"""
    restarts: int
    up_s: int
    """wall time in its state"""
    last: str

    @property
    def depth(self) -> int:
        """0: the service's own; n: started by one with n - 1."""
        return (len(self.name) - len(self.name.lstrip())) // len(_BELOW)


class Processes:
    """Looks at all processes of a service, again and again."""

    def __init__(self, folder: Path):
        self._folder = folder
        self._used: dict[int, tuple[float, float]] = {}
        """process → monotonic s and processor s when it was last looked at"""

    def look(self) -> list[Row]:
        """As they are now; processor time is counted since the last look. Empty: no service runs here."""
        told = read_processes(self._folder)
        started = usage.descendants() if told else {}
        before, self._used = self._used, {}
        rows = []
        for each in told:
            rows.append(self._row(each, each.name, each.process, before))
            rows += self._below(each, started, before) if each.process is not None else []
        return rows

    def _below(
        self, told: ProcessTold, started: dict[int, list[tuple[int, str]]], before: dict[int, tuple[float, float]]
    ) -> list[Row]:
        rows, waiting = [], [(process, name, 1) for process, name in started.get(told.process or 0, ())]
        while waiting:
            process, name, depth = waiting.pop(0)
            of_its_own = ProcessTold(name, told.state, process, told.since, 0, "")
            row = self._row(of_its_own, _BELOW * depth + name, process, before)
            if row.state != GONE:  # it ended by itself, while it was looked at
                rows.append(row)
            waiting = [(*each, depth + 1) for each in started.get(process, ())] + waiting
        return rows

    def _row(self, told: ProcessTold, name: str, process: int | None, before: dict[int, tuple[float, float]]) -> Row:
        cpu, memory_mb, state = 0.0, 0.0, told.state
        if process is not None:
            try:
                now, used = time.monotonic(), usage.processor_s(process)
                self._used[process] = now, used
                memory_mb = usage.resident_mb(process)
                at, used_then = before.get(process, (now, used))
                cpu = 100.0 * (used - used_then) / (now - at) if now > at else 0.0
            except OSError:  # and its supervisor has not said so (yet)
                state = GONE
        up_s = max(0, int(time.time() - told.since))
        return Row(name, state, process, cpu, memory_mb, told.deaths, up_s, told.last)
