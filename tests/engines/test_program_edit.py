"""Programs' files edited by a tool: what is not edited stays as it was written."""

from __future__ import annotations

import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engines.programs import library, program
from handrail import config
from handrail.program_edit import ProgramText

PRESS = library.files()["press"].read_text()
LIBRARY = {name: file.read_text() for name, file in library.files().items() if file.suffix == ".yaml"}
TEXT = """\
# what it is
title: Five  # and why

states:
  # about one
  one:  # at one
    transitions:
      # when it goes on
      - {event: x, target: two}   # to two
      - {event: done.state.three, cond: "In('four') and retries_of_two > 0", target: two five}

  # about two
  # in two lines
  two: {transitions: [{event: done.invoke.two, target: one}]}
  # about three
  three:
    title: 'two'
    states:
      # about four
      four:
  # about five
  five: {final: true, outcome: succeeded}
# the end
"""


def plain(text: str) -> dict:
    return config.parse(text, library.files()["press"]).data


@pytest.mark.parametrize("name", ["press", "look_at", "grasp", "release", "home", "stack"])
def test_what_is_done_and_undone_leaves_every_program_of_the_library_as_it_was(name):
    edited = ProgramText(LIBRARY[name])
    for state in edited.states_everywhere()[1:2]:
        edited.rename_state(state, "other_name")
        assert edited.text != LIBRARY[name]
        edited.rename_state("other_name", state)
        edited.add_state("other_name", {"do": "prompt", "with": {"text": "?", "options": ["a"]}}, after="")
        place = edited.connect("other_name", state, event="*")
        edited.set_field("other_name", ["transitions", place, "cond"], "n > 3")
        edited.disconnect("other_name", place)
        edited.remove_state("other_name")
        assert edited.text == LIBRARY[name]


def test_a_renamed_state_is_renamed_wherever_it_is_meant_and_nowhere_else():
    edited = ProgramText(TEXT)
    edited.rename_state("two", "zwei")
    edited.rename_state("four", "vier")
    edited.rename_state("three", "drei")
    text = edited.text
    assert "target: zwei}   # to two" in text
    assert """done.state.drei, cond: "In('vier') and retries_of_zwei > 0", target: zwei five}""" in text
    assert "zwei: {transitions: [{event: done.invoke.zwei, target: one}]}" in text
    assert "title: 'two'" in text
    assert edited.states("drei") == ["vier"]


def test_a_removed_state_takes_along_what_is_in_it_and_the_ways_to_it_but_nobody_elses_comments():
    edited = ProgramText(TEXT)
    edited.remove_state("three")
    edited.remove_state("two")
    assert edited.states_everywhere() == ["one", "five"]
    assert plain(edited.text)["states"]["one"] is None
    assert [line for line in edited.text.splitlines() if line.lstrip().startswith("#")] == [
        "# what it is", "  # about one", "  # about five", "# the end",
    ]  # fmt: skip


def test_an_edited_program_is_one(tmp_path):
    edited = ProgramText(PRESS)
    edited.add_state("resting", {"transitions": [{"after": 2, "target": "asking"}]}, after="asking")
    edited.connect("resting", "failed", event="bored")
    edited.connect("asking", "resting", event="later")
    edited.nest(["asking", "resting"], "talking")
    edited.move_state("pressing", within="talking", after="asking")
    edited.set_field("asking", ["with", "text"], "Press?")
    file = tmp_path / "press.yaml"
    file.write_text(edited.text)
    found = program.read(file)
    assert [state.id for state in found.states()] == ["talking", "asking", "pressing", "resting", "done", "failed"]
    assert edited.text.splitlines()[0] == PRESS.splitlines()[0]


@pytest.mark.parametrize(
    ("edit", "told"),
    [
        (lambda it: it.add_state("one"), "'one' is there already"),
        (lambda it: it.add_state("a b"), "expected a name of letters"),
        (lambda it: it.add_state("six", after="four"), "after: got 'four'; expected one of one, two"),
        (lambda it: it.rename_state("six", "seven"), "got 'six'; expected one of one, two"),
        (lambda it: it.move_state("three", within="four"), "expected a place that is not in 'three' itself"),
        (lambda it: it.nest(["one", "four"], "six"), "expected states that stand beside each other"),
        (lambda it: it.disconnect("one", 2), "got 2; expected one of one's 2 ways"),
        (lambda it: it.connect("one", "six"), "got 'six'"),
        (lambda it: it.remove_field("one", ["do"]), "expected a field that 'one' has"),
        (lambda it: it.set_field("one", ["transitions", 7, "event"], "x"), "path: got 7"),
        (lambda it: it.set_field("three", ["states", "four"], {}), "got 'states'; expected a field of the state"),
        (lambda it: ProgramText("title: [x"), "not YAML"),
        (lambda it: ProgramText("title: x"), "states: missing"),
        (lambda it: ProgramText("states: {a: {final: true}}"), "states on one line"),
    ],
)
def test_what_can_not_be_edited_is_told_and_nothing_has_changed(edit, told):
    edited = ProgramText(TEXT)
    with pytest.raises(ValueError, match=re.escape(told)):
        edit(edited)
    assert edited.text == TEXT


@settings(max_examples=12, deadline=None)
@given(st.data())
def test_whatever_is_moved_nested_renamed_and_connected_keeps_its_comments_and_its_order(data):
    edited, known = ProgramText(TEXT), {name: name for name in ("one", "two", "three", "four", "five")}
    for k in range(data.draw(st.integers(1, 6))):
        names = edited.states_everywhere()
        name, other = data.draw(st.sampled_from(names)), data.draw(st.sampled_from(names))
        before, fields = edited.text, plain(edited.text)
        match data.draw(st.sampled_from(["rename", "move", "nest", "connect", "add", "set"])):
            case "rename":
                edited.rename_state(name, f"r{k}")
                known = {first: f"r{k}" if now == name else now for first, now in known.items()}
                edited_back = ProgramText(edited.text)
                edited_back.rename_state(f"r{k}", name)
                assert edited_back.text == before
            case "move":
                try:
                    edited.move_state(name, within=other)
                except ValueError:
                    assert edited.text == before
                    continue
                assert edited.states(other)[-1] == name
            case "nest":
                edited.nest([name], f"n{k}")
                assert edited.states(f"n{k}") == [name]
            case "connect":
                count = edited.connect(name, other, event=f"e{k}")
                edited_back = ProgramText(edited.text)
                edited_back.disconnect(name, count)
                assert plain(edited_back.text) == fields
            case "add":
                edited.add_state(f"a{k}", {"title": "new"}, within=other)
                assert edited.states(other)[-1] == f"a{k}"
            case "set":
                edited.set_field(name, ["title"], f"t{k}")
        assert ProgramText(edited.text).states_everywhere() == edited.states_everywhere()
    lines = edited.text.splitlines()
    for first, now in known.items():
        (place,) = (k for k, line in enumerate(lines) if line.strip() == f"# about {first}")
        key = next(line for line in lines[place:] if not line.strip().startswith("#"))
        assert key.strip().startswith(f"{now}:"), edited.text
    assert (lines[0], lines[-1]) == ("# what it is", "# the end")
    assert sum("# to two" in line or "# when it goes on" in line for line in lines) == 2
