"""A program that is edited while it runs: the run goes on in the new version, with what moves, or the operator is asked."""

from __future__ import annotations

import re

import msgspec
import pytest

from engines.programs import library
from handrail import messages as m

BOUND = {"arm": "right", "valve": "wheel_1"}
TEXT = library.files()["turn_valve"].read_text()


def edited(*changes: tuple[str, str]) -> str:
    """turn_valve with each of these replaced, once."""
    text = TEXT
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    return text


def bring(stack, text: str, was: str = TEXT) -> None:
    stack.call(m.SaveProgram(program="turn_valve", text=text, was=was))


def state(stack, wanted):
    return stack.wait(lambda e: isinstance(e, m.RunState) and wanted(e))


@pytest.fixture
def moving(stack, stroking):
    """The state of a run in its first stroke, which moves."""
    return state(stack, lambda run: run.active == ["turning", "stroking"])


@pytest.fixture
def halted(stack):
    """A run that has come to a breakpoint at its prompt."""
    stack.place()
    stack.call(m.SetBreakpoints(states=["confirming"]))
    stack.run(goal_deg=10)
    state(stack, lambda run: run.status == "paused" and run.waiting == ["confirming"])
    return stack


SOFTER = (
    ('detail: "turned {turned_deg:.0f}°', 'detail: "edited, {added}, turned {turned_deg:.0f}°'),
    (
        "variables:",
        "variables:\n  added: 7",
    ),
)


def test_what_moves_goes_on_and_the_run_ends_as_the_new_version_says(stack, daemon, moving):
    bring(stack, edited(*SOFTER))
    now = state(stack, lambda run: run.hash != moving.hash)
    assert (now.run, now.status, now.active) == (moving.run, "running", ["turning", "stroking"])
    assert now.data["added"] == 7 and now.data["goal_deg"] == 10 and now.data["plan"] == moving.data["plan"]
    assert not [call for call in daemon.calls if isinstance(call, m.CancelAction)]
    daemon.slow = False
    daemon.finish()
    ended = stack.ended()
    assert (ended.run, ended.status) == (moving.run, "succeeded") and ended.detail.startswith("edited, 7, turned")
    visits = [visit.state for visit in stack.call(m.GetRunHistory()).visits]
    assert visits.count("stroking") == 1


def test_a_transition_of_the_very_state_that_is_active_counts_as_it_is_now(stack, daemon, moving):
    bring(stack, edited(("stroke: stroke + 1", "stroke: stroke + 5")))
    state(stack, lambda run: run.hash != moving.hash)
    daemon.slow = False
    daemon.finish()
    assert "in 5 strokes" in stack.ended().detail


def test_what_the_state_does_otherwise_in_the_new_version_begins_anew(stack, daemon, moving, wait_until):
    first = daemon.action.id
    bring(stack, edited(("with: {plan: plan}", "with: {plan: plan, segments: [approach]}")))
    told = stack.wait(lambda e: isinstance(e, m.LogLine) and "was edited: the run goes on" in e.text)
    assert "stroking begins anew, for it does something else now" in told.text
    assert first in [call.id for call in daemon.calls if isinstance(call, m.CancelAction)]
    assert stack.prompt(2).plan == "plan-2", "the robot has left the plan's start: the program plans anew"


def test_deployed_anew_with_the_same_bound_it_goes_on_too_and_with_another_arm_it_is_another_task(
    stack, moving, tmp_path, monkeypatch
):
    (tmp_path / "rtc_programs").mkdir()
    (tmp_path / "rtc_programs" / "turn_valve.yaml").write_text(edited(*SOFTER))
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    stack.call(m.Deploy(program="turn_valve", bindings=BOUND | {"arm": "left"}))
    assert stack.call(m.GetEngine()).run.hash == moving.hash
    newer = stack.call(m.Deploy(program="turn_valve", bindings=BOUND, parameters={"goal_deg": 20}))
    now = state(stack, lambda run: run.deployment == newer.id)
    assert (now.run, now.data["goal_deg"]) == (moving.run, 20)


