"""A run under the operator's hand: breakpoints, steps, ways out of his choice, another state to go on from, a killed engine."""

from __future__ import annotations

import threading

import pytest

from engines.programs import library, program
from engines.runs.run import ProgramRun
from handrail import messages as m
from handrail.topics import Caller, RefusedError


def states(stack, *, status=None, waiting=None):
    """The first run state that is so."""
    return stack.wait(
        lambda e: (
            isinstance(e, m.RunState)
            and (status is None or e.status == status)
            and (waiting is None or e.waiting == waiting)
        )
    )


@pytest.fixture
def halted(stack):
    """A run that has come to a breakpoint at its prompt."""
    stack.place()
    stack.call(m.SetBreakpoints(states=["confirming"]))
    stack.run(goal_deg=10)
    states(stack, status="paused", waiting=["confirming"])
    return stack


def test_a_breakpoint_pauses_before_the_state_does_anything_and_says_which(halted):
    run = halted.call(m.GetEngine()).run
    assert run.active == ["confirming"]
    assert run.detail == "breakpoint at confirming"
    assert not halted.call(m.GetEngine()).prompts
    halted.call(m.ResumeRun())
    halted.prompt()
    assert halted.call(m.GetEngine()).run.status == "running"


def test_a_step_goes_on_to_the_next_activity_and_no_further(halted, daemon):
    halted.call(m.StepRun())
    halted.call(m.AnswerPrompt(id=halted.prompt().id, answer="approve"))
    run = states(halted, status="paused", waiting=["stroking"])
    assert run.detail == "one step on, before stroking"
    assert not daemon.started()
    halted.call(m.ResumeRun())
    assert halted.ended().status == "succeeded"


def test_a_pause_keeps_a_state_that_is_just_entered_from_beginning(stack, planner, wait_until):
    stack.place()
    planner.pace.clear()
    stack.run(goal_deg=10)
    wait_until(lambda: planner.asked)
    stack.call(m.PauseRun())
    planner.pace.set()
    states(stack, status="paused", waiting=["confirming"])
    stack.call(m.StopRun())
    assert stack.ended().status == "stopped"
    assert not [event for event in stack.events if isinstance(event, m.Prompt)]


def test_skipping_leaves_the_state_as_though_it_were_done_and_says_what_was_not_set(stack):
    stack.place()
    stack.run(goal_deg=10)
    stack.prompt()
    stack.call(m.TakeTransition(state="confirming"))
    stack.wait(lambda e: isinstance(e, m.PromptClosed) and not e.answer)
    told = stack.wait(lambda e: isinstance(e, m.LogLine) and "because an operator said so" in e.text)
    assert told.text.startswith("confirming → ")


def test_an_operator_takes_whatever_way_out_he_wants(stack):
    stack.place()
    stack.run(goal_deg=10)
    stack.prompt()
    refused = stack.refusal(m.TakeTransition(state="confirming", way=17))
    assert (refused.field, refused.value) == ("way", "17")
    way = next(int(part.split(":")[0]) for part in refused.expected.split("; ") if part.endswith("failed"))
    stack.call(m.TakeTransition(state="confirming", way=way))
    assert stack.ended().status == "failed"


def test_a_run_goes_on_from_another_state_with_what_it_remembers(halted, daemon):
    plan = halted.call(m.GetEngine()).run.data["plan"]
    first = halted.call(m.GetEngine()).run.run
    began = halted.call(m.RunFrom(state="stroking"))
    assert began.run != first
    assert began.data["plan"] == plan
    assert halted.wait(lambda e: isinstance(e, m.RunState) and e.run == first and e.status == "stopped")
    ended = halted.wait(lambda e: isinstance(e, m.RunState) and e.run == began.run and e.status == "succeeded")
    assert "turned" in ended.detail
    assert len([call for call in daemon.calls if isinstance(call, m.StartAction)]) > 1


