"""What states do: an activity for each visit, in a thread of its own, which posts how it ended.

python-statemachine has `invoke` for that. It starts a thread for each and joins it before the next state is entered, which takes as
long as the rest of a transition: here threads are kept for the next activity, and one that ends slowly keeps nobody waiting.
"""

from __future__ import annotations

import functools
import logging
import queue
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from engines.activities.base import Activity, ActivityFailed
from engines.programs.program import State
from handrail.topics import Unreachable

if TYPE_CHECKING:
    from engines.programs.statechart import Chart

_IDLE_S = 2.0
"""after which a thread that nobody needs ends"""
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Event:
    """Something that happened, for the machine."""

    name: str
    data: Mapping[str, Any] = field(default_factory=dict)
    left: threading.Event | None = None
    """set once the visit of a state that it is about has ended: then nothing follows, even where the state is active anew"""


class Doing:
    """The activities of one chart's states. One that was left may still be at its end when its state is entered anew."""

    def __init__(self, chart: Chart):
        self._chart, self._threads = chart, _Threads()
        self._entered: dict[threading.Event, State] = {}
        """visit of a state that was entered in this macrostep → the state"""
        self._lock = threading.Lock()
        self._running: dict[threading.Event, tuple[State, Activity | None]] = {}
        """visit → the state, and its activity, once that was made"""
        self._abandoned = False

    # ------------------------------------------------------------------------------------------- called by the driving thread

    def entered(self, state: State, left: threading.Event) -> None:
        """A state becomes active that does something; `left` is set when it is left."""
        self._entered[left] = state

    def begin(self) -> None:
        """The macrostep is over: what was entered in it, and is active still, is done."""
        entered, self._entered = self._entered, {}
        for left, state in entered.items():
            with self._lock:
                if self._abandoned:
                    return
                self._running[left] = (state, None)
            self._threads.run(functools.partial(self._run, state, left))

    def belongs_to(self, chart: Chart) -> None:
        """The states are another chart's from now on, of a newer version of the program; what they do goes on."""
        self._chart = chart

    def left(self, left: threading.Event) -> None:
        """A state was left, and `left` is set: what it does is cancelled."""
        if self._entered.pop(left, None) is None:
            self._cancel([left])

    def abandon(self) -> None:
        """Cancel what runs, though the machine does not leave the states, and begin nothing more."""
        with self._lock:
            self._abandoned, visits = True, list(self._running)
        for left in visits:
            left.set()
        self._cancel(visits)

    def _cancel(self, visits: list[threading.Event]) -> None:
        self._chart.gate.wake()
        with self._lock:
            over = [activity for left in visits if (activity := self._running.get(left, (None, None))[1]) is not None]
        for activity in over:
            if activity.cancelled.is_set():
                continue
            try:
                activity.cancel()
            except Unreachable as silent:
                _log.warning("%s was cancelled: %s", type(activity).__name__, silent)
            except Exception:  # noqa: BLE001
                # A defect in an activity must not keep the program in the state that it leaves.
                _log.exception("%s could not be cancelled", type(activity).__name__)

    def present(self) -> list[tuple[State, Activity | None]]:
        """What active states do: None where they have not begun it yet. Called by any thread."""
        with self._lock:
            return [doing for left, doing in self._running.items() if not left.is_set()]

    # ------------------------------------------------------------------------------------------ called by activities' threads

    def _run(self, state: State, left: threading.Event) -> None:
        ended = self._outcome(state, left)
        self._chart.post(replace(ended, left=left))

    def _outcome(self, state: State, left: threading.Event) -> Event:
        try:
            while True:
                try:
                    return Event(f"done.invoke.{state.id}", self._carry_out(state, left))
                except ActivityFailed as failed:
                    with self._lock:
                        self._running[left] = (state, None)  # should it begin anew, nothing has begun yet
                    if left.is_set() or not self._chart.waits_for_help(state, failed, left):
                        raise
        except ActivityFailed as failed:
            return self._chart.failure(state, failed.reason, str(failed))
        finally:
            with self._lock:
                del self._running[left]

    def _carry_out(self, state: State, left: threading.Event) -> dict[str, Any]:
        """Do the activity, once it may begin; its outputs. Raises ActivityFailed."""
        if not self._chart.admit(state, left):
            raise ActivityFailed("cancelled", f"{state.id} was left before it began")
        try:
            activity = self._chart.make_activity(state)
            with self._lock:
                self._running[left] = (state, activity)
            if left.is_set():
                activity.cancel()
            return activity.run()
        except ActivityFailed:
            raise
        except Exception as crash:
            # A defect in an activity must end the program by its own failure path, not leave it waiting for ever.
            _log.exception("activity %s of state %s crashed", state.file.do, state.id)
            raise ActivityFailed("crashed", f"{state.file.do} crashed: {type(crash).__name__}: {crash}") from crash


@dataclass(frozen=True)
class _Work:
    do: Callable[[], None]
    taken: threading.Event = field(default_factory=threading.Event)


class _Threads:
    """Threads that take up one work after the other: to wake one takes a fraction of the time that it takes to start one."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._idle: list[queue.SimpleQueue[_Work]] = []

    def run(self, do: Callable[[], None]) -> None:
        """In a thread that is free, or a new one. Returns once that has begun: else whoever calls would keep the interpreter for
        what follows, which is less urgent.
        """
        work = _Work(do)
        with self._lock:
            inbox = self._idle.pop() if self._idle else None
        if inbox is not None:
            inbox.put(work)
        else:
            threading.Thread(target=self._serve, args=(work,), daemon=True).start()
        work.taken.wait()

    def _serve(self, work: _Work | None) -> None:
        inbox: queue.SimpleQueue[_Work] = queue.SimpleQueue()
        while work is not None:
            work.taken.set()
            work.do()
            with self._lock:
                self._idle.append(inbox)
            work = self._next(inbox)

    def _next(self, inbox: queue.SimpleQueue[_Work]) -> _Work | None:
        try:
            return inbox.get(timeout=_IDLE_S)
        except queue.Empty:
            with self._lock:
                if inbox in self._idle:
                    self._idle.remove(inbox)
                    return None
            return inbox.get()  # somebody has just chosen this one
