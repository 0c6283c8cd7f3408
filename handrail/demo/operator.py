"""The scripted operator: answers every prompt through the public client, as a person at the tablet would."""

from __future__ import annotations

import threading
from dataclasses import dataclass

from handrail.client import Client, Live, RefusedError, Unreachable
from handrail.messages import Prompt

_YES = ("approve", "accept", "yes", "ok", "continue", "go", "done")
NAME = "scripted operator"


@dataclass(frozen=True)
class Answered:
    prompt: Prompt
    answer: str


def choose(options: list[str]) -> str | None:
    """The option that lets the program go on: the first that says yes; None where nothing does."""
    return next((option for wanted in _YES for option in options if option.lower() == wanted), None)


class ScriptedOperator:
    """Approves each prompt once, those that were open before it came as well. Close it to send it home."""

    def __init__(self, client: Client):
        self._client = client
        self.answered: list[Answered] = []
        self.problems: list[str] = []
        """what could not be answered, and why"""
        self._seen: set[str] = set()
        self._lock = threading.Lock()
        self._stream = client.on((Live, Prompt), self._react)

    def _react(self, event: Live | Prompt) -> None:
        # The stream has just begun, or begun anew: what was asked meanwhile is in the snapshot.
        for prompt in self._client.snapshot().prompts if isinstance(event, Live) else [event]:
            self._answer(prompt)

    def _answer(self, prompt: Prompt) -> None:
        with self._lock:
            if prompt.id in self._seen:
                return
            self._seen.add(prompt.id)
        answer = choose(prompt.options)
        if answer is None:
            self.problems.append(f"“{prompt.text}”: none of {', '.join(prompt.options)} lets the program go on")
            return
        try:
            self._client.answer(prompt.id, answer, by=NAME)
        except (RefusedError, Unreachable) as problem:  # another client was faster, or the engine is gone
            self.problems.append(f"“{prompt.text}”: {problem}")
        else:
            self.answered.append(Answered(prompt, answer))

    def close(self) -> None:
        self._stream.close()
