"""Whatever an operator does in whatever order: motion stops with the program, each question is closed exactly once, and an engine
that is killed loses nothing that it has told.
"""

from __future__ import annotations

import re
from collections import Counter
from types import SimpleNamespace

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from engines.programs import library
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
    "set": lambda deployed: m.SetRunParameters(parameters={"goal_deg": 77}),
    "less autonomy": lambda deployed: m.SetAutonomy(level="low"),
}
TEXT = library.files()["turn_valve"].read_text()
ENDED = ("stopped", "failed", "succeeded")


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
        stack.wait(lambda e: isinstance(e, m.RunState) and e.run == run.run and e.status in ENDED)


class History:
    """Engines, one after the other, and what they have asked."""

    def __init__(self, start, daemon):
        self.daemon, self._start = daemon, start
        self.asked: list[str] = []
        self.closed: Counter[str] = Counter()
        self._left: set[str] = set()
        """open ones that the engine before left to the next one"""
        self._heard = self._kills = self._edits = 0
        self.engine = start()
        self.engine.place()

    def deploy(self) -> str:
        return self.engine.call(m.Deploy(program="turn_valve", bindings={"arm": "right", "valve": "wheel_1"})).id

    def edit(self) -> None:
        """The program is saved anew, with another state's name or without it: it goes on so, or asks."""
        self._edits += 1
        text = TEXT.replace("variables:", f"variables:\n  edit: {self._edits}", 1)
        if self._edits % 2:
            text = re.sub(r"\bconfirming\b", "asking", text)
        there = self.engine.call(m.GetProgram(program="turn_valve")).text
        do(self.engine, m.SaveProgram(program="turn_valve", text=text, was=there))

    def approve(self) -> None:
        for prompt in self.engine.call(m.GetEngine()).prompts:
            do(self.engine, m.AnswerPrompt(id=prompt.id, answer=prompt.options[0]))

    def kill(self) -> None:
        """One that is killed tells and writes nothing any more; what it moved the daemon ends, for want of its owner.

        What it told last of its run the next one has, paused; what it asked the next one has withdrawn, and an edit that waits it
        asks about anew.
        """
        old = self.engine.engine
        prompts, run = old._services.prompts, old._run
        told = self._killed(old, prompts, run)
        self._kills += 1
        self._hear(old)
        open_ones = [id for id in self.asked if not self.closed[id]]
        self.engine, self._heard = self._start(), 0
        self._lost_nothing(told)
        for id in open_ones:
            assert self.engine.refusal(m.AnswerPrompt(id=id, answer="approve")).message == "the prompt was withdrawn"
            self.closed[id] += 1
            self._left.add(id)  # whether anybody listened yet when its withdrawal was told nobody knows
        assert all("was edited" in prompt.text for prompt in self.engine.call(m.GetEngine()).prompts)

    def _killed(self, old, prompts, run):
        """From one moment on; returns what was told of its run until then."""
        with prompts._changed:
            if run is None:
                self._mute(old, prompts)
                return None
            with run._lock:
                self._mute(old, prompts)
                return run.state

    @staticmethod
    def _mute(old, prompts) -> None:
        old._journal = SimpleNamespace(write=lambda *run: None)
        prompts._file = None
        prompts._publish = old._tell = lambda event: None

    def _hear(self, engine) -> None:
        """All that was told until now, and not heard yet."""
        last = f"the last word {self._kills} {self._heard}"
        engine._outbox.put(m.LogLine(source="test", level="info", text=last))
        engine._wake.set()
        self.engine.wait(lambda e: isinstance(e, m.LogLine) and e.text == last)
        new = self.engine.events[self._heard :]
        self._heard += len(new)
        for event in new:
            if isinstance(event, m.Prompt):
                self.asked.append(event.id)
            elif isinstance(event, m.PromptClosed) and event.id not in self._left:
                self.closed[event.id] += 1

    def _lost_nothing(self, told) -> None:
        run = self.engine.call(m.GetEngine()).run
        if told is None or told.status in ENDED:
            assert run is None
            return
        assert (run.run, run.status, run.program) == (told.run, "paused", told.program)
        assert (run.breakpoints, run.autonomy) == (told.breakpoints, told.autonomy)
        assert told.data.items() <= run.data.items(), "an edit that has its place now may add some"
        assert run.active == (told.active or run.active)

    def check_questions(self) -> None:
        """Each was closed, and once."""
        self._hear(self.engine.engine)
        assert all(self.closed[id] == 1 for id in self.asked)


@given(st.lists(st.sampled_from([*CALLS, "approve", "approve", "run", "edit", "kill"]), min_size=3, max_size=8))
@settings(max_examples=10, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], derandomize=True)
def check(history, orders):
    """One life of an operator with one engine after another."""
    daemon = history.daemon
    daemon.slow = True
    deployed = history.deploy()
    do(history.engine, m.Run(deployment=deployed))
    for order in orders:
        if order == "approve":
            history.approve()
        elif order == "edit":
            history.edit()
        elif order == "kill":
            history.kill()
            deployed = history.deploy()
        else:
            do(history.engine, CALLS[order](deployed))
    do(history.engine, m.StopRun())
    ended(history.engine)
    assert daemon.action is None
    assert not history.engine.call(m.GetEngine()).prompts
    for call in (m.SetBreakpoints(states=[]), m.SetAutonomy(level="full")):
        do(history.engine, call)
    history.check_questions()


def test_whatever_is_done_motion_stops_with_the_program_each_question_is_closed_once_and_no_state_is_lost(
    start, daemon
):
    check(History(start, daemon))