GONE = ("      stroking:\n", "      pushing:\n")
RENAMED = edited(GONE).replace("invoke.stroking", "invoke.pushing").replace("target: stroking", "target: pushing")


def test_where_the_active_state_is_gone_the_operator_is_asked_and_the_old_version_goes_on_meanwhile(
    stack, daemon, moving
):
    bring(stack, RENAMED)
    asked = stack.prompt(2)
    assert "stroking, which is active, is elsewhere in the new version or not there" in asked.text
    assert asked.options[:2] == ["keep the old version", "stop"] and "pushing" in asked.options
    stack.call(m.AnswerPrompt(id=asked.id, answer="keep the old version"))
    daemon.slow = False
    daemon.finish()
    ended = stack.ended()
    assert (ended.status, ended.hash) == ("succeeded", moving.hash)


def test_a_state_that_both_have_ends_the_question(stack, daemon, moving):
    bring(stack, RENAMED.replace("title: Back out", "title: Out"))
    asked = stack.prompt(2)
    daemon.trip = lambda action: "pose_error"
    daemon._todo.append(lambda: daemon._ended("pose_error", 0.5))
    closed = stack.wait(lambda e: isinstance(e, m.PromptClosed) and e.id == asked.id)
    assert not closed.answer
    state(stack, lambda run: run.hash != moving.hash)
    stack.call(m.StopRun())
    stack.ended()


def test_the_operator_may_go_on_in_the_new_version_elsewhere_or_stop(stack, daemon, moving):
    bring(stack, RENAMED)
    stack.call(m.AnswerPrompt(id=stack.prompt(2).id, answer="planning"))
    assert stack.wait(lambda e: isinstance(e, m.RunState) and e.run == moving.run and e.status == "stopped")
    assert stack.prompt(3).text.startswith("Turn wheel_1")
    assert stack.call(m.GetEngine()).run.hash != moving.hash
    bring(stack, re.sub(r"\bconfirming\b", "asking", TEXT), RENAMED)
    asked = stack.prompt(4)
    stack.call(m.AnswerPrompt(id=asked.id, answer="stop"))
    run = stack.call(m.GetEngine()).run.run
    state(stack, lambda told: told.run == run and told.status == "stopped")
    assert not stack.call(m.GetEngine()).prompts


def test_a_paused_run_waits_in_the_new_version_and_a_breakpoint_of_a_state_that_is_gone_is_gone(stack, daemon):
    stack.place()
    stack.call(m.SetBreakpoints(states=["confirming", "stroking"]))
    stack.run(goal_deg=10)
    before = state(stack, lambda run: run.waiting == ["confirming"])
    bring(stack, RENAMED.replace("Turn {valve} by", "Shall {valve} be turned by"))
    now = state(stack, lambda run: run.hash != before.hash and run.waiting)
    assert (now.status, now.waiting, now.breakpoints) == ("paused", ["confirming"], ["confirming"])
    stack.call(m.ResumeRun())
    assert stack.prompt().text.startswith("Shall wheel_1"), "what it has not begun it does as it is now"


def test_what_is_unsound_or_can_not_be_bound_leaves_the_run_as_it_is(stack, moving):
    bring(stack, edited(("  valve: {kind", "  second: {kind: arm}\n  valve: {kind")))
    told = stack.wait(lambda e: isinstance(e, m.LogLine) and "goes on in the version that runs" in e.text)
    assert "second" in told.text
    assert stack.call(m.GetEngine()).run.hash == moving.hash


def killed(stack, monkeypatch):
    """End an engine that writes nothing any more, as one that is killed."""
    monkeypatch.setattr(stack.engine._journal, "write", lambda *run: None)
    stack.close()


