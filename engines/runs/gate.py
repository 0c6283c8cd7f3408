"""Where a run's activities wait before they begin: while the run is paused, at a breakpoint, and after a single step."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Sequence


class RunGate:
    """Open while the run goes on. Every method may be called from any thread."""

    def __init__(self, waits: Callable[[str], None]):
        """`waits`: told, by an activity's own thread, that it waits, and why where the gate has closed because of it."""
        self._waits = waits
        self._changed = threading.Condition()
        self._open, self._stepping = True, False
        self._waiting: dict[threading.Event, str] = {}
        """each waiting activity's cancellation → its state"""
        self._breakpoints: frozenset[str] = frozenset()

    def admit(self, state: str, cancelled: threading.Event, within: Sequence[str] = ()) -> bool:
        """Wait until a state's activity may begin; False when it was cancelled instead (see `wake`).

        :param within: states around it that begin with it
        """
        why = ""
        with self._changed:
            halt = next((each for each in (state, *within) if each in self._breakpoints), None)
            if self._open and (self._stepping or halt):
                why = f"one step on, before {state}" if self._stepping else f"breakpoint at {halt}"
                self._open = self._stepping = False
            if self._open:
                return not cancelled.is_set()
            self._waiting[cancelled] = state
        self._waits(why)
        with self._changed:
            self._changed.wait_for(lambda: cancelled not in self._waiting or cancelled.is_set())
            self._waiting.pop(cancelled, None)
            return not cancelled.is_set()

    def wake(self) -> None:
        """An activity was cancelled: should it still wait here, it looks."""
        with self._changed:
            self._changed.notify_all()

    def close(self) -> None:
        """No activity begins any more."""
        with self._changed:
            self._open = self._stepping = False

    def shut(self, why: str) -> None:
        """No activity begins any more, since one has found out why none should."""
        with self._changed:
            if not self._open:
                return
            self._open = self._stepping = False
        self._waits(why)

    def open(self, *, one_step: bool = False) -> None:
        """Let those go on that wait, and those that come; `one_step`: the next that comes closes the gate again."""
        with self._changed:
            self._open, self._stepping = True, one_step
            self._waiting.clear()
            self._changed.notify_all()

    def waiting(self) -> list[str]:
        """States whose activity has not been let in yet; none that was left meanwhile."""
        with self._changed:
            return sorted(state for cancelled, state in self._waiting.items() if not cancelled.is_set())

    @property
    def is_open(self) -> bool:
        """Whether activities begin."""
        with self._changed:
            return self._open

    @property
    def breakpoints(self) -> list[str]:
        """States before whose activity the gate closes."""
        return sorted(self._breakpoints)

    def set_breakpoints(self, states: Iterable[str]) -> None:
        """Replace them all."""
        self._breakpoints = frozenset(states)
