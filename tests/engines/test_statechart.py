"""A program as a statechart: SCXML's semantics, activities in threads, everything else in one."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import pytest

from engines.activities.base import Activity, ActivityFailed
from engines.programs import program
from engines.programs.statechart import Chart, Event
from engines.runs.clock import RunClock
from handrail.config import ConfigError

NOW = 7_000_000_000
"""ns of the robot's clock when a run begins"""
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
def clock():
    return RunClock()


@pytest.fixture
def begin(tmp_path, clock):
    steps: list[Step] = []
    made = threading.Condition()

    def begin(states: str, *, ask=None, withdraw=lambda state: None, **names):
        file = tmp_path / "p.yaml"
        file.write_text(HEAD + states)
        found = program.read(file)

        def make(state, values):
            with made:
                steps.append(Step(state, values))
                made.notify_all()
            return steps[-1]

        chart = Chart(
            found,
            {**found.variables, "arm": "right", "valve": "wheel_1", **names},
            make,
            clock=clock,
            ask=ask,
            withdraw=withdraw,
        )
        clock.tick(NOW)
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


WAITING = PROMPT.replace(
    "    transitions:\n", "    transitions:\n      - {after: 2 + n, target: bad, set: {why: \"'too late'\"}}\n", 1
)


def test_a_time_out_leads_on_when_the_robots_time_is_over_and_not_before(begin, clock):
    chart = begin(WAITING, n=1)
    step = begin.step(1)
    clock.tick(NOW + 2_990_000_000)
    chart.post(Event("nothing"))
    chart.step()
    assert chart.active() == ["asking"]
    clock.tick(NOW + 3_000_000_000)
    chart.step()
    assert chart.variables()["why"] == "too late"
    assert step.cancelled.is_set()


def test_a_time_out_waits_while_the_run_is_paused_and_ignores_another_clock(begin, clock):
    chart = begin(WAITING)
    clock.stand()
    clock.tick(NOW + 4_000_000_000)
    clock.go()
    clock.tick(NOW + 500_000_000_000)  # the plant was started anew
    clock.tick(NOW + 501_999_000_000)
    chart.post(Event("nothing"))
    chart.step()
    assert chart.active() == ["asking"]
    clock.tick(NOW + 502_000_000_000)
    chart.step()
    assert chart.ended.id == "bad"


def test_a_time_out_begins_anew_with_its_state_and_ends_with_it(begin, clock):
    chart = begin(WAITING)
    clock.tick(NOW + 1_500_000_000)
    begin.step(1).end({"answer": "again", "by": "me"})
    chart.step()  # n is 1: 3 s from here
    clock.tick(NOW + 4_400_000_000)
    begin.step(2).end({"answer": "yes", "by": "me"})
    chart.step()
    assert chart.ended.id == "good"


def test_a_time_out_that_is_none_is_a_failure_that_names_it(begin):
    chart = begin(WAITING, n=-5)
    chart.step()
    assert "asking: after: '2 + n' is no time: got -3" in chart.variables()["why"]


RETRIED = PROMPT.replace("do: prompt", "do: prompt\n    retry: 2").replace(
    "{why: failure}", "{why: failure, n: retries_of_asking}"
)


def test_what_fails_is_begun_anew_as_often_as_the_state_says(begin):
    chart = begin(RETRIED)
    for attempt in (1, 2):
        begin.step(attempt).end(ActivityFailed("stall", f"stuck {attempt}"))
        chart.step()
        assert chart.active() == ["asking"]
        assert chart.retries(begin.step(attempt).state) == attempt
    begin.step(3).end(ActivityFailed("stall", "stuck 3"))
    chart.step()
    assert chart.ended.id == "bad"
    assert chart.variables()["why"] == "stuck 3"


def test_retries_count_anew_when_the_state_is_entered_anew(begin):
    chart = begin(RETRIED)
    begin.step(1).end(ActivityFailed("stall", "stuck"))
    chart.step()
    begin.step(2).end({"answer": "again", "by": "me"})
    chart.step()
    assert chart.retries(begin.step(3).state) == 0