def test_a_program_that_was_edited_while_it_runs_goes_on_in_the_new_version(halted, tmp_path, monkeypatch):
    folder = tmp_path / "rtc_programs"
    folder.mkdir()
    text = program.files()["turn_valve"].read_text()
    (folder / "turn_valve.yaml").write_text(text.replace("variables:", "variables:\n  added: 7", 1))
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    before, bound = halted.call(m.GetEngine()).run, {"arm": "right", "valve": "wheel_1"}
    edited = halted.call(m.Deploy(program="turn_valve", bindings=bound, parameters={"goal_deg": 20}))
    other = halted.call(m.Deploy(program="press", bindings={"arm": "right"}))
    assert halted.refusal(m.RunFrom(state="confirming", deployment=other.id)).field == "deployment"
    assert "confirming" in halted.refusal(m.RunFrom(state="asking", deployment=edited.id)).expected
    began = halted.call(m.RunFrom(state="confirming", paused=True, deployment=edited.id))
    assert began.hash == edited.hash != before.hash
    assert began.data == before.data | {"added": 7, "goal_deg": 20}


def test_an_ended_run_can_be_repeated_from_a_state_and_waits_there_if_asked(stack):
    stack.place()
    stack.run(goal_deg=10)
    stack.call(m.AnswerPrompt(id=stack.prompt().id, answer="reject"))
    stack.ended()
    began = stack.call(m.RunFrom(state="confirming", paused=True))
    states(stack, status="paused", waiting=["confirming"])
    assert began.status == "paused"
    stack.call(m.StepRun())
    assert stack.prompt(2).run == began.run


def test_a_parameter_counts_from_its_next_use(halted):
    halted.call(m.SetRunParameters(parameters={"goal_deg": 33}))
    assert halted.call(m.GetEngine()).run.data["goal_deg"] == 33
    halted.call(m.ResumeRun())
    assert "33°" in halted.prompt().text
    refused = halted.refusal(m.SetRunParameters(parameters={"goal_deg": 1e6}))
    assert (refused.field, refused.expected) == ("parameters.goal_deg", "5 to 3600 deg")


def test_the_history_says_what_was_passed_in_which_order_and_what_ended_it(stack):
    stack.place()
    stack.run(goal_deg=10)
    stack.call(m.AnswerPrompt(id=stack.prompt().id, answer="approve"))
    stack.ended()
    history = stack.call(m.GetRunHistory())
    passed = [visit.state for visit in history.visits]
    assert passed[:5] == ["choosing", "planning", "confirming", "turning", "stroking"]
    assert "counting" in passed, "also what is passed without waiting"
    first = history.visits[1]
    assert first.event == "done.invoke.planning"
    assert first.left_ns >= first.entered_ns > 0


def test_the_outline_of_a_run_names_every_state_with_what_it_is_in_what_it_does_and_where_it_leads(halted):
    run = halted.call(m.GetEngine()).run
    told = halted.call(m.GetOutline())
    assert (told.program, told.hash, told.deployment) == ("turn_valve", run.hash, run.deployment)
    states = {state.id: state for state in told.states}
    assert list(states)[:5] == ["choosing", "planning", "confirming", "turning", "stroking"]
    assert states["stroking"].parent == "turning" and states["stroking"].does == "execute"
    assert states["confirming"].ways == ["turning", "failed", "failed"]
    assert states["done"].outcome == "succeeded" and states["turning"].title == "Turn, stroke by stroke"
    assert halted.call(m.GetOutline(deployment=run.deployment)) == told
    assert halted.refusal(m.GetOutline(deployment="another")).field == "deployment"


def killed(stack, monkeypatch):
    """End an engine that writes nothing any more, as one that is killed."""
    monkeypatch.setattr(stack.engine._journal, "write", lambda *run: None)
    stack.close()


