"""`handrail program`: the checks' exit status and words, and a run followed to its end."""

from __future__ import annotations

from contextlib import contextmanager

import pytest
from typer.testing import CliRunner

from engines import cli
from handrail.messages import AnswerPrompt, Deploy, Run, StopRun
from handrail.topics import Subscriber

runner = CliRunner()


class LocalClient:
    """The client API on the engine's own sockets, without a link."""

    def __init__(self, stack):
        self._stack, self.calls = stack, []

    def _call(self, message):
        self.calls.append(message)
        return self._stack.call(message)

    def deploy(self, program, bindings, parameters):
        return self._call(Deploy(program=program, bindings=bindings, parameters=parameters))

    def run(self, deployment):
        return self._call(Run(deployment=deployment.id))

    def answer(self, prompt, answer, by):
        self._call(AnswerPrompt(id=prompt, answer=answer, by=by))

    def stop_run(self):
        self._call(StopRun())

    @contextmanager
    def events(self, *kinds):
        union = kinds[0]
        for kind in kinds[1:]:
            union = union | kind
        subscriber = Subscriber(self._stack.runtime.endpoint("engine.events"), union)
        self._stack.engine._log("info", "warm up")
        assert subscriber.receive(5) is not None or True
        yield iter(lambda: subscriber.receive(10), None)
        subscriber.close()


@pytest.fixture
def client(stack, monkeypatch):
    client = LocalClient(stack)

    @contextmanager
    def connect(address, keys):
        yield client

    monkeypatch.setattr(cli, "connect", connect)
    return client


def test_check_of_the_library_is_sound():
    result = runner.invoke(cli.app, ["check"])
    assert result.exit_code == 0
    assert "turn_valve: sound" in result.output


def test_check_of_a_wrong_file_exits_with_1_and_names_file_line_and_field(tmp_path):
    file = tmp_path / "wrong.yaml"
    file.write_text("title: Wrong\nstates:\n  a:\n    do: nothing\n")
    result = runner.invoke(cli.app, ["check", str(file)])
    assert result.exit_code == 1
    assert "wrong.yaml:4: states.a.do: no activity 'nothing'" in result.output


def test_list_shows_what_a_program_needs():
    assert "turn_valve" in runner.invoke(cli.app, ["list"]).output
    shown = runner.invoke(cli.app, ["list", "turn_valve"]).output
    assert "goal_deg" in shown and "285" in shown and "valve" in shown


def test_run_with_yes_follows_the_program_to_success(stack, client):
    stack.place()
    words = ["run", "turn_valve", "--bind", "arm=right", "--bind", "valve=wheel_1", "--set", "goal_deg=30", "--yes"]
    result = runner.invoke(cli.app, words)
    assert result.exit_code == 0, result.output
    assert "succeeded: turned" in result.output and "turning / stroking" in result.output
    assert client.calls[0].parameters == {"goal_deg": 30}


def test_run_that_fails_exits_with_1_and_the_detail(stack, client, planner):
    planner.infeasible = True
    stack.place()
    result = runner.invoke(cli.app, ["run", "turn_valve", "--bind", "arm=right", "--bind", "valve=wheel_1", "--yes"])
    assert result.exit_code == 1
    assert "elbow limit" in result.output


def test_run_that_is_refused_exits_with_1_and_says_what_is_expected(client):
    result = runner.invoke(cli.app, ["run", "turn_valve", "--bind", "arm=right"])
    assert result.exit_code == 1
    assert "bindings.valve" in result.output and "place one first" in result.output


@pytest.mark.parametrize("words", [["--bind", "arm"], ["--set", "=3"], ["--bind", "valve="]])
def test_malformed_options_are_told_the_form(words):
    result = runner.invoke(cli.app, ["run", "turn_valve", *words])
    assert result.exit_code == 2
    assert "NAME=VALUE" in result.output
