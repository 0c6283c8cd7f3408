"""`handrail program`: the checks' exit status and words, and a run followed to its end."""

from __future__ import annotations

from contextlib import contextmanager
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from engines.programs import cli
from handrail import following, robot_option
from handrail.messages import AnswerPrompt, Deploy, GetEngine, ResumeRun, Run, StopRun, TakeTransition
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

    def run(self, deployment, *, on_failure):
        return self._call(Run(deployment=deployment.id, on_failure=on_failure))

    def answer(self, prompt, answer, by):
        self._call(AnswerPrompt(id=prompt, answer=answer, by=by))

    def snapshot(self):
        return self._stack.call(GetEngine())

    def stop_run(self):
        self._call(StopRun())

    def resume_run(self):
        self._call(ResumeRun())

    def skip(self, state):
        return self._call(TakeTransition(state=state))

    def let_fail(self, state):
        return self._call(TakeTransition(state=state, way="failed"))

    @contextmanager
    def events(self, *kinds):
        union = kinds[0]
        for kind in kinds[1:]:
            union = union | kind
        subscriber = Subscriber(self._stack.runtime.endpoint("engine.events"), union)
        for _ in range(100):
            self._stack.engine._log("info", "warm up")
            if subscriber.receive(0.05):
                break
        else:
            raise AssertionError("nothing is heard of the engine")
        yield SimpleNamespace(next=subscriber.receive)
        subscriber.close()


@pytest.fixture
def client(stack, monkeypatch):
    client = LocalClient(stack)

    @contextmanager
    def connect(address, keys):
        yield client

    monkeypatch.setattr(robot_option, "connect", connect)
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
    assert "turned_deg" in result.output and "max_strokes" not in result.output, "what does not change is left out"


def test_run_that_fails_exits_with_1_and_the_detail(stack, client, planner):
    planner.infeasible = True
    stack.place()
    result = runner.invoke(cli.app, ["run", "turn_valve", "--bind", "arm=right", "--bind", "valve=wheel_1", "--yes"])
    assert result.exit_code == 1
    assert "elbow limit" in result.output


@pytest.mark.parametrize(
    ("answers", "calls", "status"),
    [
        ("help\nfail\n", [TakeTransition(state="planning", way="failed")], 1),
        ("retry\nstop\n", [ResumeRun(), StopRun()], 130),
    ],
)
def test_who_sits_at_the_terminal_is_asked_what_becomes_of_a_failure(
    stack, client, planner, monkeypatch, answers, calls, status
):
    monkeypatch.setattr(cli, "on_failure", lambda yes: "pause")
    planner.infeasible = True
    stack.place()
    words = ["run", "turn_valve", "--bind", "arm=right", "--bind", "valve=wheel_1"]
    result = runner.invoke(cli.app, words, input=answers)
    assert result.exit_code == status, result.output
    assert client.calls[2 : 2 + len(calls)] == calls
    assert "planning has failed" in result.output and "retry / skip / fail / stop" in result.output


def test_a_prompt_that_nobody_can_answer_stops_the_run(stack, client):
    stack.place()
    words = ["run", "turn_valve", "--bind", "arm=right", "--bind", "valve=wheel_1"]
    result = runner.invoke(cli.app, words, input="")
    assert result.exit_code == 130, result.output
    assert isinstance(client.calls[-1], StopRun)
    assert stack.ended().status == "stopped"


def test_a_run_that_the_engine_no_longer_knows_is_over(stack, client, planner, monkeypatch):
    monkeypatch.setattr(following, "_SILENT_S", 0.1)
    planner.pace.clear()
    stack.place()
    client.snapshot = lambda: SimpleNamespace(run=None)
    words = ["run", "turn_valve", "--bind", "arm=right", "--bind", "valve=wheel_1", "--yes"]
    result = runner.invoke(cli.app, words)
    planner.pace.set()
    assert result.exit_code == 1
    assert "started anew" in result.output


def test_run_that_is_refused_exits_with_1_and_says_what_is_expected(client):
    result = runner.invoke(cli.app, ["run", "turn_valve", "--bind", "arm=right"])
    assert result.exit_code == 1
    assert "bindings.valve" in result.output and "place one first" in result.output


@pytest.mark.parametrize("words", [["--bind", "arm"], ["--set", "=3"], ["--bind", "valve="]])
def test_malformed_options_are_told_the_form(words):
    result = runner.invoke(cli.app, ["run", "turn_valve", *words])
    assert result.exit_code == 2
    assert "NAME=VALUE" in result.output
