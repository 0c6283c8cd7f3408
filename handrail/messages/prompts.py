"""Questions to the operator, and their answers."""

from __future__ import annotations

from typing import Literal

from handrail.messages.base import Message, Name, travels


@travels(priority=2, remote=True)
class Prompt(Message):
    """A question to the operator."""

    id: str
    run: str
    text: str
    options: list[str]
    plan: str = ""
    """id of the plan that it is about"""
    severity: Literal["info", "confirm", "warning"] = "confirm"
    details: dict[str, float] = {}
    """the numbers that matter, each name with its unit, e.g. clearance_m"""


@travels(priority=2, remote=True)
class PromptClosed(Message):
    """A prompt is no longer open."""

    id: str
    answer: str = ""
    by: str = ""


@travels(priority=1, remote=True)
class AnswerPrompt(Message):
    """Answer a prompt. A late answer is told that it was already answered."""

    id: Name
    answer: Name
    by: Name = "operator"
