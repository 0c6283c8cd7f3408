"""Recordings on the robot's computer, as somebody looks at the list of them: which there are, and which is being made."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from typing import Any

from handrail.messages import ListRecordings, Mark, Message, RecordingInfo, Recordings, StartRecording, StopRecording

_EVERY_S, _WHILE_ENDING_S = 10.0, 1.0
"""between two questions, while somebody looks"""
_MOST_TEXT = 200
OWN_CALLS = (ListRecordings, StartRecording, StopRecording, Mark)


class RecordingList:
    """What is known of the recordings. Asked for only while `open`: while somebody looks."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self.open = False
        self.found: list[RecordingInfo] = []
        self.running = ""
        self.free_mb = 0.0
        self.known = False
        self.problem = ""
        """why the robot could not be asked, or refused"""
        self._next_s = 0.0
        self._began = 0.0
        self._asked = False
        self._ending = False

    @property
    def running_s(self) -> float:
        """For how long the running one has been made."""
        return self._clock() - self._began if self.running else 0.0

    def look(self, on: bool) -> None:
        """Somebody looks, or no more."""
        self.open, self._next_s = on, 0.0

    def want(self, now: float) -> list[Message]:
        """The calls that are due at `now`, s."""
        if not self.open or self._asked or now < self._next_s:
            return []
        self._asked, self._next_s = True, now + (_WHILE_ENDING_S if self._ending else _EVERY_S)
        return [ListRecordings()]

    def start(self, name: str = "") -> StartRecording:
        """The call that begins one; without a name it is called by the time."""
        plain = re.sub(r"[^A-Za-z0-9_-]+", "-", name).strip("-_")[:63]
        return StartRecording(name=plain or time.strftime("%Y-%m-%d-%H%M%S"))

    def mark(self, text: str) -> Mark | None:
        """The call that marks this moment; None without a text."""
        text = " ".join(text.split())[:_MOST_TEXT]
        return Mark(text=text) if text else None

    def take(self, call: Message, answer: Any) -> None:
        if isinstance(call, ListRecordings) and isinstance(answer, Recordings):
            self._asked, self.known, self.problem = False, True, ""
            self.found, self.running, self.free_mb = answer.recordings, answer.running, answer.free_mb
            self._began = self._clock() - answer.running_s
            self._ending = self._ending and bool(self.running)
        elif isinstance(call, StartRecording):
            self.running, self._began, self.problem, self._next_s = call.name, self._clock(), "", 0.0
        elif isinstance(call, StopRecording):
            self.problem, self._next_s, self._ending = "", 0.0, True
        elif isinstance(call, Mark):
            self.problem = ""

    def failed(self, call: Message, why: str) -> None:
        if isinstance(call, OWN_CALLS):
            self.problem = why
        if isinstance(call, ListRecordings):
            self._asked = False

    def anew(self) -> None:
        """The link is gone: what was asked is not answered any more."""
        self._asked, self._next_s = False, 0.0
