"""`do: program`: another program as one state, its names its own, and everything that a run can do inside it."""

from __future__ import annotations

import jsonschema
import pytest

from engines.activities.base import ActivityFailed
from engines.programs import program
from engines.programs.call import SIGNATURES
from engines.programs.picture import draw
from engines.programs.schema import json_schema
from engines.programs.statechart import Chart
from handrail import messages as m
from handrail.config import ConfigError

from .test_statechart import Step

GRIP = """\
title: Grip
resources: {hand: {kind: arm}, what: {kind: instance}}
parameters: {force: {default: 5, unit: N, min: 1, max: 50}}
variables: {n: 0, found: 0.0, why: ''}
outputs: {found: {unit: m}, tries: {value: n + 1, type: integer}}
states:
  asking:
    do: prompt
    with: {text: "{hand} {what} {force:g} {n}"}
    transitions:
      - {event: done.invoke.asking, cond: _event.data.answer == 'again', target: asking, set: {n: n + 1}}
      - {event: done.invoke.asking, target: held, set: {found: 0.25}}
      - {event: error.execution, target: slipped, set: {why: failure}}
  held: {final: true, outcome: succeeded}
  slipped: {final: true, outcome: failed, detail: "slipped after {n}: {why}"}
"""
MOVE = """\
title: Move
resources: {arm: {kind: arm}, box: {kind: instance}}
parameters: {grip: {default: 4, unit: N, min: 1, max: 60}}
variables: {n: 7, far: 0.0, why: ''}
states:
  gripping:
    do: program
    with: {program: grip, bind: {hand: arm, what: box}, parameters: {force: 2 * grip}}
    retry: 1
    transitions:
      - {event: done.invoke.gripping, cond: _event.data.outcome == 'held', target: good,
         set: {far: _event.data.found + _event.data.tries, n: n + 1}}
      - {event: error.execution, cond: _event.data.reason == 'slipped', target: bad, set: {why: failure}}
      - {event: error.execution, target: bad, set: {why: "'odd: ' + failure"}}
  good: {final: true, outcome: succeeded, detail: "{far}"}
  bad: {final: true, outcome: failed, detail: "{why}"}
"""


@pytest.fixture
def write(tmp_path):
    """Writes programs; returns name → file."""

    def write(**texts):
        for name, text in texts.items():
            (tmp_path / f"{name}.yaml").write_text(text)
        return {file.stem: file for file in tmp_path.glob("*.yaml")}

    return write


@pytest.fixture
def begin(write):
    steps: list[Step] = []

    def begin(name="move", **texts):
        files = write(**{"grip": GRIP, "move": MOVE, **texts})
        found = program.read(files[name], files)

        def make(state, values):
            steps.append(Step(state, values))
            return steps[-1]

        chart = Chart(found, {**found.variables, "arm": "left", "box": "box_1", "grip": 4}, make)
        chart.begin()
        return chart

    begin.steps = steps
    return begin


@pytest.fixture
def step(begin, wait_until):
    def step(count):
        wait_until(lambda: len(begin.steps) >= count)
        return begin.steps[count - 1]

    return step


def test_a_program_runs_as_one_state_with_what_it_is_given_and_gives_back_what_it_says(begin, step):
    chart = begin()
    assert chart.active() == ["gripping", "gripping/asking"]
    assert step(1).values["text"] == "left box_1 8 0"
    step(1).end({"answer": "again"})
    chart.step()
    assert step(2).values["text"] == "left box_1 8 1", "its n is not the caller's"
    assert chart.variables() == {
        "n": 7, "far": 0.0, "why": "", "gripping/n": 1, "gripping/found": 0.0, "gripping/why": "", "gripping/force": 8,
    }  # fmt: skip
    step(2).end({"answer": "yes"})
    assert chart.step()
    assert chart.step(), "its end is the state's"
    assert chart.ended.id == "good"
    assert chart.variables() == {"n": 8, "far": 2.25, "why": ""}


