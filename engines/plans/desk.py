"""Planning that calls wait for: each in a thread of its own, its progress told, all of it cancelled by a word."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any

import msgspec

from engines.activities.base import ActivityFailed
from handrail.messages import PlanProgress
from handrail.topics import RefusedError, refuse


@dataclass(frozen=True)
class Task:
    """One call's."""

    cancelled: threading.Event
    progress: Callable[[str], None]
    """told in a few words what is being done"""


class PlanningDesk:
    """Used by the engine's thread; `cancel` by any."""

    def __init__(self, tell: Callable[[msgspec.Struct], None]):
        self._tell, self._lock = tell, threading.Lock()
        self._tasks: set[threading.Event] = set()

    def work(self, what: str, work: Callable[[Task], Any]) -> Future[Any]:
        """Do it in a thread. What it raises as ActivityFailed refuses the call."""
        future: Future[Any] = Future()
        cancelled = threading.Event()
        task = Task(cancelled, lambda doing: self._tell(PlanProgress(what=what, doing=doing)))
        with self._lock:
            self._tasks.add(cancelled)

        def run() -> None:
            try:
                future.set_result(work(task))
            except ActivityFailed as failed:
                future.set_exception(refuse(str(failed)))
            except BaseException as problem:
                future.set_exception(problem)
                if not isinstance(problem, RefusedError):
                    logging.exception("%s crashed", what)
            finally:
                with self._lock:
                    self._tasks.discard(cancelled)
                self._tell(PlanProgress(what=what, doing="", done=True))

        threading.Thread(target=run, name=what, daemon=True).start()
        return future

    def cancel(self) -> None:
        """All that is being planned ends soon, and its calls are refused as cancelled."""
        with self._lock:
            for cancelled in self._tasks:
                cancelled.set()
