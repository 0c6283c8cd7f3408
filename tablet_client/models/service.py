"""The processes of the robot's service, as somebody looks at them: how they are, and what a chosen one said."""

from __future__ import annotations

from typing import Any

from handrail.messages import (
    GetProcesses,
    GetProcessLog,
    Message,
    ProcessLog,
    ProcessUse,
    RestartProcess,
    SaidLine,
)

_EVERY_S = 2.0
"""between two questions, while somebody looks"""
_KINDS = ("plant", "loop", "server", "link", "camera", "recorder")
"""processes with a meaning of their own; others are engines"""


class Service:
    """What is known of the processes. Asked for only while `open`: while somebody looks."""

    def __init__(self) -> None:
        self.open = False
        self.processes: list[ProcessUse] = []
        self.chosen = ""
        self.lines: list[SaidLine] = []
        """of the chosen one, oldest first"""
        self.problem = ""
        """why the supervisor could not be asked, or refused"""
        self._next_s = 0.0
        self._asked: set[type] = set()

    def look(self, on: bool) -> None:
        """Somebody looks, or no more."""
        self.open, self._next_s = on, 0.0

    def choose(self, process: str) -> None:
        """Show what it said; the chosen one again: nothing."""
        self.chosen = "" if process == self.chosen else process
        self.lines, self._next_s = [], 0.0

    def want(self, now: float) -> list[Message]:
        """The calls that are due at `now`, s; none is asked again before it was answered."""
        if not self.open or now < self._next_s:
            return []
        self._next_s = now + _EVERY_S
        calls: list[Message] = [GetProcesses()]
        if self.chosen:
            calls.append(GetProcessLog(process=self.chosen))
        due = [call for call in calls if type(call) not in self._asked]
        self._asked |= {type(call) for call in due}
        return due

    def restart(self, process: str) -> RestartProcess | None:
        """The call that starts one anew; None for those that the supervisor does not keep."""
        known = any(each.name == process and each.depth == 0 for each in self.processes)
        return RestartProcess(process=process) if known else None

    def take(self, call: Message, answer: Any) -> None:
        self._asked.discard(type(call))
        if isinstance(call, GetProcesses):
            self.processes, self.problem = answer.processes, ""
        elif isinstance(call, GetProcessLog):
            if isinstance(answer, ProcessLog) and answer.process == self.chosen:
                self.lines = answer.lines
        elif isinstance(call, RestartProcess):
            self.problem, self._next_s = "", 0.0

    def failed(self, call: Message, why: str) -> None:
        self._asked.discard(type(call))
        if isinstance(call, GetProcesses | GetProcessLog | RestartProcess):
            self.problem = why

    def anew(self) -> None:
        """The link is gone: what was asked is not answered any more."""
        self._asked.clear()
        self._next_s = 0.0

    @property
    def troubled(self) -> bool:
        """Whether some process that should be up is not."""
        return any(each.state in ("back-off", "gone") for each in self.processes if each.depth == 0)


def kind_of(process: str) -> str:
    """What restarting it means: one of plant, loop, server, link, camera, recorder, engine."""
    return process if process in _KINDS else "engine"