def test_a_program_and_what_it_runs_know_of_which_template_their_instance_is(write, wait_until):
    inner = GRIP.replace("what: {kind: instance}", "what: {kind: instance, template: [box, cap]}").replace(
        "{hand} {what}", "{what} {template_of_what}"
    )
    outer = MOVE.replace("box: {kind: instance}", "box: {kind: instance, template: [box, cap]}")
    files, steps = write(grip=inner, move=outer), []
    found = program.read(files["move"], files)

    def make(state, values):
        steps.append(Step(state, values))
        return steps[-1]

    Chart(found, {**found.variables, "arm": "left", "box": "it", "template_of_box": "cap", "grip": 4}, make).begin()
    wait_until(lambda: steps)
    assert steps[0].values["text"] == "it cap 8 0"
    files = write(grip=inner.replace("[box, cap]", "[box, lid]"), move=outer)
    with pytest.raises(ConfigError, match="no resource that is an instance of template box or lid"):
        program.read(files["move"], files)


def test_a_program_that_fails_is_begun_anew_and_then_fails_its_state_by_the_name_of_its_end(begin, step):
    chart = begin()
    step(1).end({"answer": "again"})
    chart.step()
    step(2).end(ActivityFailed("guard", "something gave way"))
    chart.step()
    chart.step()
    assert step(3).values["text"] == "left box_1 8 0", "begun anew, it remembers nothing"
    step(3).end(ActivityFailed("guard", "and again"))
    chart.step()
    chart.step()
    assert chart.ended.id == "bad"
    assert chart.words("{why}") == "slipped after 0: and again"


def test_what_nobody_wants_tried_again_in_a_program_is_not_by_its_caller(begin, step):
    chart = begin()
    step(1).end(ActivityFailed("taken_over", "somebody has the arm"))
    chart.step()
    chart.step()
    assert chart.ended.id == "bad"
    assert chart.words("{why}") == "odd: slipped after 0: somebody has the arm"


def test_a_parameter_that_the_program_can_not_have_fails_its_state_and_nothing_begins(begin):
    chart = begin(move=MOVE.replace("2 * grip", "20 * grip"))
    chart.step()
    assert chart.ended.id == "bad"
    assert chart.words("{why}") == "odd: gripping: force: got 80, out of bounds; expected 1 to 50 N"
    assert not begin.steps


BESIDE = """\
title: Beside
resources: {arm: {kind: arm}, box: {kind: instance}}
states:
  both:
    parallel: true
    states:
      one:
        do: program
        with: {program: grip, bind: {hand: arm, what: box}}
        transitions: [{event: done.invoke.one, target: good}, {event: error.execution, target: bad}]
      other:
        do: program
        with: {program: grip, bind: {hand: arm, what: box}, parameters: {force: 9}}
        transitions: [{event: done.invoke.other, target: good}, {event: error.execution, target: bad}]
  good: {final: true, outcome: succeeded}
  bad: {final: true, outcome: failed}
"""


def test_a_failure_in_a_program_is_none_of_the_one_beside_it(begin, step, wait_until):
    chart = begin("beside", beside=BESIDE)
    wait_until(lambda: len(begin.steps) == 2)
    one = next(each for each in begin.steps if each.state.id == "one/asking")
    one.end(ActivityFailed("guard", "gave way"))
    chart.step()
    assert {"one/slipped", "other/asking"} <= set(chart.active())
    chart.step()
    assert chart.ended.id == "bad"


CYCLE = MOVE.replace("program: grip", "program: move")


