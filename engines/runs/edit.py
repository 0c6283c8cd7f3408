"""Another version of a program that runs: it waits until what is active has its place in it, and asks meanwhile."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Mapping
from typing import Any

from engines import identifiers
from engines.activities.base import Services
from engines.programs.deployment import Deployed
from handrail.messages import Prompt
from handrail.topics import RefusedError

KEEP, STOP = "keep the old version", "stop"
_MOST = 12
"""states that are offered to go on from"""


class Edit:
    """What one run has before it. Every method may be called from any thread."""

    def __init__(self, services: Services, run: str):
        """`run`: its id."""
        self._services, self._run = services, run
        self._lock = threading.Lock()
        self._asked = ""
        """id of the open prompt"""
        self.newer: Deployed | None = None
        """the version to go on in"""
        self.parameters: Mapping[str, Any] = {}
        """that get these values with it"""

    def wanted(self, newer: Deployed, parameters: Mapping[str, Any], go_on_from: Callable[[str], None]) -> None:
        """Instead of any that waits already."""
        self.done()
        with self._lock:
            self.newer, self.parameters, self._go_on_from = newer, parameters, go_on_from

    def ask(self, missing: str, stop: Callable[[], None]) -> None:
        """The active state `missing` has no place in the new version: ask, once, what to do; the run goes on meanwhile."""
        with self._lock:
            if self._asked or self.newer is None:
                return
            program = self.newer.program
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
            waiting = (prompt.id, self.newer, self._go_on_from, stop)
        threading.Thread(target=self._wait, args=waiting, name="edited", daemon=True).start()

    def done(self) -> None:
        """The run goes on in the new version, or has ended: nobody needs an answer any more."""
        with self._lock:
            asked, self._asked, self.newer, self.parameters = self._asked, "", None, {}
        if asked:
            self._services.prompts.withdraw(asked)

    def _wait(self, id: str, newer: Deployed, go_on_from: Callable[[str], None], stop: Callable[[], None]) -> None:
        answer = self._services.prompts.wait(id).answer
        with self._lock:
            if not answer or self.newer is not newer:
                return
            self._asked, self.newer, self.parameters = "", None, {}
        if answer == KEEP:
            self._services.log(
                "info", f"the run goes on in the old version of {newer.program.name}, as the operator wants"
            )
        elif answer == STOP:
            with contextlib.suppress(RefusedError):  # it has ended meanwhile
                stop()
        else:
            go_on_from(answer)
