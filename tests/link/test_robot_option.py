"""What commands say where there is no robot."""

from __future__ import annotations

import pytest
import typer

from handrail import robot_option
from handrail.topics import Unreachable


@pytest.mark.parametrize("problem", ["tcp://127.0.0.1:9: no gate answered", "no gate answered"])
def test_an_address_where_nobody_answers_is_named_once(problem, monkeypatch, capsys):
    def nobody(address, keys):
        raise Unreachable(problem)

    monkeypatch.setattr(robot_option, "connect", nobody)
    with pytest.raises(typer.Exit) as ended, robot_option.the_robot("tcp://127.0.0.1:9", None):
        pass
    assert ended.value.exit_code == 1
    assert capsys.readouterr().err.strip() == "tcp://127.0.0.1:9: no gate answered"
