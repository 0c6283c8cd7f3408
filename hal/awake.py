"""Waiting awake: who takes turns with another process asks for its turn for a moment before it goes to sleep.

To be woken on a core that has gone idle takes 50 µs on a virtual machine, and finds cold caches; to ask takes one or two. Between
two questions the core is offered to whoever else wants it. A process that is kept on a single core sleeps at once: whom it waits
for may need that core.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import Any

_AWAKE_S = 1e-3
"""the longest time awake: some turns of the other one"""
_LOOK_S = 0.1
"""between two looks at the cores that this process may use"""


class Awake:
    """The patience of one process, for one thing that it waits for again and again."""

    def __init__(self) -> None:
        self._hopeful = self._free = True
        self._next_look = 0.0

    def look(self, ready: Callable[[int], Any]) -> Any:
        """What `ready(0)` says as soon as that is true; what it said last when it is time to sleep."""
        now = time.monotonic()
        if now >= self._next_look:
            self._free, self._next_look = len(os.sched_getaffinity(0)) > 1, now + _LOOK_S
        events = ready(0)
        if self._free and self._hopeful:
            until = now + _AWAKE_S
            while not events and time.monotonic() < until:
                os.sched_yield()
                events = ready(0)
        # Where nothing has come in this time it will not come soon: until something has, nobody waits awake again.
        self._hopeful = bool(events)
        return events

    def woken(self) -> None:
        """What was waited for has come after all."""
        self._hopeful = True
