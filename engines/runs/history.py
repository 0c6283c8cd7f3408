"""What a run went through: each state with when it was entered, how long it lasted and what ended it."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable

import msgspec

from handrail.messages import StateVisit

_KEPT = 2000


class RunHistory:
    """The last visits of one run. Written by the thread that drives the run, read by any."""

    def __init__(self, clock: Callable[[], int]):
        """`clock`: ns of the robot's clock."""
        self._clock = clock
        self._lock = threading.Lock()
        self._visits: deque[StateVisit] = deque(maxlen=_KEPT)
        self._inside: dict[str, StateVisit] = {}

    def entered(self, state: str) -> None:
        """A state has become active."""
        with self._lock:
            self._inside[state] = StateVisit(state=state, entered_ns=self._clock())
            self._visits.append(self._inside[state])

    def left(self, state: str, event: str) -> None:
        """A state is left because of an event (empty: a guard alone)."""
        with self._lock:
            visit = self._inside.pop(state, None)
            if visit is not None:
                visit.left_ns, visit.event = self._clock(), event

    def visits(self) -> list[StateVisit]:
        """In the order in which states were entered; those that are active have no end yet."""
        with self._lock:
            return [msgspec.structs.replace(visit) for visit in self._visits]
