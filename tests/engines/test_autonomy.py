"""Questions before a program goes on: each is closed once, and counts at most once, in whatever order things happen."""

from __future__ import annotations

import threading

import pytest

from engines.runs.autonomy import Permissions, Question
from engines.runs.prompts import Prompts
from handrail.messages import AnswerPrompt, Prompt, PromptClosed


class Asked:
    """Permissions with all that came of them."""

    def __init__(self):
        self.events, self.allowed, self.logged = [], [], threading.Event()
        self.prompts = Prompts(self.events.append)
        self.permissions = Permissions(
            self.prompts, "run-1", self.allowed.append, lambda level, text: self.logged.set(), "low"
        )

    def ask(self, number=0):
        question = Question("moving", 1, "low", f"Go on ({number})?", {"number": number})
        self.permissions.ask(question)
        return question

    @property
    def opened(self):
        return [event for event in self.events if isinstance(event, Prompt)]

    @property
    def closed(self):
        return [event for event in self.events if isinstance(event, PromptClosed)]


@pytest.fixture
def asked(monkeypatch):
    """Threads that wait for answers begin only when `asked.late()` is called."""
    waiting = []
    monkeypatch.setattr("engines.runs.autonomy.threading.Thread", lambda **how: _Late(waiting, how))
    asked = Asked()
    asked.late = lambda: [how["target"](*how["args"]) for how in waiting]
    return asked


class _Late:
    def __init__(self, waiting, how):
        self._waiting, self._how = waiting, how

    def start(self):
        self._waiting.append(self._how)


def test_a_state_that_is_left_and_asks_again_at_once_is_asked_about_again(asked):
    asked.ask(0)
    asked.permissions.withdraw("moving")
    again = asked.ask(1)
    assert [prompt.text for prompt in asked.opened] == ["Go on (0)?", "Go on (1)?"]
    asked.prompts.answer(AnswerPrompt(id=asked.opened[1].id, answer="go on"))
    asked.late()
    assert asked.allowed == [again]
    assert [closed.answer for closed in asked.closed] == ["", "go on"]


@pytest.mark.parametrize("answer", ["go on", "stay"])
def test_a_level_that_is_raised_just_when_it_is_answered_leaves_the_answer_as_it_is(asked, answer):
    question = asked.ask()
    asked.prompts.answer(AnswerPrompt(id=asked.opened[0].id, answer=answer))
    asked.permissions.set_level("high")
    asked.late()
    assert asked.allowed == ([question] if answer == "go on" else [])
    assert asked.logged.is_set() == (answer == "stay")


def test_a_level_that_was_raised_before_the_question_came_needs_none(asked):
    asked.permissions.set_level("high")
    question = asked.ask()
    assert asked.allowed == [question]
    assert not asked.events


def test_a_level_that_is_raised_withdraws_the_question_and_allows_it_once(asked):
    question = asked.ask()
    asked.permissions.set_level("high")
    asked.late()
    assert asked.allowed == [question]
    assert [closed.answer for closed in asked.closed] == [""]


def test_at_the_end_of_a_run_nothing_stays_asked(asked):
    asked.ask()
    asked.permissions.withdraw()
    asked.late()
    assert not asked.prompts.open() and not asked.allowed
