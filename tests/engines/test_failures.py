"""A run that pauses where it fails: what waits for help, and what an operator can make of it."""

from __future__ import annotations

import pytest

from daemon.exchange.reports import NOT_ENABLED
from engines.programs import failing, library, program
from handrail import messages as m
from handrail.topics import refuse

from .test_run_steps import killed
from .test_subprograms import GRIP, MOVE

BOUND = {"arm": "right", "valve": "wheel_1"}
WAYS = """\
title: Ways
states:
  {states}
  on: {{do: prompt, with: {{text: a}}, transitions: [{{event: done.invoke.on, target: good}}, {{event: "*", target: bad}}]}}
  good: {{final: true, outcome: succeeded}}
  bad: {{final: true, outcome: failed}}
"""


def begin(stack, **parameters) -> None:
    stack.place()
    deployed = stack.call(m.Deploy(program="turn_valve", bindings=BOUND, parameters=parameters))
    stack.call(m.Run(deployment=deployed.id, on_failure="pause"))


def failed(stack, state: str) -> m.RunState:
    return stack.wait(lambda e: isinstance(e, m.RunState) and e.status == "paused" and state in e.failing)


def test_a_state_that_would_end_the_program_waits_and_is_tried_again_when_it_goes_on(stack, planner):
    planner.infeasible = True
    begin(stack)
    told = failed(stack, "planning")
    why = told.failing["planning"]
    assert (told.status, told.active) == ("paused", ["planning"]) and "elbow limit" in why
    assert told.detail == f"Plan the first stroke has failed: {why}"
    planner.infeasible = False
    stack.call(m.ResumeRun())
    stack.prompt()
    assert not stack.call(m.GetEngine()).run.failing


def test_let_fail_it_goes_the_programs_way_and_skipped_it_goes_on_as_though_done(stack, planner):
    planner.infeasible = True
    begin(stack)
    failed(stack, "planning")
    refusal = stack.refusal(m.TakeTransition(state="confirming", way="failed"))
    assert refusal.expected == "one that has failed: planning"
    stack.call(m.TakeTransition(state="planning", way="failed"))
    assert "elbow limit" in stack.ended().detail
    stack.events.clear()
    stack.call(m.RunFrom(state="planning"))
    assert failed(stack, "planning").on_failure == "pause"
    stack.call(m.TakeTransition(state="planning"))
    stack.wait(lambda e: isinstance(e, m.RunState) and e.active == ["confirming"] and not e.failing)


def test_what_nobody_could_foresee_waits_though_the_program_has_a_way_on_from_failures(stack, daemon, wait_until):
    begin(stack, goal_deg=10)
    start = daemon._start

    def not_enabled(action) -> None:
        raise refuse(*NOT_ENABLED)

    daemon._start = not_enabled
    stack.call(m.AnswerPrompt(id=stack.prompt().id, answer="approve"))
    assert "not enabled" in failed(stack, "stroking").failing["stroking"]
    daemon._start = start
    stack.call(m.ResumeRun())
    assert stack.ended().status == "succeeded"


def test_a_run_that_is_not_to_pause_goes_the_programs_way_at_once(stack, planner):
    planner.infeasible = True
    stack.place()
    stack.run()
    assert stack.ended().status == "failed"
    assert not [event for event in stack.events if isinstance(event, m.RunState) and event.failing]
    stack.refusal(m.TakeTransition(state="planning", way="failed"))


@pytest.mark.parametrize(
    ("change", "failing"),
    [
        (("  confirming:\n    title: Ask", "  confirming:\n    title: Please ask"), ["planning"]),
        (("trajectory: turn, arm: arm}", "trajectory: turn, arm: arm, arc: 0.5}"), []),
    ],
    ids=["elsewhere", "in the state that has failed"],
)
def test_edited_it_waits_in_the_new_version_and_goes_on_there(stack, planner, change, failing):
    planner.infeasible = True
    begin(stack)
    before = failed(stack, "planning")
    text = library.files()["turn_valve"].read_text()
    assert change[0] in text
    stack.call(m.SaveProgram(program="turn_valve", text=text.replace(*change, 1), was=text))
    now = stack.wait(lambda e: isinstance(e, m.RunState) and e.hash != before.hash)
    assert (now.run, now.status, sorted(now.failing)) == (before.run, "paused", failing)
    planner.infeasible = False
    stack.call(m.ResumeRun())
    stack.prompt()


def test_an_engine_that_was_killed_still_pauses_where_its_run_fails(start, planner, monkeypatch):
    stack = start()
    planner.infeasible = True
    begin(stack)
    failed(stack, "planning")
    killed(stack, monkeypatch)
    again = start()
    assert again.call(m.GetEngine()).run.on_failure == "pause"
    again.call(m.ResumeRun())
    failed(again, "planning")


def ends(tmp_path, name: str, state: str, tried: int = 0, **texts: str) -> bool:
    files = {each: tmp_path / f"{each}.yaml" for each in texts}
    for each, file in files.items():
        file.write_text(texts[each])
    states = {each.id: each for each in program.read(files[name], files).states()}
    return failing.ends(states[state], states, lambda each: tried < each.file.retry)


@pytest.mark.parametrize(
    ("ways", "expected"),
    [
        ("{event: error.execution, target: bad}", True),
        ("{event: error, target: bad}", True),
        (
            "{event: error.execution, cond: _event.data.reason == 'stuck', target: on}, {event: error.*, target: bad}",
            False,
        ),
        ("{event: error.execution, autonomy: high, target: bad}", False),
        ("{event: error.execution, target: good}", False),
        ("{event: error.communication, target: on}, {event: error.execution, target: bad}", True),
    ],
)
def test_which_failures_end_a_program(tmp_path, ways, expected):
    states = f"at: {{do: prompt, with: {{text: a}}, transitions: [{{event: done.invoke.at, target: on}}, {ways}]}}"
    assert ends(tmp_path, "ways", "at", ways=WAYS.format(states=states)) is expected


@pytest.mark.parametrize(("tried", "expected"), [(0, False), (1, True)])
def test_a_failure_within_a_program_that_another_runs_ends_all_once_that_tries_it_no_more(tmp_path, tried, expected):
    assert ends(tmp_path, "move", "gripping/asking", tried, move=MOVE, grip=GRIP) is expected
