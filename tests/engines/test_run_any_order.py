"""Whatever an operator does in whatever order: motion stops with the program, and each question is closed exactly once."""

from __future__ import annotations

from collections import Counter

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from handrail import messages as m
from handrail.topics import RefusedError

CALLS = {
    "run": lambda deployed: m.Run(deployment=deployed),
    "pause": lambda deployed: m.PauseRun(),
    "resume": lambda deployed: m.ResumeRun(),
    "step": lambda deployed: m.StepRun(),
    "skip the plan": lambda deployed: m.TakeTransition(state="planning"),
    "skip the question": lambda deployed: m.TakeTransition(state="confirming"),
    "give up the motion": lambda deployed: m.TakeTransition(state="stroking", way=0),
    "stop": lambda deployed: m.StopRun(),
    "from the plan": lambda deployed: m.RunFrom(state="planning"),
    "from the motion, paused": lambda deployed: m.RunFrom(state="stroking", paused=True),
    "break": lambda deployed: m.SetBreakpoints(states=["stroking"]),
    "break nowhere": lambda deployed: m.SetBreakpoints(states=[]),
}


def approve(stack):
    for prompt in stack.call(m.GetEngine()).prompts:
        do(stack, m.AnswerPrompt(id=prompt.id, answer="approve"))


def do(stack, call):
    try:
        return stack.call(call)
    except RefusedError as refused:
        assert refused.refusal.message
        assert "could not carry it out" not in refused.refusal.message
        return None


def ended(stack):
    """The last run has; nothing moves, and nothing is asked."""
    run = stack.call(m.GetEngine()).run
    if run is not None:
        stack.wait(
            lambda e: isinstance(e, m.RunState) and e.run == run.run and e.status in ("stopped", "failed", "succeeded")
        )


@given(st.lists(st.sampled_from([*CALLS, "approve", "approve", "run", "kill"]), min_size=3, max_size=8))
@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], derandomize=True)
def check(history, orders):
    """One life of an operator with one engine after another."""
    stack = history.engine
    daemon = history.daemon
    daemon.slow = True
    deployed = stack.call(m.Deploy(program="turn_valve", bindings={"arm": "right", "valve": "wheel_1"})).id
    stack.call(m.Run(deployment=deployed))
    for order in orders:
        if order == "approve":
            approve(stack)
        elif order == "kill":
            stack = history.kill()
            deployed = stack.call(m.Deploy(program="turn_valve", bindings={"arm": "right", "valve": "wheel_1"})).id
        else:
            do(stack, CALLS[order](deployed))
    do(stack, m.StopRun())
    ended(stack)
    assert daemon.action is None
    assert not stack.call(m.GetEngine()).prompts
    do(stack, m.SetBreakpoints(states=[]))
    asked = [event.id for event in stack.events if isinstance(event, m.Prompt)]
    stack.wait(lambda e: not asked or (isinstance(e, m.PromptClosed) and e.id == asked[-1]))
    closed = Counter(event.id for event in stack.events if isinstance(event, m.PromptClosed))
    assert closed == Counter(asked)


class History:
    """Engines, one after the other."""

    def __init__(self, start, daemon, monkeypatch):
        self.daemon, self._start, self._patch = daemon, start, monkeypatch
        self.engine = start()
        self.engine.place()

    def kill(self):
        """One that is killed writes nothing any more; what it moved the daemon ends, for want of its owner."""
        self._patch.setattr(self.engine.engine._journal, "write", lambda *run: None)
        self.engine = self._start()
        return self.engine


def test_whatever_is_done_motion_stops_with_the_program_and_each_question_is_closed_once(start, daemon, monkeypatch):
    check(History(start, daemon, monkeypatch))