def test_an_engine_that_was_killed_has_its_run_paused_where_it_was(halted, start, wait_until, monkeypatch):
    before = halted.call(m.GetEngine()).run
    killed(halted, monkeypatch)
    again = start()
    wait_until(lambda: again.call(m.GetEngine()).run.waiting == ["confirming"])
    run = again.call(m.GetEngine()).run
    assert run.status == "paused"
    assert (run.run, run.active, run.deployment) == (before.run, ["confirming"], before.deployment)
    assert run.data == before.data
    assert "started anew" in run.detail
    again.call(m.SetBreakpoints(states=[]))
    again.call(m.RunFrom(state="planning"))  # plans are gone with the engine that made them
    assert "10°" in again.prompt().text


def test_an_engine_that_ended_by_itself_recovers_nothing(halted, start):
    halted.close()
    assert start().call(m.GetEngine()).run is None


def test_a_run_that_can_not_be_recovered_is_told_and_keeps_nothing_else_from_working(
    halted, start, caplog, monkeypatch
):
    halted.call(m.RemoveInstance(name="wheel_1"))
    killed(halted, monkeypatch)
    assert start().call(m.GetEngine()).run is None
    assert "is lost: resource 'valve' can't be bound to 'wheel_1'" in caplog.text


@pytest.mark.parametrize(
    ("call", "field"),
    [
        (m.SetBreakpoints(states=["confirming", "nowhere"]), "states[1]"),
        (m.TakeTransition(state="stroking"), "state"),
        (m.RunFrom(state="nowhere"), "state"),
        (m.SetRunParameters(parameters={"speed": 1}), "parameters.speed"),
    ],
)
def test_what_does_not_fit_the_program_is_refused_with_what_would(halted, call, field):
    refused = halted.refusal(call)
    assert refused.field == field
    assert refused.expected


def test_a_step_of_what_is_not_paused_is_refused(stack):
    stack.place()
    assert "no program is running" in stack.refusal(m.StepRun()).message
    stack.run(goal_deg=10)
    stack.prompt()
    assert stack.refusal(m.StepRun()).expected == "paused"


@pytest.fixture
def cautious(stack, tmp_path, monkeypatch):
    """A run whose first plan is only gone on with by leave."""
    text = (
        library.files()["turn_valve"].read_text().replace("target: confirming,", "autonomy: low, target: confirming,")
    )
    (tmp_path / "rtc_programs").mkdir()
    (tmp_path / "rtc_programs" / "turn_valve.yaml").write_text(text)
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    stack.place()
    stack.call(m.SetAutonomy(level="low"))
    stack.run(goal_deg=10)
    return stack


def test_a_run_asks_once_where_its_level_is_low_and_goes_on_when_told(cautious):
    asked = cautious.prompt()
    assert asked.text == "Plan the first stroke is done. Go on with: Ask the operator?"
    assert cautious.call(m.GetEngine()).run.active == ["planning"]
    cautious.call(m.AnswerPrompt(id=asked.id, answer="go on"))
    assert "10°" in cautious.prompt(2).text


def test_who_wants_it_to_stay_has_it_stay_until_it_is_skipped(cautious):
    cautious.call(m.AnswerPrompt(id=cautious.prompt().id, answer="stay"))
    cautious.wait(lambda e: isinstance(e, m.LogLine) and "stays active" in e.text)
    assert cautious.call(m.GetEngine()).run.active == ["planning"]
    cautious.call(m.StopRun())
    assert cautious.ended().status == "stopped"


def test_a_higher_level_withdraws_what_need_not_be_asked_any_more_and_goes_on(cautious):
    asked = cautious.prompt()
    cautious.call(m.SetAutonomy(level="high"))
    assert cautious.wait(lambda e: isinstance(e, m.PromptClosed) and e.id == asked.id).answer == ""
    assert "10°" in cautious.prompt(2).text
    assert cautious.call(m.GetEngine()).run.autonomy == "high"


def test_a_question_about_a_state_that_was_left_is_withdrawn(cautious):
    asked = cautious.prompt()
    cautious.call(m.TakeTransition(state="planning", way=1))
    assert cautious.wait(lambda e: isinstance(e, m.PromptClosed) and e.id == asked.id).answer == ""
    assert cautious.ended().status == "failed"