@pytest.mark.parametrize(
    ("texts", "told"),
    [
        ({"move": CYCLE}, r"move\.yaml:8: states\.gripping\.with\.program: runs itself: move → move; expected"),
        (
            {"move": MOVE.replace("program: grip", "program: over"), "over": CYCLE},
            r"states\.gripping\.with\.program: runs itself: move → over → move; expected",
        ),
        ({"move": MOVE.replace("program: grip", "program: grab")}, r"got 'grab', no program .* expected one of grip, move"),
        ({"move": MOVE.replace(", what: box", "")}, r"bind\.what: missing; grip needs it; expected one of: box"),
        ({"move": MOVE.replace("hand: arm", "hand: box")}, r"bind\.hand: got 'box', no resource .* arm; expected one of: arm"),
        ({"move": MOVE.replace("hand: arm", "hand: arm, foot: arm")}, r"bind\.foot: grip has no resource 'foot'"),
        ({"move": MOVE.replace("force: 2 * grip", "speed: 1")}, r"parameters\.speed: grip has no parameter 'speed'"),
        ({"move": MOVE.replace("2 * grip", "99")}, r"parameters\.force: got 99, out of bounds; expected 1 to 50 N"),
        ({"move": MOVE.replace("2 * grip", "grip").replace("unit: N", "unit: kg")}, r"whose unit is 'kg'; expected 'N'"),
        ({"move": MOVE.replace("2 * grip", "gripp")}, r"unknown name 'gripp'"),
        ({"move": MOVE.replace("_event.data.found", "_event.data.lost")}, r"no 'lost' here; expected one of found, outcome, tries"),
        ({"grip": GRIP.replace("found: {unit: m}", "lost: {}")}, r"outputs\.lost: nothing is called 'lost' here"),
        ({"grip": GRIP.replace("target: held", "target: hold")}, r"move\.yaml:8: .*grip\.yaml:\d+: .*no state 'hold'"),
    ],
)  # fmt: skip
def test_what_a_call_gets_wrong_is_told_by_file_line_and_field(write, texts, told):
    files = write(**{"grip": GRIP, "move": MOVE, **texts})
    with pytest.raises(ConfigError, match=told):
        program.read(files["move"], files)


def test_the_hash_of_a_program_is_another_one_when_one_that_it_runs_has_changed(write):
    files = write(grip=GRIP, move=MOVE)
    before = program.read(files["move"], files).hash
    files = write(grip=GRIP.replace("default: 5", "default: 6"))
    assert program.read(files["move"], files).hash != before


TWICE = """\
title: Turn twice
resources: {arm: {kind: arm}, valve: {kind: instance, template: wheel}}
parameters: {angle: {default: 10, unit: deg, min: 5, max: 90}}
states:
  first:
    do: program
    with: {program: turn_valve, bind: {arm: arm, valve: valve}, parameters: {goal_deg: angle}}
    transitions: [{event: done.invoke.first, target: second}, {event: error.execution, target: failed}]
  second:
    do: program
    with: {program: turn_valve, bind: {arm: arm, valve: valve}, parameters: {goal_deg: 2 * angle}}
    transitions: [{event: done.invoke.second, target: done}, {event: error.execution, target: failed}]
  done: {final: true, outcome: succeeded}
  failed: {final: true, outcome: failed}
"""


@pytest.fixture
def twice(stack, tmp_path, monkeypatch):
    """A run that has come to a breakpoint in the midst of a program that its second state runs."""
    (tmp_path / "rtc_programs").mkdir()
    (tmp_path / "rtc_programs" / "twice.yaml").write_text(TWICE)
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    stack.place()
    deployed = stack.call(m.Deploy(program="twice", bindings={"arm": "right", "valve": "wheel_1"}))
    stack.call(m.SetBreakpoints(states=["second", "second/confirming"]))
    stack.call(m.Run(deployment=deployed.id))
    stack.call(m.AnswerPrompt(id=stack.prompt().id, answer="approve"))
    return stack


def halts(stack, state, why):
    run = stack.wait(lambda e: isinstance(e, m.RunState) and e.status == "paused" and e.waiting == [state])
    assert run.detail == why
    return run


