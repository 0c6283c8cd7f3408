"""A program as a statechart: SCXML's semantics, activities in threads, everything else in one."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import pytest

from engines import program
from engines.activities.base import Activity, ActivityFailed
from engines.statechart import Chart, Event

HEAD = "title: T\nresources: {arm: {kind: arm}, valve: {kind: instance}}\nvariables: {n: 0, answer: '', why: ''}\n"


class Step(Activity):
    """Ends when it is told to, with what it is told."""

    made: list[Step]

    def __init__(self, state, values):
        super().__init__(SimpleNamespace(services=None), values)  # type: ignore[arg-type]
        self.state, self.result, self._end = state, {}, threading.Event()

    def run(self):
        assert self._end.wait(10)
        if isinstance(self.result, Exception):
            raise self.result
        return self.result

    def end(self, result):
        self.result = result
        self._end.set()

    def cancel(self):
        super().cancel()
        self.end({})


@pytest.fixture
def begin(tmp_path):
    steps: list[Step] = []
    made = threading.Condition()

    def begin(states: str, **names):
        file = tmp_path / "p.yaml"
        file.write_text(HEAD + states)
        found = program.read(file)

        def make(state, values):
            with made:
                steps.append(Step(state, values))
                made.notify_all()
            return steps[-1]

        chart = Chart(found, {**found.variables, "arm": "right", "valve": "wheel_1", **names}, make)
        chart.begin()
        return chart

    def step(count: int) -> Step:
        with made:
            assert made.wait_for(lambda: len(steps) >= count, 10)
        return steps[count - 1]

    begin.step = step  # type: ignore[attr-defined]
    return begin


PROMPT = """\
states:
  asking:
    do: prompt
    with: {text: "{n} of {valve}?"}
    transitions:
      - {event: done.invoke.asking, cond: _event.data.answer == 'again', target: asking, set: {n: n + 1}}
      - {event: done.invoke.asking, target: good, set: {answer: _event.data.answer}}
      - {event: error.execution, target: bad, set: {why: failure}}
  good: {final: true, outcome: succeeded, detail: "{answer} after {n}"}
  bad: {final: true, outcome: failed, detail: "{why}"}
"""


def test_an_activity_gets_its_arguments_and_its_result_leads_on(begin):
    chart = begin(PROMPT)
    assert chart.active() == ["asking"]
    step = begin.step(1)
    assert step.values["text"] == "0 of wheel_1?"
    step.end({"answer": "again", "by": "me"})
    chart.step()
    again = begin.step(2)
    assert again.values["text"] == "1 of wheel_1?"
    assert not step.cancelled.is_set(), "what is done is not cancelled when its state is left"
    again.end({"answer": "yes", "by": "me"})
    chart.step()
    assert chart.ended.id == "good"
    assert chart.words(chart.ended.file.detail) == "yes after 1"
    assert chart.variables() == {"n": 1, "answer": "yes", "why": ""}


def test_event_data_never_hides_a_variable_of_the_same_name(begin):
    chart = begin(PROMPT.replace("set: {answer: _event.data.answer}", "set: {answer: answer + '!'}"))
    begin.step(1).end({"answer": "yes", "by": "me"})
    chart.step()
    assert chart.variables()["answer"] == "!"


def test_a_failure_is_an_event_with_its_words(begin):
    chart = begin(PROMPT)
    begin.step(1).end(ActivityFailed("refused", "no such plan"))
    chart.step()
    assert chart.ended.id == "bad"
    assert chart.words("{why}") == "no such plan"


def test_a_crash_in_an_activity_is_a_failure_not_a_hang(begin):
    chart = begin(PROMPT)
    begin.step(1).end(ZeroDivisionError("by nothing"))
    chart.step()
    assert "prompt crashed: ZeroDivisionError: by nothing" in chart.variables()["why"]


def test_a_guard_that_can_not_be_evaluated_is_a_failure_with_its_words(begin):
    chart = begin(PROMPT.replace("_event.data.answer == 'again'", "n / 0 == 1"))
    begin.step(1).end({"answer": "yes", "by": "me"})
    chart.step()
    assert chart.ended.id in ("good", "bad")  # SCXML: the guard counts as false, then error.execution follows


def test_stop_ends_it_from_anywhere_and_cancels_what_runs(begin):
    chart = begin(PROMPT)
    step = begin.step(1)
    chart.stop()
    chart.step()
    assert chart.ended is None
    assert step.cancelled.is_set()


NESTED = """\
states:
  outer:
    parallel: true
    states:
      left:
        states:
          a:
            do: prompt
            with: {text: a}
            transitions: [{event: done.invoke.a, target: b}]
          b: {}
      right:
        states:
          c: {transitions: [{event: slip, target: d, set: {n: n + 1}}]}
          d: {}
    transitions:
      - {event: abort, target: bad}
      - {event: error.execution, target: bad}
      - {cond: n == 3, target: good}
  good: {final: true, outcome: succeeded}
  bad: {final: true, outcome: failed}
"""


def test_parallel_states_are_active_together_outermost_first(begin):
    chart = begin(NESTED)
    assert chart.active() == ["outer", "left", "right", "a", "c"]
    begin.step(1).end({})
    chart.step()
    assert chart.active() == ["outer", "left", "right", "b", "c"]
    chart.post(Event("slip"))
    chart.step()
    assert chart.active() == ["outer", "left", "right", "b", "d"]
    assert chart.variables()["n"] == 1


def test_leaving_a_state_cancels_its_activity(begin):
    chart = begin(NESTED)
    step = begin.step(1)
    chart.post(Event("abort"))
    chart.step()
    assert chart.ended.id == "bad"
    assert step.cancelled.is_set()


def test_an_argument_without_a_value_fails_the_state_that_needs_it(begin):
    plan = PROMPT.replace("do: prompt\n", "do: plan\n").replace(
        'with: {text: "{n} of {valve}?"}', "with: {instance: valve, trajectory: turn, arm: arm, arc: 1 / n}"
    )
    chart = begin(plan.replace("_event.data.answer == 'again'", "n == 5").replace("_event.data.answer", "why"))
    chart.step()
    assert chart.ended.id == "bad"
    assert "asking: arc: '1 / n' has no value" in chart.variables()["why"]
