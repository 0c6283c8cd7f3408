"""Programs drawn, compared, and described for editors."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET

import jsonschema
import pytest
from typer.testing import CliRunner

from engines.programs import library
from engines.programs.cli import app

runner = CliRunner()
NESTED = """\
title: "Both <at> once"
variables: {n: 0}
states:
  outer:
    parallel: true
    states:
      left: {states: {a: {transitions: [{event: slip, target: b}]}, b: {}}}
      right:
        states:
          c: {transitions: [{event: slip, cond: n < 3, target: d, set: {n: n + 1}}]}
          d: {}
        history: {before: {type: deep, transitions: [{target: d}]}}
    transitions: [{event: enough, target: good}, {event: again, target: before}]
  good: {final: true, outcome: succeeded}
"""


@pytest.fixture
def nested(tmp_path):
    file = tmp_path / "nested.yaml"
    file.write_text(NESTED)
    return file


def texts(svg):
    return {"".join(node.itertext()).strip() for node in ET.parse(svg).iter("{http://www.w3.org/2000/svg}text")}


def test_a_picture_names_every_state_guard_and_end(nested, tmp_path):
    done = runner.invoke(app, ["show", str(nested), str(tmp_path / "p.svg")])
    assert done.exit_code == 0, done.output
    shown = texts(tmp_path / "p.svg")
    assert {"outer", "left", "right", "a", "b", "c", "d", "good", "H*", "[n < 3]", "sets n", "Both <at> once"} <= shown


@pytest.mark.parametrize("name", sorted(library.files()))
def test_every_program_of_the_library_can_be_drawn(name, tmp_path):
    assert runner.invoke(app, ["show", name, str(tmp_path / "p.svg")]).exit_code == 0
    assert {state.id for state in library.load(name).own_states()} <= texts(tmp_path / "p.svg")


def test_what_can_not_be_drawn_says_why(nested, tmp_path, monkeypatch):
    done = runner.invoke(app, ["show", str(nested), str(tmp_path / "p.jpeg")])
    assert done.exit_code == 1
    assert "expected one of svg, png, pdf, dot" in done.stderr
    monkeypatch.setenv("PATH", str(tmp_path))
    assert "apt-get install graphviz" in runner.invoke(app, ["show", str(nested), str(tmp_path / "p.svg")]).stderr
    assert runner.invoke(app, ["show", str(nested), str(tmp_path / "p.dot")]).exit_code == 0, "needs no dot"


def test_differences_are_told_by_field(nested, tmp_path):
    other = tmp_path / "other.yaml"
    other.write_text("# a remark\n" + NESTED.replace("n < 3", "n < 4").replace("b: {}", "b: {title: Here}"))
    assert runner.invoke(app, ["diff", str(nested), str(nested)]).exit_code == 0
    done = runner.invoke(app, ["diff", str(nested), str(other)])
    assert done.exit_code == 1
    assert done.output.splitlines() == [
        "- states.outer.states.left.states.b: {}",
        "~ states.outer.states.right.states.c.transitions[0].cond: n < 3 → n < 4",
        "+ states.outer.states.left.states.b.title: Here",
    ]


@pytest.fixture(scope="module")
def schema():
    return json.loads(runner.invoke(app, ["schema"]).output)


@pytest.mark.parametrize("name", sorted(library.files()))
def test_the_schema_takes_every_program_of_the_library(schema, name):
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.validate(library.load(name).document.data, schema)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"do": "pray"}, "pray"),
        ({"do": "prompt", "with": {}}, "text"),
        ({"do": "prompt", "with": {"text": "?", "color": "red"}}, "color"),
        ({"transition": []}, "transition"),
        ({"states": {"b": {"transitions": [{"targets": "c"}]}}}, "targets"),
    ],
)
def test_the_schema_refuses_what_the_check_refuses(schema, change, told):
    program = {"title": "T", "states": {"a": change}}
    with pytest.raises(jsonschema.ValidationError) as refused:
        jsonschema.validate(program, schema)
    words = " ".join([refused.value.message, *(each.message for each in refused.value.context or [])])
    deeper = [each for error in refused.value.context or [] for each in error.context or []]
    assert told in " ".join([words, *(each.message for each in deeper)])