def test_what_somebody_wanted_or_can_not_be_is_not_tried_again(begin):
    chart = begin(RETRIED)
    begin.step(1).end(ActivityFailed("taken_over", "somebody else commands the arm"))
    chart.step()
    assert chart.ended.id == "bad"


ASKING = PROMPT.replace("target: good,", "autonomy: high, target: good,").replace(
    "target: bad,", "autonomy: full, target: bad,"
)


def test_at_a_level_above_what_is_required_nobody_is_asked(begin):
    chart = begin(ASKING)
    begin.step(1).end({"answer": "yes", "by": "me"})
    chart.step()
    assert chart.ended.id == "good"


@pytest.mark.parametrize(
    ("level", "required", "is_asked"), [("off", "off", True), ("off", "low", True), ("low", "off", False)]
)
def test_at_the_lowest_level_all_that_names_a_level_is_asked_about(begin, level, required, is_asked):
    asked = []
    chart = begin(ASKING.replace("autonomy: high", f"autonomy: {required}"), ask=asked.append)
    chart.set_autonomy(level)
    begin.step(1).end({"answer": "yes", "by": "me"})
    chart.step()
    assert bool(asked) is is_asked
    assert chart.active() == (["asking"] if is_asked else ["good"])


@pytest.mark.parametrize("level", ["low", "high"])
def test_below_it_the_state_stays_until_the_operator_lets_it_go(begin, level):
    asked, left = [], []
    chart = begin(ASKING, ask=asked.append, withdraw=left.append)
    chart.set_autonomy(level)
    begin.step(1).end({"answer": "yes", "by": "me"})
    chart.step()
    assert chart.active() == ["asking"]
    assert (asked[0].state, asked[0].way, asked[0].required) == ("asking", 1, "high")
    assert asked[0].text == "asking is done. Go on with: good?"
    assert not left
    chart.allow(asked[0])
    chart.step()
    assert chart.ended.id == "good"
    assert chart.variables()["answer"] == "yes", "with the data of the event that was asked about"
    assert "asking" in left


def test_what_is_marked_full_is_always_asked_about_with_the_reason(begin):
    asked = []
    chart = begin(ASKING, ask=asked.append)
    begin.step(1).end(ActivityFailed("stall", "stuck"))
    chart.step()
    assert asked[0].text == "asking has failed: stuck. Go on with: bad?"
    chart.allow(asked[0])
    chart.step()
    assert chart.variables()["why"] == "stuck"


def test_leave_that_comes_too_late_changes_nothing(begin):
    asked = []
    chart = begin(ASKING, ask=asked.append)
    chart.set_autonomy("low")
    begin.step(1).end({"answer": "yes", "by": "me"})
    chart.step()
    chart.take("asking", 0)
    chart.step()
    chart.allow(asked[0])
    chart.step()
    assert chart.active() == ["asking"]
    assert not begin.step(2).cancelled.is_set()


LOOP = """\
states:
  asking:
    do: prompt
    with: {text: "{n}"}
    transitions:
      - {after: 2, target: asking, set: {answer: "'late'"}}
      - {event: done.invoke.asking, target: between, set: {n: n + 1}}
      - {event: error.execution, target: bad}
  between: {transitions: [{cond: n < 9, target: asking}, {target: bad}]}
  bad: {final: true, outcome: failed}
"""


def test_what_was_about_an_earlier_visit_of_a_state_does_not_end_the_next_one(begin, clock, monkeypatch):
    chart, posted, post = begin(LOOP), threading.Semaphore(0), Chart.post
    monkeypatch.setattr(Chart, "post", lambda self, event: (post(self, event), posted.release()))
    begin.step(1).end({})
    assert posted.acquire(timeout=10)
    clock.tick(NOW + 2_000_000_000)  # it is over just when the activity has ended
    chart.take("asking", 1)
    for _ in range(3):
        chart.step()
    assert chart.variables() == {"n": 1, "answer": "", "why": ""}
    assert chart.active() == ["asking"] and not begin.step(2).cancelled.is_set()


