"""A wrong program gets an error with file, line, field and expectation, before anything of it runs."""

from __future__ import annotations

from pathlib import Path

import pytest

from engines.programs import library, program
from handrail.config import ConfigError

GOOD = """\
title: Try it
resources:
  arm: {kind: arm}
  valve: {kind: instance, template: wheel}
parameters:
  goal_deg: {default: 90, unit: deg, min: 1, max: 360}
variables:
  plan: ""
  turned_deg: 0.0
states:
  planning:
    do: plan
    with: {instance: valve, trajectory: turn, arm: arm}
    transitions:
      - {event: done.invoke.planning, target: moving, set: {plan: _event.data.plan}}
      - {event: error.execution, target: failed}
  moving:
    do: execute
    with: {plan: plan, segments: [approach]}
    transitions:
      - {event: done.invoke.moving, cond: turned_deg < goal_deg, target: planning}
      - {event: done.invoke.moving, target: good}
      - {event: error.execution, target: failed}
  good: {final: true, outcome: succeeded, detail: "turned {turned_deg:.0f}"}
  failed: {final: true, outcome: failed}
"""


@pytest.fixture
def write(tmp_path):
    def write(text: str) -> Path:
        file = tmp_path / "try_it.yaml"
        file.write_text(text)
        return file

    return write


def test_a_good_program_is_read(write):
    found = program.read(write(GOOD))
    assert [state.id for state in found.states()] == ["planning", "moving", "good", "failed"]
    assert found.name == "try_it"


def test_the_hash_differs_when_the_content_differs_and_only_then(write):
    first = program.read(write(GOOD)).hash
    assert program.read(write(GOOD)).hash == first
    assert program.read(write(GOOD.replace("default: 90", "default: 91"))).hash != first


DONE = "{event: done.invoke.planning, target: moving,"
COND = "turned_deg < goal_deg"