@pytest.fixture
def changing(halted, monkeypatch):
    """A run that is asked to go on from another state, while its end is waited for; call it to have that happen."""
    waits, let, answers = threading.Event(), threading.Event(), []
    join = ProgramRun.join

    def late(run, timeout_s):
        waits.set()
        assert let.wait(30)
        join(run, timeout_s)

    def ask():
        caller = Caller(halted.runtime.endpoint("engine.call"))
        try:
            answers.append(caller.call(m.RunFrom(state="stroking"), 60))
        except RefusedError as refused:
            answers.append(refused.refusal)
        finally:
            caller.close()

    monkeypatch.setattr(ProgramRun, "join", late)
    asking = threading.Thread(target=ask, daemon=True)
    asking.start()
    assert waits.wait(30)

    def done():
        let.set()
        asking.join(60)
        return answers[0]

    yield done
    done()


def test_who_stops_while_a_run_is_to_go_on_from_another_state_has_none_begin(halted, changing, daemon):
    halted.call(m.StopRun())
    assert "stopped before it began" in changing().message
    assert halted.ended().status == "stopped"
    assert halted.call(m.GetEngine()).run.status == "stopped"
    assert not daemon.started()


def test_nothing_else_begins_while_a_run_is_to_go_on_from_another_state(halted, changing):
    halted.ended()
    plan = halted.call(m.GetEngine()).run.data["plan"]
    for call in (m.ExecutePlan(id=plan), m.RunFrom(state="planning")):
        assert "just being started" in halted.refusal(call).message
    assert changing().status == "running"


def test_a_run_that_can_not_go_on_from_another_state_goes_on_where_it_is(halted):
    halted.call(m.RemoveInstance(name="wheel_1"))
    assert "wheel_1" in str(halted.refusal(m.RunFrom(state="planning")))
    assert halted.call(m.GetEngine()).run.status == "paused"


def test_a_recovered_run_asks_and_halts_as_the_killed_one_did(halted, start, wait_until, monkeypatch):
    halted.call(m.SetAutonomy(level="low"))
    killed(halted, monkeypatch)
    again = start()
    wait_until(lambda: again.call(m.GetEngine()).run.waiting == ["confirming"])
    run = again.call(m.GetEngine()).run
    assert (run.autonomy, run.breakpoints) == ("low", ["confirming"])


def test_a_journal_that_does_not_fit_is_told_and_the_engine_serves(halted, start, caplog, monkeypatch):
    file = halted.runtime.folder / "run.json"
    kept = file.read_bytes()
    halted.close()
    file.write_bytes(kept.replace(b'"active":["confirming"]', b'"active":["gone"]'))
    again = start()
    assert again.call(m.GetEngine()).run is None
    assert "is lost: active: got 'gone'; expected one of" in caplog.text
    again.close()
    file.write_bytes(kept)

    def crash(*_, **__):
        raise KeyError("what nobody thought of")

    monkeypatch.setattr("engines.engine.ProgramRun", crash)
    assert start().call(m.GetEngine()).run is None
    assert "KeyError" in caplog.text


def test_time_that_a_run_waits_for_is_let_go_on(stack, daemon, wait_until, tmp_path, monkeypatch):
    """In lock-step it stands while a program computes; nobody else would release it where no state does anything."""
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    (tmp_path / "rtc_programs").mkdir()
    (tmp_path / "rtc_programs" / "wait.yaml").write_text(
        "title: Wait\nstates:\n"
        "  waiting: {transitions: [{after: 9999, target: done}]}\n  done: {final: true, outcome: succeeded}\n"
    )
    stack.call(m.Run(deployment=stack.call(m.Deploy(program="wait", bindings={})).id))
    wait_until(lambda: "ReleaseTime" in daemon.kinds())
    assert stack.call(m.GetEngine()).run.status == "running"
    stack.call(m.StopRun())
    assert stack.ended().status == "stopped"
