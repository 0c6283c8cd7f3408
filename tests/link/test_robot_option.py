"""What commands say where there is no robot."""

from __future__ import annotations

import pytest
import typer

from handrail import robot_option
from handrail.topics import Unreachable, refuse


@pytest.mark.parametrize("problem", ["tcp://127.0.0.1:9: no gate answered", "no gate answered"])
def test_an_address_where_nobody_answers_is_named_once(problem, monkeypatch, capsys):
    def nobody(address, keys):
        raise Unreachable(problem)

    monkeypatch.setattr(robot_option, "connect", nobody)
    with pytest.raises(typer.Exit) as ended, robot_option.the_robot("tcp://127.0.0.1:9", None):
        pass
    assert ended.value.exit_code == 1
    assert capsys.readouterr().err.strip() == "tcp://127.0.0.1:9: no gate answered"


def test_what_was_typed_wrongly_is_nothing_of_the_robots(monkeypatch, capsys):
    class Robot:
        def __enter__(self) -> Robot:
            return self

        def __exit__(self, *_: object) -> None: ...

    monkeypatch.setattr(robot_option, "connect", lambda address, keys: Robot())
    with pytest.raises(typer.Exit), robot_option.the_robot("tcp://127.0.0.1:9", None):
        raise ValueError("radius: got 'wide'; expected NAME=NUMBER")
    assert capsys.readouterr().err.strip() == "radius: got 'wide'; expected NAME=NUMBER"


@pytest.mark.parametrize(
    ("message", "expected", "told"),
    [
        ("too far", "within 1 m", "too far; field x, value 9, expected within 1 m"),
        ("x: got 9; expected within 1 m", "within 1 m", "x: got 9; expected within 1 m; field x, value 9"),
        ("too far", "", "too far; field x, value 9"),
    ],
)
def test_a_refusal_says_field_value_and_expectation_once(message, expected, told):
    assert str(refuse(message, "x", 9, expected)) == told
