"""What the operator is asked before a program goes on, by the level of autonomy that he has given the run.

A transition that says `autonomy: high` is taken without asking where the run's level is above it (full), and asked about where it
is not (FlexBE's rule: an outcome whose required level is not below the run's waits for the operator). The state stays active
meanwhile; what else happens in it goes on, and where it is left by another way the question is withdrawn.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from engines import identifiers
from engines.programs.program import AUTONOMY
from engines.runs.prompts import Prompts
from handrail.messages import Prompt

GO_ON, STAY = "go on", "stay"


@dataclass(frozen=True)
class Question:
    """A way out that waits for the operator."""

    state: str
    way: int
    """index of the state's transition"""
    required: str
    """level at and below which it is asked about"""
    text: str
    data: Mapping[str, Any]
    """of the event that would have taken it"""
    left: threading.Event = field(default_factory=threading.Event, compare=False)
    """set once the state was left: then no answer counts any more, even if the state is active anew"""


class Permissions:
    """The open questions of one run. Every method may be called from any thread."""

    def __init__(
        self, prompts: Prompts, run: str, allow: Callable[[Question], None], log: Callable[[str, str], None], level: str
    ):
        """`allow`: called when the operator lets a way be taken; `level`: one of `AUTONOMY`."""
        self._prompts, self._run, self._allow, self._log = prompts, run, allow, log
        self._lock = threading.Lock()
        self._open: dict[tuple[str, int], tuple[str, Question]] = {}
        """state and way → prompt and question"""
        self.level = level

    def ask(self, question: Question) -> None:
        """Ask, unless that is asked already: then the answer counts for what is known now. Where the level has been raised since
        the way was found to need leave, it is allowed.
        """
        key = (question.state, question.way)
        with self._lock:
            needless = AUTONOMY[question.required] < AUTONOMY[self.level]
            if not needless and key in self._open:
                self._open[key] = (self._open[key][0], question)
                return
            if not needless:
                prompt = Prompt(
                    id=identifiers.new("prompt", 10), run=self._run, text=question.text, options=[GO_ON, STAY]
                )
                self._open[key] = (prompt.id, question)
                self._prompts.ask(prompt)
        if needless:
            self._allow(question)
            return
        threading.Thread(target=self._wait, args=(key, prompt.id), name=f"ask {question.state}", daemon=True).start()

    @property
    def asked(self) -> bool:
        """Whether a way out waits for the operator."""
        with self._lock:
            return bool(self._open)

    def withdraw(self, state: str | None = None) -> None:
        """The state was left (None: the run has ended): nobody needs an answer any more."""
        with self._lock:
            for key in [key for key in self._open if state in (None, key[0])]:
                self._prompts.withdraw(self._open.pop(key)[0])

    def set_level(self, level: str) -> None:
        """From now on; what was asked and need not be any more is allowed, unless it was answered already."""
        allowed = []
        with self._lock:
            self.level = level
            for key, (prompt, question) in list(self._open.items()):
                if AUTONOMY[question.required] < AUTONOMY[level] and self._prompts.withdraw(prompt):
                    del self._open[key]
                    allowed.append(question)
        for question in allowed:
            self._allow(question)

    def _wait(self, key: tuple[str, int], prompt: str) -> None:
        closed = self._prompts.wait(prompt)
        with self._lock:
            if self._open.get(key, ("",))[0] != prompt:
                return  # withdrawn; what is open there now is another question
            question = self._open.pop(key)[1]
        if closed.answer == GO_ON:
            self._allow(question)
        else:
            self._log(
                "info", f"{question.state} stays active, as {closed.by} wants: skip it or take another way out to go on"
            )