@pytest.mark.parametrize(
    ("old", "new", "line", "field", "expectation"),
    [
        (
            DONE,
            "{event: done.invoke.planning, after: 3, target: moving,",
            15,
            "transitions[0].after",
            "expected one of the two",
        ),
        (DONE, "{after: 0, target: moving,", 15, "transitions[0].after", "above 0"),
        (DONE, "{after: plan, target: moving,", 15, "transitions[0].after", "a time in s"),
        ("  good: {final: true,", "  good: {retry: 1, final: true,", 24, "states.good.retry", "something to `do`"),
        ('  plan: ""', '  retries_of_plan: ""', 8, "variables.retries_of_plan", "expected another name"),
        ("do: plan\n", "do: plam\n", 12, "states.planning.do", "expected one of plan, execute, prompt, retreat"),
        ("target: moving", "target: movin", 15, "transitions[0].target", "expected one of planning, moving"),
        (
            "  failed: {final",
            "  lost: {final: true, outcome: failed}\n  failed: {final",
            25,
            "states.lost",
            "no way leads to 'lost'",
        ),
        ("arm: arm}", "arm: hand}", 13, "with.arm", "expected one of: arm"),
        ("  arm: {kind: arm}\n", "", 12, "with.arm", "a declaration of it under `resources`"),
        ("instance: valve", "instance: arm", 13, "with.instance", "expected one of: valve"),
        ("segments: [approach]", "segments: 3", 19, "with.segments", "expected a list of names"),
        ("trajectory: turn, ", "", 13, "with.trajectory", "missing; plan needs it"),
        ("arm: arm}\n    tr", "arm: arm, speed: 2}\n    tr", 13, "with.speed", "expected one of instance"),
        ("arm: arm}\n    tr", "arm: arm, arc: [1]}\n    tr", 13, "with.arc", "expected a number in rad"),
        ("arm: arm}\n    tr", "arm: arm, arc: plan}\n    tr", 13, "with.arc", "expected a number in rad"),
        (COND, "turned_deg <", 21, "transitions[0].cond", "is not an expression that is allowed"),
        (COND, "open('x').read()", 21, "transitions[0].cond", "is not an expression that is allowed"),
        (COND, "().__class__ == 1", 21, "transitions[0].cond", "is not an expression that is allowed"),
        (COND, "turned < goal_deg", 21, "transitions[0].cond", "unknown name 'turned'"),
        ("_event.data.plan", "_event.data.plans", 15, "transitions[0].set.plan", "has no 'plans'"),
        ("set: {plan:", "set: {plam:", 15, "transitions[0].set.plam", "expected one of plan, turned_deg"),
        (
            "done.invoke.planning",
            "done.invoke.plan",
            15,
            "transitions[0].event",
            "the name of a state that does something",
        ),
        (
            "      - {event: error.execution, target: failed}\n  moving",
            "  moving",
            14,
            "transitions",
            "nothing follows when it fails",
        ),
        ("default: 90", "default: 900", 6, "parameters.goal_deg.default", "expected 1 to 360 deg"),
        ("unit: deg", "units: deg", 6, "parameters.goal_deg.units", "unknown field"),
        (
            "kind: arm}",
            "kind: leg}",
            3,
            "resources.arm.kind",
            "Invalid enum value 'leg'; got 'leg'; expected one of arm, instance",
        ),
        ("outcome: succeeded, ", "", 24, "states.good.outcome", "expected succeeded or failed"),
        ("outcome: succeeded", "outcome: won", 24, "states.good.outcome", "won"),
        ("{turned_deg:.0f}", "{turned:.0f}", 24, "states.good.detail", "unknown name 'turned'"),
        ("{turned_deg:.0f}", "{turned_deg", 24, "states.good.detail", "expected {expression}"),
        ('plan: ""', 'pi: ""', 8, "variables.pi", "expected another name"),
        ('plan: ""', 'arm: ""', 8, "variables.arm", "in resources too"),
        ("  moving:\n", "  send:\n", 17, "states.send", "can't be a state's name"),
        ("title: Try it\n", "", None, "title", "missing required field"),
    ],
)
def test_what_is_wrong_is_named_with_line_field_and_expectation(write, old, new, line, field, expectation):
    assert old in GOOD
    with pytest.raises(ConfigError) as caught:
        program.read(write(GOOD.replace(old, new, 1)))
    error = caught.value
    assert error.field.endswith(field), str(error)
    assert expectation in error.problem
    assert error.line == line
    assert error.file.endswith("try_it.yaml")


def test_a_program_that_is_not_yaml_says_where(write):
    with pytest.raises(ConfigError) as caught:
        program.read(write(GOOD.replace("  planning:\n", "  planning\n")))
    assert caught.value.line is not None and "not YAML" in caught.value.problem


def test_states_must_be_unique_in_the_whole_program(write):
    nested = GOOD.replace("  good: {", "  good_place:\n    states:\n      moving: {}\n  good: {")
    with pytest.raises(ConfigError, match="unique"):
        program.read(write(nested))


def test_an_eventless_circle_is_refused(write):
    looping = GOOD.replace(
        "  good: {final",
        "  round:\n    transitions:\n      - {target: round}\n      - {event: x, target: good}\n  good: {final",
    )
    with pytest.raises(ConfigError, match="always taken and leads back"):
        program.read(
            write(looping.replace("target: good}\n      - {event: error", "target: round}\n      - {event: error"))
        )


def test_the_library_finds_a_workspace_before_the_built_in_programs(write, tmp_path, monkeypatch):
    folder = tmp_path / "rtc_programs"
    folder.mkdir()
    (folder / "turn_valve.yaml").write_text(GOOD)
    (folder / "broken.yaml").write_text(GOOD.replace("do: plan\n", "do: nothing\n"))
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    assert library.load("turn_valve").title == "Try it"
    entries = {each.name: each for each in library.listing().entries}
    assert "broken.yaml:12: states.planning.do" in entries["broken"].problem
    with pytest.raises(ConfigError, match=r"expected one of broken, follow, .*, turn_valve"):
        library.load("dig_hole")


def test_every_program_of_the_library_is_sound():
    for entry in library.listing().entries:
        assert not entry.problem
