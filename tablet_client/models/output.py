"""What engines, nodes and the daemon say, line by line: which of it is asked for over the link, and which of that is shown.

Warnings and errors always come, and what the first engine says itself. What nodes and other engines print is asked for while its
level is switched on, from the chosen sources only.
"""

from __future__ import annotations

import glob
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from handrail.engines import FIRST
from handrail.link.selections import Selection
from handrail.messages import LogLine

LEVELS = ("info", "warning", "error")
KEPT = 5000
"""lines; of a flood the newest"""
SHOWN = 2000
"""lines of those, at most"""
_MOST_SOURCES = 8
"""that can be chosen at once: a selection has an end"""
_LONGEST = 4000
"""characters of a line"""


@dataclass(frozen=True)
class Line:
    """One line as it came."""

    number: int
    clock: str
    """time of day at the tablet"""
    level: str
    source: str
    text: str

    def written(self) -> str:
        """As it stands in a file."""
        return f"{self.clock} {self.level:7} {self.source}: {self.text}"


class Output:
    """The last lines, and the filter before them. `changed`: somebody has to subscribe anew."""

    def __init__(self, clock: Callable[[], str] = lambda: time.strftime("%H:%M:%S")):
        self._clock = clock
        self.levels: set[str] = {"warning", "error"}
        self.sources: list[str] = []
        """those that are chosen; none: all"""
        self.search = ""
        self.known: dict[str, int] = {FIRST: 0}
        """source → lines of it that have come"""
        self.kept: deque[Line] = deque(maxlen=KEPT)
        self.filtered = 0
        """how often the filter was changed"""
        self._number = 0
        self._held_at: int | None = None

    # --------------------------------------------------------------------------------------------------------- the link

    def wanted(self) -> tuple[Selection, ...]:
        """What has to travel for what is chosen, no line of it twice; warnings and errors for the history, whatever is chosen."""
        always = Selection(LogLine, where={"level": ("warning", "error")})
        told = Selection(LogLine, where={"level": ("info",), "source": (FIRST,)})
        if "info" not in self.levels:
            return always, told
        if not self.sources:
            return always, Selection(LogLine, where={"level": ("info",)})
        chosen = tuple(dict.fromkeys((FIRST, *map(glob.escape, self.sources))))
        return always, Selection(LogLine, where={"level": ("info",), "source": chosen})

    def take(self, line: LogLine) -> None:
        self._number += 1
        self.known[line.source] = self.known.get(line.source, 0) + 1
        self.kept.append(Line(self._number, self._clock(), line.level, line.source, line.text[:_LONGEST]))

    def hear_of(self, source: str) -> None:
        """There is such a source, though it has said nothing yet."""
        self.known.setdefault(source, 0)

    # -------------------------------------------------------------------------------------------------------- the filter

    def switch(self, level: str) -> None:
        """Show lines of this level, or no more."""
        if level in LEVELS:
            self.levels ^= {level}
            self.filtered += 1

    def choose(self, source: str) -> None:
        """Show this source among those chosen, or no more; empty: all. Of too many the one chosen first is left."""
        if not source:
            self.sources = []
        elif source in self.sources:
            self.sources = [each for each in self.sources if each != source]
        else:
            self.sources = [*self.sources, source][-_MOST_SOURCES:]
        self.filtered += 1

    def find(self, text: str) -> None:
        """Only lines with this text, whatever its case, in them or in their source."""
        self.search = text.strip().casefold()
        self.filtered += 1

    def hold(self, on: bool) -> None:
        """Show nothing that comes from now on, or go on; what comes is kept."""
        self._held_at = self._number if on else None
        self.filtered += 1

    @property
    def held(self) -> bool:
        return self._held_at is not None

    @property
    def waiting(self) -> int:
        """Lines that came while it was held, those that the filter leaves out among them."""
        return 0 if self._held_at is None else self._number - self._held_at

    def clear(self) -> None:
        """Forget all lines."""
        self.kept.clear()
        self.filtered += 1

    def shown(self, after: int = 0) -> list[Line]:
        """What passes the filter and came after line `after`, oldest first; at most the newest `SHOWN`."""
        found: list[Line] = []
        for line in self._backwards(after):
            if self._passes(line):
                found.append(line)
                if len(found) == SHOWN:
                    break
        return found[::-1]

    def _backwards(self, after: int) -> Iterator[Line]:
        for line in reversed(self.kept):
            if line.number <= after:
                return
            if self._held_at is None or line.number <= self._held_at:
                yield line

    def _passes(self, line: Line) -> bool:
        return (
            line.level in self.levels
            and (not self.sources or line.source in self.sources)
            and (not self.search or self.search in line.text.casefold() or self.search in line.source.casefold())
        )

    def written(self) -> str:
        """What is shown, as a text."""
        return "".join(f"{line.written()}\n" for line in self.shown())
