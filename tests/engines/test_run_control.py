"""Pause, resume, stop and the end of the daemon act on the motion, and say so."""

from __future__ import annotations

from handrail import messages as m


def begin(stack, daemon, wait_until, **parameters):
    """A run whose first action is under way and stays so."""
    daemon.slow = True
    stack.place()
    stack.run(**parameters)
    stack.call(m.AnswerPrompt(id=stack.prompt().id, answer="approve"))
    wait_until(daemon.started)
    wait_until(lambda: stack.engine._run._motion._action)
    return daemon.started()[0]


def test_pause_stops_the_action_and_resume_lets_it_go_on(stack, daemon, wait_until):
    action = begin(stack, daemon, wait_until, goal_deg=10)
    stack.call(m.PauseRun())
    assert [call.id for call in daemon.calls if isinstance(call, m.PauseAction)] == [action.id]
    assert stack.call(m.GetEngine()).run.status == "paused"
    stack.call(m.ResumeRun())
    assert [call.id for call in daemon.calls if isinstance(call, m.ResumeAction)] == [action.id]
    daemon.slow = False
    daemon.finish()
    assert stack.ended().status == "succeeded"


def test_nothing_new_starts_while_paused_even_when_the_action_just_ended(stack, daemon, wait_until):
    begin(stack, daemon, wait_until, goal_deg=10)
    stack.call(m.PauseRun())
    daemon.finish()
    wait_until(lambda: daemon.action is None)
    wait_until(lambda: not stack.engine._run._motion._action)
    assert len(daemon.started()) == 1
    daemon.slow = False
    stack.call(m.ResumeRun())
    assert stack.ended().status == "succeeded"
    assert len(daemon.started()) > 1


def test_stop_cancels_the_motion_and_ends_the_run(stack, daemon, wait_until):
    action = begin(stack, daemon, wait_until)
    stack.call(m.StopRun())
    ended = stack.ended()
    assert ended.status == "stopped"
    assert [call.id for call in daemon.calls if isinstance(call, m.CancelAction)] == [action.id]
    assert len(daemon.started()) == 1
    assert daemon.kinds()[-1] == "ReleaseTime"


def test_stop_of_a_paused_run_starts_nothing(stack, daemon, wait_until):
    begin(stack, daemon, wait_until)
    stack.call(m.PauseRun())
    daemon.finish()
    wait_until(lambda: daemon.action is None)
    stack.call(m.StopRun())
    assert stack.ended().status == "stopped"
    assert len(daemon.started()) == 1


def test_stop_withdraws_an_open_prompt(stack, daemon):
    stack.place()
    stack.run()
    prompt = stack.prompt()
    stack.call(m.StopRun())
    assert stack.ended().status == "stopped"
    closed = stack.wait(lambda e: isinstance(e, m.PromptClosed))
    assert closed.id == prompt.id and closed.answer == ""
    assert stack.call(m.GetEngine()).prompts == []
    assert "withdrawn" in stack.refusal(m.AnswerPrompt(id=prompt.id, answer="approve")).message


def test_the_operator_stop_fails_the_run_by_name(stack, daemon, wait_until):
    begin(stack, daemon, wait_until)
    daemon.operator_stop()
    ended = stack.ended()
    assert ended.status == "failed"
    assert "operator stop" in ended.detail


def test_a_silent_daemon_fails_the_run_instead_of_leaving_it_running(stack, daemon, wait_until):
    begin(stack, daemon, wait_until)
    daemon.close()
    ended = stack.ended()
    assert ended.status == "failed"
    assert "daemon has gone silent" in ended.detail


def test_a_daemon_that_was_started_anew_fails_the_run_whose_action_it_does_not_know(stack, daemon, wait_until):
    begin(stack, daemon, wait_until)
    daemon.action = None
    ended = stack.ended()
    assert ended.status == "failed"
    assert "started anew" in ended.detail


def test_control_without_a_run_is_refused(stack):
    for call in (m.PauseRun(), m.ResumeRun(), m.StopRun()):
        assert stack.refusal(call).message == "nothing is running"


def test_resume_of_what_is_not_paused_is_refused(stack, daemon, wait_until):
    begin(stack, daemon, wait_until)
    refusal = stack.refusal(m.ResumeRun())
    assert (refusal.field, refusal.value, refusal.expected) == ("status", "running", "paused")


def test_a_second_run_is_refused_while_one_runs(stack, daemon, wait_until):
    begin(stack, daemon, wait_until)
    deployed = stack.call(m.Deploy(program="turn_valve", bindings={"arm": "left", "valve": "wheel_1"}))
    assert "busy" in stack.refusal(m.Run(deployment=deployed.id)).message


def test_the_engine_stays_answering_while_a_plan_is_computed(stack, planner, wait_until):
    stack.place()
    planner.pace.clear()
    stack.run()
    wait_until(lambda: stack.call(m.GetEngine(), timeout_s=2).run.active == ["planning"])
    stack.call(m.StopRun())
    planner.pace.set()
    assert stack.ended().status == "stopped"


def test_the_engine_checks_in_while_it_lives(stack, daemon, wait_until):
    wait_until(lambda: any(isinstance(call, m.CheckIn) and call.owner == "engine" for call in daemon.calls))
