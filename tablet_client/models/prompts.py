"""Questions to the operator: which are open, which options may be chosen, and what became of an answer."""

from __future__ import annotations

from handrail.messages import AnswerPrompt, Prompt, PromptClosed

# Answers that let the robot go on; they are only offered for a plan that may still be executed.
_GO = frozenset({"approve", "accept", "yes", "ok", "go", "execute", "continue", "confirm"})


def lets_go(option: str) -> bool:
    """True for an answer that makes the robot move."""
    return option.strip().lower() in _GO


class Prompts:
    """Open prompts, oldest first, and answers on their way."""

    def __init__(self) -> None:
        self._open: dict[str, Prompt] = {}
        self._sent: dict[str, str] = {}
        self.refused = ""
        """why the last answer was not taken"""

    def replace(self, prompts: list[Prompt]) -> None:
        """What a snapshot says is open. Answers on their way to prompts that are still open stay so."""
        self._open = {prompt.id: prompt for prompt in prompts}
        self._sent = {key: answer for key, answer in self._sent.items() if key in self._open}
        self.refused = ""

    def take(self, prompt: Prompt) -> None:
        self._open[prompt.id] = prompt
        self.refused = ""

    def close(self, closed: PromptClosed) -> Prompt | None:
        """A prompt was answered by someone or withdrawn; returns it if it was open here."""
        self._sent.pop(closed.id, None)
        return self._open.pop(closed.id, None)

    def answering(self, answer: AnswerPrompt) -> None:
        self._sent[answer.id] = answer.answer
        self.refused = ""

    def failed(self, answer: AnswerPrompt, why: str) -> None:
        """The answer was not taken: the prompt can be answered again."""
        self._sent.pop(answer.id, None)
        self.refused = why

    @property
    def current(self) -> Prompt | None:
        return next(iter(self._open.values()), None)

    @property
    def waiting(self) -> int:
        """How many are open."""
        return len(self._open)

    @property
    def sent(self) -> str:
        """The answer that is on its way for the current prompt."""
        return self._sent.get(self.current.id, "") if self.current else ""

    def __contains__(self, prompt: str) -> bool:
        return prompt in self._open
