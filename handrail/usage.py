"""What a process uses, as Linux counts it in /proc."""

from __future__ import annotations

import contextlib
import os
import re
import time
from collections import deque
from pathlib import Path

_TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")
_PAGE_MB = os.sysconf("SC_PAGE_SIZE") / 1e6


def processor_s(process: int) -> float:
    """Processor time of all its threads so far. Raises OSError when it has ended."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) * _TICK_S


def resident_mb(process: int) -> float:
    """Resident memory, shared with others or not: cheap. Raises OSError when it has ended."""
    return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * _PAGE_MB


def memory_mb(process: int) -> tuple[float, float]:
    """(of its own alone: USS, its share of what several have: PSS). Dear: the kernel walks all pages. Raises OSError."""
    text = Path(f"/proc/{process}/smaps_rollup").read_text()
    found = {name: int(kb) * 1024 / 1e6 for name, kb in re.findall(r"^(\w+):\s+(\d+) kB", text, re.MULTILINE)}
    return found["Private_Clean"] + found["Private_Dirty"], found["Pss"]


def descendants() -> dict[int, list[tuple[int, str]]]:
    """Process → those that it has started and that still run: number and name (`comm`: 15 letters)."""
    found: dict[int, list[tuple[int, str]]] = {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            with contextlib.suppress(OSError):  # it has just ended
                front, _, back = (folder / "stat").read_text().rpartition(")")
                found.setdefault(int(back.split()[1]), []).append((int(folder.name), front.partition("(")[2]))
    return found


def show_as(name: str) -> None:
    """What ps, top, `handrail top` and the tablet call this process (15 letters of it). Call it on its first thread."""
    with contextlib.suppress(OSError):
        Path("/proc/self/comm").write_text(name)


class Watch:
    """Samples of one process, the last few of which say how busy it has been."""

    def __init__(self, process: int, window_s: float):
        """:param window_s: over which the share of a core is told"""
        self._process, self._window_s = process, window_s
        self._base_mb = resident_mb(process)
        self._samples: deque[tuple[float, float]] = deque([(time.monotonic(), processor_s(process))])
        self.own_mb = 0.0
        """resident beyond what it had when this watch began"""

    def sample(self) -> None:
        """Raises OSError when it has ended."""
        now = time.monotonic()
        self._samples.append((now, processor_s(self._process)))
        while len(self._samples) > 2 and now - self._samples[1][0] >= self._window_s:
            self._samples.popleft()
        self.own_mb = max(0.0, resident_mb(self._process) - self._base_mb)

    @property
    def whole(self) -> bool:
        """Samples reach back as far as the window does."""
        return self._samples[-1][0] - self._samples[0][0] >= self._window_s

    @property
    def share(self) -> float:
        """Of a core, over the window."""
        (began, before), (now, used) = self._samples[0], self._samples[-1]
        return (used - before) / (now - began) if now > began else 0.0