def test_a_failure_that_comes_as_a_time_out_leads_on_is_not_the_next_states(begin, clock, monkeypatch):
    chart, posted, post = begin(LOOP), threading.Semaphore(0), Chart.post
    clock.tick(NOW + 2_000_000_000)
    monkeypatch.setattr(Chart, "post", lambda self, event: (post(self, event), posted.release()))
    begin.step(1).end(ActivityFailed("stall", "stuck"))
    assert posted.acquire(timeout=10)
    chart.step()
    chart.step()
    assert chart.variables()["answer"] == "late"
    assert chart.active() == ["asking"]


def test_an_activity_that_ends_long_after_its_state_was_left_does_not_keep_the_next_from_being_cancelled(
    begin, clock, monkeypatch
):
    monkeypatch.setattr(Step, "cancel", Activity.cancel)  # it takes its time
    chart = begin(LOOP)
    first = begin.step(1)
    clock.tick(NOW + 2_000_000_000)
    chart.step()
    second = begin.step(2)
    assert first.cancelled.is_set() and not second.cancelled.is_set()
    first.end({})
    chart.step()  # what it says
    assert len(chart._doing._running) == 1
    chart.stop()
    chart.step()
    assert second.cancelled.is_set()
    second.end({})


INNER = """\
states:
  outer:
    states:
      first: {transitions: [{event: on, target: second}]}
      second: {transitions: [{event: out, target: away}]}
  away: {transitions: [{event: back, target: outer}]}
  good: {final: true, outcome: succeeded}
"""


def test_where_a_run_begins_further_down_the_state_is_entered_as_its_file_says_later(tmp_path):
    file = tmp_path / "p.yaml"
    file.write_text(
        HEAD + INNER.replace("transitions: [{event: back", "transitions: [{event: end, target: good}, {event: back")
    )
    found = program.read(file)
    chart = Chart(found, found.variables, Step, start_at=["second"])
    chart.begin()
    assert chart.active() == ["outer", "second"]
    for event in ("out", "back"):
        chart.post(Event(event))
        chart.step()
    assert chart.active() == ["outer", "first"]


STARTS = """\
start: one_b two_b
states:
  both:
    parallel: true
    states:
      one: {states: {one_a: {transitions: [{event: x, target: one_b}]}, one_b: {transitions: [{event: next, target: away}]}}}
      two: {states: {two_a: {transitions: [{event: x, target: two_b}]}, two_b: {transitions: [{event: x, target: two_a}]}}}
  away:
    enter: [{set: {why: "why + 'entered '"}}]
    start: {target: middle, set: {n: n + 1}, actions: [{set: {why: "why + 'on the way '"}}]}
    transitions: [{event: next, target: both}, {event: end, target: good}]
    states:
      middle:
        start: {target: deep}
        states:
          shallow: {transitions: [{event: x, target: deep}]}
          deep: {enter: [{set: {why: "why + 'there'"}}], transitions: [{event: x, target: shallow}]}
  good: {final: true, outcome: succeeded}
"""


def test_a_run_and_a_state_begin_further_down_with_what_is_done_on_the_way(begin):
    chart = begin(STARTS)
    assert set(chart.active()) == {"both", "one", "two", "one_b", "two_b"}
    chart.post(Event("next"))
    chart.step()
    assert chart.active() == ["away", "middle", "deep"]
    assert chart.variables()["why"] == "entered on the way there" and chart.variables()["n"] == 1
    chart.post(Event("next"))
    chart.step()
    assert set(chart.active()) == {"both", "one", "two", "one_a", "two_a"}, "the run's start is the run's alone"


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("start: one_b two_b", "start: one_b one_a", "'one_a' can't be active together with 'one_b'"),
        ("start: one_b two_b", "start: nowhere", "start: got 'nowhere'"),
        ("target: middle, set", "target: one_b, set", "states within away"),
        ("target: middle, set", "target: deep, set", "done on the way; expected one of its own"),
        ("{target: middle, set", "{event: x, target: middle, set", "is always taken"),
        ("    parallel: true", "    parallel: true\n    start: {target: one_b}", "not parallel"),
    ],
)
def test_a_start_that_leads_nowhere_within_is_refused_by_field(begin, old, new, told):
    with pytest.raises(ConfigError, match=told):
        begin(STARTS.replace(old, new))