def test_breakpoints_steps_and_skips_reach_into_a_program_and_the_history_has_it(twice):
    halts(twice, "second/planning", "breakpoint at second")
    twice.call(m.StepRun())
    run = halts(twice, "second/confirming", "one step on, before second/confirming")
    assert run.active == ["second", "second/confirming"]
    assert run.data["second/goal_deg"] == 20
    twice.call(m.TakeTransition(state="second/confirming", way=0))
    twice.call(m.ResumeRun())
    assert twice.ended().status == "succeeded"
    visits = {visit.state: visit for visit in twice.call(m.GetRunHistory()).visits}
    assert {"first", "first/turning", "first/stroking", "second/done"} <= set(visits)
    assert visits["second/confirming"].event == "operator"
    assert visits["first"].left_ns >= visits["first/stroking"].left_ns


def test_an_engine_that_was_killed_in_the_midst_of_a_program_has_it_paused_there(twice, start, wait_until, monkeypatch):
    halts(twice, "second/planning", "breakpoint at second")
    twice.call(m.ResumeRun())
    before = halts(twice, "second/confirming", "breakpoint at second/confirming")
    monkeypatch.setattr(twice.engine._journal, "write", lambda *run: None)
    twice.close()
    monkeypatch.delenv("HANDRAIL_WORKSPACE")  # what the library says by now is not what runs
    again = start()
    wait_until(lambda: again.call(m.GetEngine()).run.waiting == ["second/confirming"])
    run = again.call(m.GetEngine()).run
    assert (run.active, run.data, run.hash) == (before.active, before.data, before.hash)
    again.call(m.SetBreakpoints(states=["second/confirming"]))
    began = again.call(m.RunFrom(state="second/planning"))  # plans are gone with the engine that made them
    halted = again.wait(lambda e: isinstance(e, m.RunState) and e.run == began.run and e.status == "paused")
    assert halted.active == ["second", "second/confirming"]
    assert halted.data["second/goal_deg"] == 20


def test_a_picture_has_a_box_for_a_program_that_is_run_or_all_that_is_in_it(write, tmp_path):
    files = write(grip=GRIP, move=MOVE)
    found = program.read(files["move"], files)
    closed, open_ = tmp_path / "closed.dot", tmp_path / "open.dot"
    draw(found, closed)
    draw(found, open_, expand=True)
    assert "program grip" in closed.read_text()
    assert "asking" not in closed.read_text()
    assert '"gripping/asking" -> "gripping/held"' in open_.read_text()


def test_programs_with_clusters_in_clusters_are_laid_out(write, tmp_path):
    files = {**program.files(), **write(twice=TWICE)}
    draw(program.read(files["twice"], files), tmp_path / "open.svg", expand=True)
    assert "planning_next" in (tmp_path / "open.svg").read_text()


def test_editors_complete_what_a_call_is_given_and_what_a_program_gives_back(write):
    files = write(grip=GRIP, move=MOVE)
    known = {name: {each: a.required for each, a in one.arguments.items()} for name, one in SIGNATURES.items()}
    schema = json_schema(known)
    for file in files.values():
        jsonschema.validate(program.read(file, files).document.data, schema)
    wrong = {"title": "T", "states": {"a": {"do": "program", "with": {"bind": {}}}}}
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(wrong, schema)


@pytest.mark.parametrize(
    ("declared", "value", "got"),
    [
        ("number", "1e308 * 10", "inf; expected a finite number"),
        ("number", "'near'", "'near'; expected a finite number"),
        ("integer", "n + 0.5", "0.5; expected a whole number"),
        ("bool", "n", "0; expected true or false"),
        ("text", "n", "0; expected a text"),
    ],
)
def test_an_output_that_is_not_what_its_file_says_fails_the_state(begin, step, declared, value, got):
    chart = begin(
        grip=GRIP.replace("found: {unit: m}", f'found: {{value: "{value}", type: {declared}}}'),
        move=MOVE.replace("    retry: 1\n", ""),
    )
    step(1).end({"answer": "yes"})
    while chart.ended is False:
        assert chart.step(30.0)
    assert (chart.ended.id, chart.variables()["why"]) == ("bad", f"odd: gripping/held: output found: got {got}")
