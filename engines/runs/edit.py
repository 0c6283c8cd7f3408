"""Another version of a program that runs: it waits until what is active has its place in it, and asks meanwhile."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from engines import identifiers
from engines.activities.base import Services
from engines.programs.deployment import Deployed
from handrail.messages import Prompt
from handrail.topics import RefusedError

KEEP, STOP = "keep the old version", "stop"
_MOST = 12
"""states that are offered to go on from"""


@dataclass(frozen=True)
class Waiting:
    """A version that a run is to go on in."""

    newer: Deployed
    parameters: Mapping[str, Any]
    """that get these values with it"""
    go_on_from: Callable[[str], None]
    """has a run of that version begin in a state, in this one's stead"""


class Edit:
    """What one run has before it. Every method may be called from any thread."""

    def __init__(self, services: Services, run: str, changed: Callable[[], None], waiting: Waiting | None = None):
        """`run`: its id; `changed` is called whenever something else waits, or nothing any more; `waiting`: what does already."""
        self._services, self._run, self._changed = services, run, changed
        self._lock = threading.Lock()
        self._asked = ""
        """id of the open prompt"""
        self._waiting = waiting

    @property
    def waiting(self) -> Waiting | None:
        """What it is to go on in; None: in what it runs."""
        return self._waiting

    def wanted(self, waiting: Waiting) -> None:
        """Instead of any that waits already."""
        self._put(waiting)

    def ask(self, missing: str, stop: Callable[[], None]) -> None:
        """The active state `missing` has no place in the new version: ask, once, what to do; the run goes on meanwhile."""
        with self._lock:
            waiting = self._waiting
            if self._asked or waiting is None:
                return
            program = waiting.newer.program
            offered = [state.id for state in program.states() if state.file.do and not state.file.final]
            more = f" (or run from any other of its {len(offered)})" if len(offered) > _MOST else ""
            text = (
                f"{program.name} was edited, and {missing}, which is active, is elsewhere in the new version or not there. The run "
                f"goes on in the old one until it comes to a state that both have. Or go on in the new one from{more}:"
            )
            prompt = Prompt(
                id=identifiers.new("prompt", 10),
                run=self._run,
                text=text,
                options=[KEEP, STOP, *offered[:_MOST]],
                severity="warning",
            )
            self._asked = prompt.id
            self._services.prompts.ask(prompt)
        threading.Thread(target=self._wait, args=(prompt.id, waiting, stop), name="edited", daemon=True).start()

    def done(self, waiting: Waiting) -> None:
        """The run goes on in that version: nobody needs an answer any more. Nothing where another one waits by now."""
        self._put(None, instead_of=waiting)

    def end(self) -> None:
        """The run has ended."""
        self._put(None)

    def _put(self, waiting: Waiting | None, instead_of: Waiting | None = None) -> None:
        with self._lock:
            before = self._waiting
            if instead_of is not None and before is not instead_of:
                return
            asked, self._asked, self._waiting = self._asked, "", waiting
        if asked:
            self._services.prompts.withdraw(asked)
        if before is not waiting:
            self._changed()

    def _wait(self, id: str, waiting: Waiting, stop: Callable[[], None]) -> None:
        answer = self._services.prompts.wait(id).answer
        with self._lock:
            if not answer or self._waiting is not waiting:
                return
            self._asked, self._waiting = "", None
        self._changed()
        if answer == KEEP:
            name = waiting.newer.program.name
            self._services.log("info", f"the run goes on in the old version of {name}, as the operator wants")
        elif answer == STOP:
            with contextlib.suppress(RefusedError):  # it has ended meanwhile
                stop()
        else:
            waiting.go_on_from(answer)
