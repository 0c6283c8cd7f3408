"""`handrail instance`: what an operator types, reads, and reads to nonsense."""

from __future__ import annotations

from contextlib import contextmanager

import msgspec
import pytest
from typer.testing import CliRunner

from affordance_templates import instance_cli
from handrail import messages as m
from handrail import robot_option
from handrail.instance_calls import InstanceCalls


class Local(InstanceCalls):
    """The client's calls on the engine's own socket; who calls, the link would write."""

    def __init__(self, stack, by):
        self._stack, self._by = stack, by

    def call(self, message, timeout_s=None):
        signed = msgspec.structs.replace(message, by=self._by) if hasattr(message, "by") else message
        return self._stack.call(signed)


@pytest.fixture
def handrail(stack, monkeypatch):
    """words → (exit code, what was said), by an operator. The fake robot has no model."""
    monkeypatch.setattr(stack.engine._services.affordances, "link_in_world", {}.get)

    def run(*words: str, by: str = "anna") -> tuple[int, str]:
        @contextmanager
        def connect(*_):
            yield Local(stack, by)

        monkeypatch.setattr(robot_option, "connect", connect)
        monkeypatch.setattr(instance_cli._out, "width", 250)
        done = CliRunner().invoke(instance_cli.app, list(words))
        return done.exit_code, done.output

    return run


def test_an_instance_is_placed_moved_changed_attached_listed_undone_and_removed(handrail, stack):
    assert handrail("list") == (0, "none is placed yet\n")
    code, said = handrail("place", "w", "wheel", "0.5", "-0.3", "0.3", "--rpy", "0", "0", "90", "--set", "radius=0.2")
    assert code == 0 and "w, version 1: at 0.500 -0.300 0.300 m, 0.0 0.0 90.0°" in said and "radius 0.2" in said
    assert (
        "version 2: at 0.600 -0.300 0.300 m, 0.0 0.0 90.0°"
        in handrail("move", "w", "--position", "0.6", "-0.3", "0.3")[1]
    )
    assert "hinge 0.5" in handrail("set", "w", "radius=0.22", "--joint", "hinge=0.5", by="ben")[1]
    handrail("place", "b", "box", "1", "0", "0", "--source", "an estimate")
    assert "on w" in handrail("attach", "b", "--instance", "w")[1]
    code, said = handrail("list")
    assert code == 0 and "edited by ben" in said and "placed by anna" in said and "(an estimate)" in said
    assert "w, version 4" in handrail("undo", by="ben")[1] and "radius 0.22" in handrail("redo", by="ben")[1]
    code, said = handrail("remove", "w")
    assert code == 1 and "b would have nothing to go along with" in said
    assert handrail("attach", "b")[0] == 0 and handrail("remove", "w") == (0, "")
    code, said = handrail("undo", by="ben")
    assert code == 1 and "parameters.radius stays: w is gone" in said


def test_what_somebody_else_holds_is_told(handrail, stack):
    stack.place()
    stack.call(m.HoldInstance(name="wheel_1", by="ben"))
    assert "held by ben" in handrail("list")[1]
    code, said = handrail("move", "wheel_1", "--position", "0", "0", "0")
    assert code == 1 and "held by ben" in said


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["place", "w", "whale", "0", "0", "0"], "no such template"),
        (["move", "nothing", "--position", "0", "0", "0"], "one of: wheel_1"),
        (["move", "wheel_1"], "expected at least one"),
        (["set", "wheel_1"], "nothing to change"),
        (["set", "wheel_1", "radius"], "expected NAME=NUMBER"),
        (["set", "wheel_1", "radius=9"], "expected"),
        (["attach", "wheel_1", "--instance", "wheel_1"], "along with itself"),
        (["attach", "wheel_1", "--link", "nose"], "no link nose"),
        (["undo"], "nothing to undo"),
        (["redo"], "nothing to redo"),
        (["hold", "nothing"], "no such instance"),
    ],
)
def test_nonsense_is_told_what_was_expected(handrail, stack, words, told):
    stack.place()
    code, said = handrail(*words)
    assert code == 1 and told in said
