"""The scripted operator, with a client that keeps what it is told."""

from __future__ import annotations

from handrail.client import Live, RefusedError
from handrail.demo.operator import ScriptedOperator, choose
from handrail.messages import EngineSnapshot, Prompt, Refused


def prompt(number, options=("approve", "reject")):
    return Prompt(id=f"p{number}", run="r", text="turn?", options=list(options))


class FakeClient:
    """Hands the operator's reaction to the test."""

    def __init__(self):
        self.answers: list[tuple[str, str]] = []
        self.open: list[Prompt] = []
        self.refusal = None
        self.closed = False

    def on(self, kinds, react):
        self.react = react
        return self

    def close(self):
        self.closed = True

    def snapshot(self):
        return EngineSnapshot(instances=[], plans=[], run=None, prompts=self.open)

    def answer(self, prompt, answer, by):
        if self.refusal:
            raise RefusedError(self.refusal)
        self.answers.append((prompt, answer))


def test_approves_each_prompt_once():
    client = FakeClient()
    operator = ScriptedOperator(client)
    client.react(prompt(1))
    client.react(prompt(2))
    client.open = [prompt(2)]
    client.react(Live())
    assert client.answers == [("p1", "approve"), ("p2", "approve")]
    assert [answered.prompt.id for answered in operator.answered] == ["p1", "p2"]
    operator.close()
    assert client.closed


def test_finds_prompts_that_were_open_before_it_came():
    client = FakeClient()
    client.open = [prompt(1)]
    ScriptedOperator(client)
    client.react(Live())
    assert client.answers == [("p1", "approve")]


def test_leaves_a_prompt_that_it_does_not_understand_to_people():
    client = FakeClient()
    operator = ScriptedOperator(client)
    client.react(prompt(1, ["left", "right"]))
    assert client.answers == []
    assert "none of left, right" in operator.problems[0]


def test_is_not_put_out_when_somebody_else_was_faster():
    client = FakeClient()
    operator = ScriptedOperator(client)
    client.refusal = Refused(message="already answered by anna")
    client.react(prompt(1))
    assert "already answered by anna" in operator.problems[0]


def test_chooses_what_lets_the_program_go_on():
    assert choose(["reject", "approve"]) == "approve"
    assert choose(["Continue", "stop"]) == "Continue"
    assert choose(["abort"]) is None
