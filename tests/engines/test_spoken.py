"""What the engine says of deployments, runs and plans, as lines for people."""

from __future__ import annotations

import pytest

from engines.runs.spoken import Spoken
from handrail import messages as m
from handrail.topics import RefusedError


def state(run: str, status: str, *active: str, detail: str = "") -> m.RunState:
    return m.RunState(
        run=run, program="turn", deployment="d", hash="h", status=status, active=list(active), detail=detail, time_ns=0
    )  # fmt: skip


def test_a_run_says_how_it_stands_and_each_state_that_it_enters_once():
    spoken = Spoken()
    assert spoken.lines(state("1", "running", "planning")) == ["running", "in planning"]
    assert spoken.lines(state("1", "running", "planning")) == []
    assert spoken.lines(state("1", "running", "stroking", "reaching")) == ["in reaching"]
    assert spoken.lines(state("1", "running", "stroking", "turning")) == ["in turning"]
    assert spoken.lines(state("1", "failed", detail="the guard tripped")) == ["failed: the guard tripped"]
    assert spoken.lines(state("2", "running", "planning")) == ["running", "in planning"], "another run"


def test_a_deployment_a_run_and_its_end_are_told_under_the_programs_name(stack):
    stack.place()
    stack.run(goal_deg=10)
    stack.wait(lambda e: isinstance(e, m.Prompt))
    stack.call(m.StopRun())
    ended = stack.wait(lambda e: isinstance(e, m.LogLine) and e.text.startswith("stopped"))
    assert ended.source == "engine/turn_valve" and ended.level == "info"
    lines = [e.text for e in stack.events if isinstance(e, m.LogLine) and e.source == ended.source]
    assert lines[0].startswith("deployed as ") and "valve is wheel_1" in lines[0]
    assert lines[1:3] == ["running", "in planning"] and "in confirming" in lines


def test_what_came_of_a_plan_that_was_asked_for_is_told(stack, planner):
    stack.place()
    stack.call(m.MakePlan(instance="wheel_1", trajectory="turn"))
    found = stack.wait(lambda e: isinstance(e, m.LogLine) and e.source == "engine/planning")
    assert "turn at wheel_1: found in " in found.text
    with pytest.raises(RefusedError):
        stack.call(m.MakePlan(instance="wheel_1", trajectory="turn", after="plan-99"))
    refused = stack.wait(lambda e: isinstance(e, m.LogLine) and "plan-99" in e.text)
    assert refused.source == "engine/planning"