def test_an_edit_that_waits_comes_back_with_the_run_of_an_engine_that_was_killed(
    halted, start, wait_until, monkeypatch
):
    before = halted.call(m.GetEngine()).run
    bring(halted, re.sub(r"\bconfirming\b", "asking", TEXT))
    lost = halted.prompt()
    killed(halted, monkeypatch)
    again = start()
    wait_until(lambda: again.call(m.GetEngine()).prompts)
    (asked,) = again.call(m.GetEngine()).prompts
    run = again.call(m.GetEngine()).run
    assert (run.run, run.status, run.active, run.hash) == (before.run, "paused", ["confirming"], before.hash)
    assert (asked.text, asked.options, asked.run) == (lost.text, lost.options, run.run) and asked.id != lost.id
    again.call(m.SetBreakpoints(states=[]))
    again.call(m.AnswerPrompt(id=asked.id, answer="planning"))
    assert state(again, lambda told: told.hash != before.hash and told.active == ["asking"])


def test_run_from_another_state_the_edit_still_waits_for_its_place(stack, daemon, moving):
    bring(stack, re.sub(r"\bstroking\b", "pushing", re.sub(r"\bconfirming\b", "asking", TEXT)))
    lost = stack.prompt(2)
    begun = stack.call(m.RunFrom(state="confirming"))
    stack.wait(lambda e: isinstance(e, m.PromptClosed) and e.id == lost.id)
    asked = stack.wait(
        lambda e: isinstance(e, m.Prompt) and e.run == begun.run and "confirming, which is active" in e.text
    )
    stack.call(m.AnswerPrompt(id=asked.id, answer="planning"))
    assert state(stack, lambda run: run.hash != moving.hash and run.active == ["asking"])


def test_a_run_comes_back_with_the_release_that_it_was_made_from_whatever_is_in_force_by_now(
    halted, start, wait_until, monkeypatch
):
    file, name = halted.engine._journal._file, halted.engine._run.state.run

    def kept() -> dict:
        return msgspec.json.decode(file.read_bytes())

    bring(halted, edited(*SOFTER))
    wait_until(lambda: kept()["release"])
    made_from = kept()["release"]
    bring(halted, TEXT, edited(*SOFTER))
    wait_until(lambda: kept()["release"] != made_from)
    killed(halted, monkeypatch)
    file.write_bytes(msgspec.json.encode({**kept(), "release": made_from}))
    again = start()
    wait_until(lambda: again.call(m.GetEngine()).run.waiting == ["confirming"])
    assert again.engine._run.state.run == name
    assert str(again.engine._run.deployed.folder) == made_from


def test_an_edit_that_was_answered_is_not_asked_about_again(halted, start, wait_until, monkeypatch):
    bring(halted, re.sub(r"\bconfirming\b", "asking", TEXT))
    halted.call(m.AnswerPrompt(id=halted.prompt().id, answer="keep the old version"))
    halted.wait(lambda e: isinstance(e, m.LogLine) and "goes on in the old version" in e.text)
    killed(halted, monkeypatch)
    again = start()
    wait_until(lambda: again.call(m.GetEngine()).run.waiting == ["confirming"])
    assert not again.call(m.GetEngine()).prompts
    again.call(m.SetBreakpoints(states=[]))
    again.call(m.RunFrom(state="planning"))  # plans are gone with the engine that made them
    assert again.prompt().text.startswith("Turn wheel_1"), "the program's own question, and no other"


def test_an_edit_that_can_not_be_read_any_more_is_told_and_the_run_comes_back_without(
    halted, start, wait_until, monkeypatch, caplog
):
    bring(halted, re.sub(r"\bconfirming\b", "asking", TEXT))
    halted.prompt()
    file = halted.engine._journal._file
    killed(halted, monkeypatch)
    kept = msgspec.json.decode(file.read_bytes())
    kept["edit"]["program"] = "program: [nonsense"
    file.write_bytes(msgspec.json.encode(kept))
    again = start()
    wait_until(lambda: again.call(m.GetEngine()).run.waiting == ["confirming"])
    assert "the edit of turn_valve that waited is lost" in caplog.text
