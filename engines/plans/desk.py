"""Planning that calls wait for: each in a thread of its own, its progress told, all of it cancelled by a word."""

from __future__ import annotations

import logging
import threading
import time
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
    superseded: threading.Event
    """a newer one has taken its place"""


class PlanningDesk:
    """Used by the engine's thread; `cancel` by any."""

    def __init__(self, tell: Callable[[msgspec.Struct], None], say: Callable[[str], None]):
        """`tell` an event; `say` a line for people: what came of it, and how long it took."""
        self._tell, self._say, self._lock = tell, say, threading.Lock()
        self._tasks: set[threading.Event] = set()
        self._newest: dict[str, Task] = {}

    def work(self, what: str, work: Callable[[Task], Any], *, supersedes: str = "") -> Future[Any]:
        """Do it in a thread. What it raises as ActivityFailed refuses the call.

        `supersedes`: whatever is still being worked on under the same word ends, and its call is refused as superseded.
        """
        future: Future[Any] = Future()
        cancelled = threading.Event()
        task = Task(cancelled, lambda doing: self._tell(PlanProgress(what=what, doing=doing)), threading.Event())
        with self._lock:
            self._tasks.add(cancelled)
            older = self._newest.get(supersedes)
            if older is not None:
                older.superseded.set()
                older.cancelled.set()
            if supersedes:
                self._newest[supersedes] = task

        def run() -> None:
            began = time.monotonic()
            try:
                found = work(task)
                self._say(f"{what}: found in {time.monotonic() - began:.1f} s")
                future.set_result(found)
            except ActivityFailed as failed:
                superseded = "superseded by a newer one" if task.superseded.is_set() else ""
                self._say(f"{what}: {superseded or failed}")
                future.set_exception(refuse(f"{what}: {superseded}" if superseded else str(failed)))
            except BaseException as problem:
                self._say(f"{what}: {problem}")
                future.set_exception(problem)
                if not isinstance(problem, RefusedError):
                    logging.exception("%s crashed", what)
            finally:
                with self._lock:
                    self._tasks.discard(cancelled)
                    if self._newest.get(supersedes) is task:
                        del self._newest[supersedes]
                self._tell(PlanProgress(what=what, doing="", done=True))

        threading.Thread(target=run, name=what, daemon=True).start()
        return future

    def cancel(self) -> None:
        """All that is being planned ends soon, and its calls are refused as cancelled."""
        with self._lock:
            for cancelled in self._tasks:
                cancelled.set()
