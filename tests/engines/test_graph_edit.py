"""A composite node's file, edited by a tool: what was not edited stays, and what comes out is the node that was meant."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from handrail import yaml_file
from handrail.graph_edit import GraphText

TEXT = """\
# What it is for.
title: Adds three things   # and says so

# the parts
nodes:
  # the last one
  last: {node: add, params: {more: 1.0}}  # adds one more
  first: {node: add}

  letters:
    node: count # of letters
inputs:
  a: [first.a]
  word: "letters.text"
  c: last.b
wires: {last.a: first.total, first.b: letters.length}
# what may be set
params:
  more: last.more
outputs:
  sum: last.total
  part: first.total
cases:
- {inputs: [{a: 1.0, word: xyz, c: 10.0}], outputs: {sum: 15.0, part: 4.0}} # counted by hand
"""


def plain(text: str) -> Any:
    return yaml_file.parse(text)


def kept_lines(edited: GraphText, *but: str) -> None:
    """Every line stands as it was, but those with one of these words in them."""
    lines = edited.text.splitlines()
    for line in TEXT.splitlines():
        assert line in lines or any(word in line for word in but), line


def test_a_part_is_added_wired_renamed_and_removed_and_nothing_else_is_touched():
    edited = GraphText(TEXT)
    edited.add_part("more", "add", {"more": 2.5})
    edited.wire("more.a", "last.total")
    edited.give("inputs", "c", "more.b")
    edited.tell("all", "more.total")
    edited.rename_part("more", "extra")
    kept_lines(edited, "wires", "c: last.b")
    found = plain(edited.text)
    assert found["nodes"]["extra"] == {"node": "add", "params": {"more": 2.5}}
    assert found["wires"]["extra.a"] == "last.total" and found["inputs"]["c"] == ["last.b", "extra.b"]
    assert found["outputs"] == {"sum": "last.total", "part": "first.total", "all": "extra.total"}
    edited.remove_part("extra")
    kept_lines(edited)
    assert plain(edited.text) == plain(TEXT)


def test_a_renamed_part_is_renamed_wherever_it_is_meant():
    edited = GraphText(TEXT)
    edited.rename_part("last", "end")
    edited.rename_part("letters", "characters")
    found = plain(edited.text)
    assert found["wires"] == {"end.a": "first.total", "first.b": "characters.length"}
    assert found["inputs"] == {"a": ["first.a"], "word": "characters.text", "c": "end.b"}
    assert found["params"] == {"more": "end.more"} and found["outputs"]["sum"] == "end.total"
    assert '  word: "characters.text"' in edited.text.splitlines()
    kept_lines(edited, "last", "letters")


def test_an_own_port_is_renamed_in_its_cases_too():
    edited = GraphText(TEXT)
    edited.rename_own("inputs", "word", "text")
    edited.rename_own("outputs", "sum", "total")
    edited.rename_own("params", "more", "much")
    found = plain(edited.text)
    assert found["cases"] == [
        {"inputs": [{"a": 1.0, "text": "xyz", "c": 10.0}], "outputs": {"total": 15.0, "part": 4.0}}
    ]
    assert "# counted by hand" in edited.text and found["params"] == {"much": "last.more"}


def test_an_input_has_one_source_and_what_goes_nowhere_is_gone():
    edited = GraphText(TEXT)
    edited.wire("last.b", "letters.length")
    assert "c" not in plain(edited.text)["inputs"] and plain(edited.text)["wires"]["last.b"] == "letters.length"
    edited.give("inputs", "d", "last.b")
    assert "last.b" not in plain(edited.text)["wires"] and plain(edited.text)["inputs"]["d"] == "last.b"
    edited.unwire("last.b")
    edited.unwire("last.a")
    edited.unwire("first.b")
    assert "wires" not in plain(edited.text)
    edited.take("params", "more", "last.more")
    assert "params" not in plain(edited.text) and "# what may be set" not in edited.text
    edited.wire("first.b", "letters.length")
    assert list(plain(edited.text)) == ["title", "nodes", "inputs", "wires", "outputs", "cases"]


def test_fields_are_set_and_taken_away_wherever_they_stand():
    edited = GraphText(TEXT)
    edited.set(["nodes", "last", "params", "more"], 2.0)
    edited.set(["nodes", "first", "params", "more"], -1.0)
    edited.set(["nodes", "letters", "params"], {"x": 1})
    edited.set(["every"], 0.1)
    edited.set(["title"], "Adds")
    found = plain(edited.text)
    assert found["nodes"]["last"]["params"] == {"more": 2.0} and found["nodes"]["first"]["params"] == {"more": -1.0}
    assert (found["every"], found["title"]) == (0.1, "Adds")
    for word in ("# adds one more", "# of letters", "# the last one", "# the parts", "# and says so"):
        assert word in edited.text
    edited.remove(["nodes", "first", "params", "more"])
    assert plain(edited.text)["nodes"]["first"] == {"node": "add"}
    edited.remove(["every"])
    assert "every" not in plain(edited.text)


def test_one_begins_with_nothing():
    edited = GraphText("title: New\nnodes: {}\noutputs: {}\n")
    edited.add_part("smooth", "low_pass")
    edited.give("inputs", "wrench", "smooth.wrench")
    edited.give("params", "cutoff", "smooth.cutoff")
    edited.tell("force", "smooth.force")
    assert edited.text == (
        "title: New\nnodes:\n  smooth: {node: low_pass}\ninputs:\n  wrench: smooth.wrench\n"
        "params:\n  cutoff: smooth.cutoff\noutputs:\n  force: smooth.force\n"
    )
    edited.remove_part("smooth")
    assert plain(edited.text) == {"title": "New", "nodes": {}, "outputs": {}}


def test_a_line_that_would_be_long_gets_a_line_each():
    edited = GraphText(TEXT)
    for number in range(4):
        edited.add_part(f"another_one_{number}", "add")
        edited.wire(f"another_one_{number}.a", "first.total")
    assert "  another_one_3.a: first.total" in edited.text.splitlines()


@pytest.mark.parametrize(
    ("edit", "told"),
    [
        (lambda it: it.add_part("first", "add"), "'first' is there already"),
        (lambda it: it.add_part("a b", "add"), "expected letters, digits and _"),
        (lambda it: it.rename_part("none", "some"), "got 'none'; expected one of last, first, letters"),
        (lambda it: it.wire("last.a", "none.total"), "got 'none.total'; expected PART.port"),
        (lambda it: it.wire("last", "first.total"), "got 'last'; expected PART.port"),
        (lambda it: it.give("inputs", "sum", "last.a"), "'sum' is there already"),
        (lambda it: it.tell("a", "last.total"), "'a' is there already"),
        (lambda it: it.rename_own("inputs", "x", "y"), "inputs: got 'x'; expected one of a, word, c"),
        (lambda it: it.take("inputs", "a", "last.a"), "inputs.a: got 'last.a'; expected one of first.a"),
        (lambda it: it.unwire("letters.length"), "expected an input that gets something"),
        (lambda it: it.remove(["nodes", "first", "params"]), "nodes.first.params: got nothing"),
    ],
)
def test_an_edit_that_makes_no_sense_is_refused_and_changes_nothing(edit, told):
    edited = GraphText(TEXT)
    with pytest.raises(ValueError, match=told.replace("(", r"\(").replace(".", r"\.")):
        edit(edited)
    assert edited.text == TEXT


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("title: x\n", "nodes: missing"),
        ("nodes: [a]\n", "nodes: missing"),
        ("{nodes: {}, outputs: {}}\n", "all of it on one line"),
        ("nodes: {\n", "not YAML"),
    ],
)
def test_what_is_no_such_file_is_refused(text, told):
    with pytest.raises(ValueError, match=told):
        GraphText(text)


_PARTS = st.sampled_from(["first", "last", "letters", "new", "other"])
_PORTS = st.sampled_from(["a", "b", "total", "text"])
_OWN = st.sampled_from(["a", "word", "c", "d", "sum"])
_STEP = st.one_of(
    st.tuples(st.just("add_part"), _PARTS, st.just("add")),
    st.tuples(st.just("remove_part"), _PARTS),
    st.tuples(st.just("rename_part"), _PARTS, _PARTS),
    st.tuples(st.just("wire"), st.builds("{}.{}".format, _PARTS, _PORTS), st.builds("{}.{}".format, _PARTS, _PORTS)),
    st.tuples(st.just("unwire"), st.builds("{}.{}".format, _PARTS, _PORTS)),
    st.tuples(st.just("give"), st.sampled_from(["inputs", "params"]), _OWN, st.builds("{}.{}".format, _PARTS, _PORTS)),
    st.tuples(st.just("tell"), _OWN, st.builds("{}.{}".format, _PARTS, _PORTS)),
    st.tuples(st.just("rename_own"), st.sampled_from(["inputs", "params", "outputs"]), _OWN, _OWN),
)


@settings(max_examples=60, deadline=None)
@given(st.lists(_STEP, max_size=12))
def test_whatever_is_done_it_stays_a_file_in_which_every_place_is_of_a_part(steps):
    edited = GraphText(TEXT)
    for name, *given_ in steps:
        before = edited.text
        try:
            getattr(edited, name)(*given_)
        except ValueError:
            assert edited.text == before
            continue
        found = plain(edited.text)
        assert GraphText(edited.text).text == edited.text
        places = [*(found.get("wires") or {}).items(), *((found.get("outputs") or {}).items())]
        sources = [source for _, source in places]
        fed = list(found.get("wires") or {})
        for field in ("inputs", "params"):
            for to in (found.get(field) or {}).values():
                fed += to if isinstance(to, list) else [to]
        assert {place.partition(".")[0] for place in (*sources, *fed)} <= set(found["nodes"])
        inputs = list(found.get("wires") or {})
        for to in (found.get("inputs") or {}).values():
            inputs += to if isinstance(to, list) else [to]
        assert len(inputs) == len(set(inputs)), "one source each"
        assert "# counted by hand" in edited.text and "# What it is for." in edited.text
