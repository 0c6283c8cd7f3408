"""What a program does by itself: in states that are entered and left, and in transitions; alone, and as a state of another one."""

from __future__ import annotations

import pytest

from engines.programs import program
from engines.programs.statechart import Chart
from engines.runs.clock import RunClock
from handrail.config import ConfigError

INNER = """
title: Inner
variables: {n: 1}
states:
  first:
    enter: [{set: {n: n + 1}}, {log: "n is {n}"}, {raise: told}]
    exit: [{log: left}]
    transitions:
      - event: told
        target: last
        actions:
          - if: n == 2
            then: [{send: late, after: n * 5}, {send: soon}]
            else: [{log: never}]
  last: {final: true, outcome: succeeded, detail: "{n}"}
"""
OUTER = """
title: Outer
variables: {n: 10}
states:
  whole:
    parallel: true
    states:
      working:
        states:
          calling:
            do: program
            with: {program: inner}
            transitions: [{event: done.invoke.calling, target: over}, {event: error.execution, target: over}]
          over: {final: true}
      hearing:
        states:
          waiting: {transitions: [{event: soon, target: heard}]}
          heard: {enter: [{log: "heard, n is {n}"}], transitions: [{event: late, target: end}]}
          end: {enter: [{log: over}], final: true}
    transitions: [{event: done.state.whole, target: done}]
  done: {final: true, outcome: succeeded}
"""


@pytest.fixture
def read(tmp_path):
    def read(text: str) -> program.Program:
        for name, each in {"inner": INNER, "it": text}.items():
            (tmp_path / f"{name}.yaml").write_text(each)
        return program.read(tmp_path / "it.yaml", library={"inner": tmp_path / "inner.yaml"})

    return read


def run(found: program.Program) -> tuple[list[str], int]:
    """What it logged, and how many s it took."""
    logged: list[str] = []
    clock, seconds = RunClock(), 0
    chart = Chart(found, dict(found.variables), lambda *_: None, clock=clock, log=lambda _, text: logged.append(text))
    clock.tick(0)
    chart.begin()
    while chart.ended is False:
        if not chart.step(0.0):
            seconds += 1
            assert seconds < 100, chart.active()
            clock.tick(seconds * 1_000_000_000)
    return logged, seconds


def test_events_are_raised_before_and_sent_after_others_or_after_their_time_and_words_are_logged(read):
    assert run(read(INNER)) == (["n is 2", "left"], 0)


def test_names_are_the_inner_programs_own_and_its_events_are_heard_by_all(read):
    assert run(read(OUTER)) == (["n is 2", "left", "heard, n is 10", "over"], 10)


INTERNAL = """
title: Internal
states:
  around:
    exit: [{log: left}]
    transitions: [{event: go, target: within, internal: true}, {event: out, target: done}]
    states:
      outside: {enter: [{raise: go}]}
      within: {enter: [{log: within}, {raise: out}]}
  done: {final: true, outcome: succeeded}
"""


def test_an_internal_transition_does_not_leave_its_state(read):
    assert run(read(INTERNAL))[0] == ["within", "left"]
    assert run(read(INTERNAL.replace(", internal: true", "")))[0] == ["left", "within", "left"]


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (
            "{set: {n: n + 1}}",
            "{set: {m: 1}}",
            r":6: states\.first\.enter\[0\]\.set\.m: no such variable; expected one of n",
        ),
        ("{set: {n: n + 1}}", "{set: {n: m}}", r"enter\[0\]\.set\.n: unknown name 'm'"),
        ("{raise: told}", "{raise: told, log: x}", r"enter\[2\]: got raise and log; expected one of set, raise"),
        ("{raise: told}", "{}", r"enter\[2\]: got nothing; expected one of"),
        ("{raise: told}", "{raise: error.x}", r"enter\[2\]: got 'error.x'; expected the name of one event"),
        (
            "{raise: told}",
            "{raise: told, after: 1}",
            r"enter\[2\]\.after: got 1.*; expected a time in s above 0, of what is sent",
        ),
        ("{raise: told}", "{raise: told, data: {a: 1}}", r"enter\[2\]\.data: data of nothing; expected it with `send`"),
        ("after: n * 5", "data: {a: m}", r"then\[0\]\.data\.a: unknown name 'm'"),
        ("after: n * 5", "data: {a: _event.data.b}", r"then\[0\]\.data\.a: .*expected no _event"),
        ("after: n * 5", "data: {event: 1}", r"then\[0\]\.data\.event: 'event' can't be used in expressions"),
        ("after: n * 5", "after: -1", r"actions\[0\]\.then\[0\]\.after: got -1"),
        ("n is {n}", "n is {_event.name}", r"enter\[1\]\.log: .*expected no _event"),
        ("then: [", "otherwise: [", r"actions\[0\].*otherwise"),
    ],
)
def test_what_can_not_be_done_is_told_by_line_and_field(read, old, new, told):
    assert old in INNER
    with pytest.raises(ConfigError, match=told):
        read(INNER.replace(old, new))


SENDS = """
title: Sends
variables: {n: 1, got: 0}
states:
  first:
    enter: [{send: told.twice, data: {much: n + 1, word: "'a'"}, after: 1}, {set: {n: 5}}]
    transitions: [{event: told.*, cond: _event.data.word == 'a', target: last, set: {got: _event.data.much}}]
  last: {final: true, outcome: succeeded, detail: "{got}"}
"""


def test_what_is_sent_has_its_data_as_they_were_when_it_was_sent(read):
    clock, found = RunClock(), read(SENDS)
    chart = Chart(found, found.variables, lambda *_: pytest.fail("nothing is done here"), clock=clock)
    chart.begin()
    clock.tick(0)
    clock.tick(1_000_000_000)
    assert chart.step(0.0)
    assert (chart.ended.id, chart.words(chart.ended.file.detail)) == ("last", "2")


def test_data_that_not_every_such_event_has_is_refused_where_it_is_read(read):
    text = SENDS.replace("{set: {n: 5}}", "{send: told.once, data: {much: 1}}")
    with pytest.raises(ConfigError, match=r":7: .*_event\.data has no 'word' here; expected one of much"):
        read(text)


ENDS = """
title: Ends
variables: {n: 3, got: 0}
states:
  whole:
    states:
      deciding: {transitions: [{cond: n > 2, target: much}, {target: little}]}
      much: {final: true, data: {left: n - 2, word: "'much'"}}
      little: {final: true, data: {left: 0}}
    transitions: [{event: done.state.whole, target: last, set: {got: _event.data.left}}]
  last: {final: true, outcome: succeeded, detail: "{got}"}
"""


def test_a_final_state_in_another_one_says_with_what_that_is_done(read):
    found = read(ENDS)
    chart = Chart(found, found.variables, lambda *_: pytest.fail("nothing is done here"))
    chart.begin()
    assert chart.words(chart.ended.file.detail) == "1"


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("_event.data.left", "_event.data.word", r"_event\.data has no 'word' here; expected one of left"),
        ("left: 0", "left: m", r":9: states\.whole\.states\.little\.data\.left: unknown name 'm'"),
        ("outcome: succeeded,", "outcome: succeeded, data: {a: 1},", r"states\.last\.data: only a final state in another one"),
    ],
)  # fmt: skip
def test_what_a_final_state_can_not_say_is_told_by_line_and_field(read, old, new, told):
    with pytest.raises(ConfigError, match=told):
        read(ENDS.replace(old, new))
