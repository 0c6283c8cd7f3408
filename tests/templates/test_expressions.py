"""Expressions in files compute numbers, and can do nothing else."""

from __future__ import annotations

import math
import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from affordance_templates.expressions import ExpressionError, evaluate, parse


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2/3 * radius", 0.1),
        ("asin((0.012 + 0.010) / 0.1)", math.asin(0.22)),
        ("-8 * deg", -math.radians(8)),
        ("2 ** 3 - +1", 7),
        ("atan2(1, 1) + sqrt(4) + min(3, 2, 1) + max(1, 2)", math.pi / 4 + 5),
        ("1e-3", 0.001),
        (0.25, 0.25),
        (4, 4),
    ],
)
def test_arithmetic_has_its_value(text, value):
    assert evaluate(text, {"radius": 0.15}) == pytest.approx(value)


def test_the_names_that_need_a_value_are_told():
    assert parse("2*pi*i/spokes").names == {"i", "spokes"}


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('x')",
        "().__class__",
        "radius.real",
        "open('x')",
        "[1, 2]",
        "'text'",
        "lambda: 1",
        "1 if radius else 2",
        "radius < 2",
        "True",
        "a := 2",
        "f'{radius}'",
        "sin",
        "sin(1, 2)",
        "min(*[1, 2])",
        "5 % 2",
        "2j",
        "",
        "2 +",
        "(" * 300,
        "1" * 600,
    ],
)
def test_anything_else_is_refused(text):
    with pytest.raises(ExpressionError):
        evaluate(text, {"radius": 0.15})


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("radios * 2", "unknown name 'radios'; expected one of deg, pi, radius"),
        ("1 / (radius - 0.15)", "no value here"),
        ("asin(2)", "no value here"),
        ("10 ** 400", "no value here"),
        ("1e308 * 10", "expected a finite number"),
    ],
)
def test_an_expression_without_a_value_says_why(text, says):
    with pytest.raises(ExpressionError, match=says):
        evaluate(text, {"radius": 0.15})


TOKENS = [
    *("a", "b", "1", "9", "2.5", "1e300", "+", "-", "*", "/", "**", "%", "(", ")", ",", "sqrt(", "sin(", "max("),
    *(
        "__class__",
        "__import__('os')",
        ".",
        "[",
        "]",
        "{",
        "}",
        "lambda:",
        "'",
        "f'{a}'",
        ":=",
        "for",
        "in",
        "if",
        "else",
        "not",
    ),
]
"""what an expression is made of, and what code is made of"""


@given(
    st.text(alphabet="0123456789.+-*/() abrdeg,sincopqt_", max_size=40)
    | st.lists(st.sampled_from(TOKENS), max_size=16).map(" ".join)
)
@settings(max_examples=300, deadline=None)
def test_any_text_gives_a_finite_number_or_a_refusal(text):
    try:
        assert math.isfinite(evaluate(text, {"a": 1.0, "b": 2.0}))
    except ExpressionError:
        pass


@pytest.mark.parametrize(
    "text", ["9**9**9**9", "(10**400)**400", " + ".join(["a"] * 100_000), "(" * 50_000, "2" * 100_000]
)
def test_what_would_take_long_is_refused_or_cut_short(text):
    steps = 0

    def count(frame, event, argument):
        nonlocal steps
        steps += 1
        assert steps < 100_000, "an expression's cost is bounded"
        return count

    before = sys.gettrace()
    sys.settrace(count)
    try:
        evaluate(text, {"a": 1.0})
    except ExpressionError:
        pass
    finally:
        sys.settrace(before)
