"""Jogs: joints sent somewhere by hand, turned elsewhere on the way, stopped, and what they are refused for."""

from __future__ import annotations

import math
from contextlib import contextmanager

import pytest
import typer
from typer.testing import CliRunner

from handrail import jog
from handrail import messages as m
from handrail.topics import RefusedError
from tests.engines.conftest import until


def _targets(daemon) -> list[list[float]]:
    return [call.motion.positions for call in daemon.started() if isinstance(call.motion, m.JointTarget)]


def test_joints_go_by_so_much_and_to_a_place_and_the_answer_comes_when_they_are_there(stack, daemon):
    assert stack.call(m.Jog(joints={"depth": 0.1}, by=True)).joints == {"depth": pytest.approx(-0.2)}
    assert daemon.command[1] == pytest.approx(-0.2)
    assert stack.call(m.Jog(joints={"depth": 0.3, "other": -0.5}, speed=0.4)).joints == {"depth": 0.3, "other": -0.5}
    assert daemon.started()[-1].motion.speed == 0.4
    assert not daemon.leases.held(), "the next one may have the joints"


def test_a_newer_jog_takes_over_on_the_way_and_the_older_caller_is_told(stack, daemon, elsewhere):
    daemon.slow = True
    older = elsewhere(m.Jog(joints={"depth": 0.1}, by=True))
    until(lambda: daemon.action is not None and stack.engine._services.daemon.runs(daemon.action.id))
    newer = elsewhere(m.Jog(joints={"depth": 0.1}, by=True))
    older.end()
    assert "superseded" in older.refusal
    daemon.finish()
    newer.end()
    assert newer.answer.joints == {"depth": pytest.approx(-0.1)}, "by counts from where it was going"
    assert len(_targets(daemon)) == 1, "one motion, turned on its way"


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (m.Jog(joints={"elbow": 0.1}), "no such joint"),
        (m.Jog(joints={"depth": 3.5}), "beyond the joint's limits"),
        (m.Jog(joints={"depth": -2.9}, by=True), "-3.2"),
        (m.Jog(joints={"depth": math.nan}), "limits"),
    ],
)
def test_what_no_joint_can_do_is_refused_before_anything_moves(stack, daemon, message, words):
    assert words in str(RefusedError(stack.refusal(message)))
    assert not daemon.started()


def test_what_stopped_it_is_what_the_caller_is_told(stack, daemon):
    daemon.trip = lambda action: "too_close"
    assert "guard" in stack.refusal(m.Jog(joints={"depth": 0.1})).message
    daemon.trip = lambda action: ""
    stack.call(m.Jog(joints={"depth": 0.1}))


def test_a_stop_ends_it_and_leases_of_others_keep_it_away(stack, daemon, elsewhere):
    daemon.slow = True
    waiting = elsewhere(m.Jog(joints={"depth": 0.1}))
    until(lambda: daemon.action is not None and stack.engine._services.daemon.runs(daemon.action.id))
    assert "busy" in stack.refusal(m.Jog(joints={"other": 0.1})).message
    stack.call(m.StopRun())
    waiting.end()
    assert "cancelled" in waiting.refusal
    daemon.leases.take("somebody", "tool")
    assert "somebody" in stack.refusal(m.Jog(joints={"depth": 0.1})).message


def test_whoever_waits_for_a_plan_is_told_when_it_has_ended_and_how(stack, daemon):
    plan = stack.call(m.PlanMotion(goals=[m.JointsGoal(positions={"angle": 0.2})], arm="right"))
    assert "not being executed" in stack.refusal(m.AwaitPlan(id=plan.id)).message
    stack.call(m.ExecutePlan(id=plan.id))
    assert stack.call(m.AwaitPlan(id=plan.id)).stale_causes == ["executed"]
    assert daemon.command[0] == pytest.approx(0.2)
    daemon.trip = lambda action: "too_close"
    plan = stack.call(m.PlanMotion(goals=[m.JointsGoal(positions={"angle": 0.0})], arm="right"))
    stack.call(m.ExecutePlan(id=plan.id))
    assert "guard" in stack.refusal(m.AwaitPlan(id=plan.id)).message


@pytest.mark.parametrize(
    ("words", "by", "value"),
    [
        (["+5deg"], True, math.radians(5.0)),
        (["-0.1"], True, -0.1),
        (["to", "0.3"], False, 0.3),
        (["to", "-20deg"], False, math.radians(-20.0)),
        (["to", "+.5rad"], False, 0.5),
    ],
)
def test_what_people_type_is_understood(words, by, value):
    assert jog.asked(words) == (by, pytest.approx(value))


@pytest.mark.parametrize(
    "words", [["5deg"], ["to"], ["+5", "deg"], ["to", "nan"], ["to", "1e3"], ["by", "0.1"], ["--"]]
)
def test_what_could_be_meant_in_two_ways_is_not(words):
    with pytest.raises(ValueError, match="expected"):
        jog.asked(words)


class _Robot:
    """The client's two calls, on the engine's own socket."""

    def __init__(self, stack):
        self._stack = stack

    def jog(self, joints, *, by, speed):
        return self._stack.call(m.Jog(joints=joints, by=by, speed=speed)).joints

    def home(self, posture, arm):
        raise KeyboardInterrupt

    def stop_run(self):
        self._stack.call(m.StopRun())

    def cancel_planning(self):
        self._stack.call(m.CancelPlanning())


def test_the_command_says_where_the_joint_is_or_why_not(stack, daemon, monkeypatch):
    @contextmanager
    def connect(address, keys):
        yield _Robot(stack)

    monkeypatch.setattr(jog, "connect", connect)
    app = typer.Typer()
    app.command("jog", context_settings=jog.NUMBERS)(jog.jog)
    app.command("home")(jog.home)

    def say(*words):
        return CliRunner().invoke(app, words)

    assert say("jog", "depth", "-0.1").output == "depth: -0.4000\n"
    assert say("jog", "depth", "to", "-0.5").output == "depth: -0.5000\n"
    wrong = say("jog", "depth", "0.1")
    assert wrong.exit_code
    assert "expected +5deg" in str(wrong.exception)
    assert "stopped" in str(say("home").exception)
