"""YAML as our files have it: what is a number, where things stand, and what is refused."""

import math

import pytest

from handrail import yaml_file
from handrail.yaml_file import NotYAML


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("on", "on"), ("no", "no"), ("y", "y"), ("true", True), ("False", False), ("~", None), ("", None), ("Null", None),
        ("12", 12), ("-3", -3), ("010", 10), ("0o17", 15), ("0x1F", 31), ("1_000", "1_000"), ("12:30", "12:30"), ("+", "+"),
        ("1e3", 1000.0), ("-.5", -0.5), ("2.", 2.0), (".inf", math.inf), ("-.INF", -math.inf), ("1e", "1e"), ("1.2.3", "1.2.3"),
        ("2001-12-14", "2001-12-14"), ("'12'", "12"), ('"true"', "true"), ("!!str 12", "12"), ("!!float 3", 3.0), ("=", "="),
        ("1" * 5000, "1" * 5000),
    ],
)  # fmt: skip
def test_words_and_numbers_are_those_of_the_core_schema(text, value):
    found = yaml_file.parse(f"a: {text}\n")["a"]
    assert (found, type(found)) == (value, type(value))


def test_everything_knows_its_line_what_is_laid_under_too():
    found = yaml_file.parse("a: &a\n  b: 1\n  c: 2\nd:\n  <<: *a\n  c: 3\ne:\n  - 1\n  - {f: g}\nh: *a\n1: true\n")
    assert found == {
        "a": {"b": 1, "c": 2},
        "d": {"b": 1, "c": 3},
        "e": [1, {"f": "g"}],
        "h": {"b": 1, "c": 2},
        "1": True,
    }
    assert found.lines == {"a": 1, "d": 4, "e": 7, "h": 10, "1": 11}
    assert found["d"].lines == {"c": 6, "b": 2}
    assert found["e"].lines == [8, 9]


@pytest.mark.parametrize(
    ("text", "line", "problem"),
    [
        ("a: 1\nb: 2\na: 3\n", 3, "duplicate key 'a' (first in line 1)"),
        ("a:\n  - *gone\n", 2, "undefined alias 'gone'"),
        ("a: &a\n  b: *a\n", 2, "undefined alias 'a'"),
        ("a: 1\nb: !python/name:os.system x\n", 2, "the tag"),
        ("a: !!int x\n", 1, "the tag"),
        ("a: !set {b: 1}\n", 1, "the tag"),
        ("? [a]\n: b\n", 1, "a key that is no text"),
        ("a: 1\n---\nb: 2\n", 2, "a second document"),
        ("a: [1, 2\nb: 3\n", 2, "not YAML"),
        ("a: " + "[" * 500 + "]" * 500, 1, "nested too deeply"),
        ("a: \x01b", None, "not YAML"),
        ("a: {<<: [1]}", 1, "<< takes mappings"),
    ],
)
def test_what_is_none_of_ours_is_refused_with_its_line(text, line, problem):
    with pytest.raises(NotYAML) as refused:
        yaml_file.parse(text)
    assert problem in refused.value.problem
    assert refused.value.line == line


def test_no_text_at_all_is_nothing():
    assert yaml_file.parse("# only a remark\n") is None
