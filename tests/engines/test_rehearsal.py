"""A task is checked as a whole before any of it moves: the first motion that is infeasible is named."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from typer.testing import CliRunner

from engines.programs import cli, rehearsal
from handrail import messages as m
from tests.engines.test_motions import PROGRAM

LOOPS = """\
title: Go round
states:
  one: {transitions: [{event: never, target: two}, {event: error.execution, target: two}]}
  two: {final: true, outcome: failed}
"""
WAITS = """\
title: Wait, then go on
states:
  one: {transitions: [{after: 3600, target: two}]}
  two: {final: true, outcome: succeeded, detail: waited}
"""
ASKS = """\
title: Ask on and on
states:
  one:
    do: prompt
    with: {text: "again?", options: ["yes", "no"]}
    transitions: [{event: done.invoke.one, cond: _event.data.answer == 'yes', target: one}, {event: "*", target: two}]
  two: {final: true, outcome: succeeded}
"""


@pytest.fixture
def deploy(stack, tmp_path, monkeypatch):
    """program text → its deployment's id."""
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    (tmp_path / "rtc_programs").mkdir()

    def deploy(text: str, **bindings: str) -> str:
        (tmp_path / "rtc_programs" / "task.yaml").write_text(text)
        return stack.call(m.Deploy(program="task", bindings=bindings)).id

    return deploy


def turning(stack) -> str:
    stack.place()
    return stack.call(m.Deploy(program="turn_valve", bindings={"arm": "right", "valve": "wheel_1"})).id


def test_every_motion_of_a_task_is_planned_from_where_the_one_before_ends_and_nothing_moves(stack, daemon, planner):
    found = stack.call(m.CheckTask(deployment=turning(stack)))
    assert (found.feasible, found.first_infeasible, found.outcome) == (True, "", "succeeded")
    assert found.detail.startswith("turned ") and "strokes" in found.detail
    assert [step.state for step in found.steps] == ["planning"] + ["planning_next"] * (len(found.steps) - 1)
    assert all(step.clearance == 0.03 and step.duration > 0 for step in found.steps)
    angles = [asked["instance"].joint_state.get("hinge", 0.0) for asked in planner.asked]
    assert len(angles) > 2 and all(after > before for before, after in pairwise(angles))
    assert all(np.allclose(asked["position"][1], -0.08) for asked in planner.asked[1:]), "where a stroke ends"
    assert not daemon.started() and daemon.command.tolist() == [0.0, -0.3, 0.0]
    assert stack.call(m.GetInstances()).instances[0].joint_state == {"hinge": 0.0}
    snapshot = stack.call(m.GetEngine())
    assert not snapshot.plans and not snapshot.prompts and snapshot.run is None


def test_the_first_motion_that_is_infeasible_is_named_with_what_it_misses(stack, daemon, planner):
    planner.infeasible_from = 2
    found = stack.call(m.CheckTask(deployment=turning(stack)))
    assert (found.feasible, found.first_infeasible) == (False, "planning_next")
    assert "elbow limit missed by 0.12 rad" in found.detail
    assert [bool(step.problem) for step in found.steps] == [False, False, True]
    assert len(planner.asked) == 3, "what comes after it is not asked"
    assert not daemon.started()


def test_where_a_rehearsal_ended_is_where_the_run_looks_first(stack, daemon, planner, deploy):
    stack.place()
    deployed = deploy(PROGRAM, arm="right", valve="wheel_1")
    assert stack.call(m.CheckTask(deployment=deployed)).feasible
    rehearsed = len(planner.asked)
    stack.call(m.Run(deployment=deployed))
    assert stack.ended().status == "succeeded"
    assert [asked["seeds"] for asked in planner.asked[:rehearsed]] == [[], []]
    first, second = (asked["seeds"] for asked in planner.asked[rehearsed:])
    assert np.allclose(first, [[0.3, -0.3, 0.0]]) and np.allclose(second, [[0.3, -0.1, 0.0]])


def test_what_only_doing_it_can_tell_is_taken_to_go_well_and_said_to_be_unverified(stack, daemon):
    deployed = stack.call(m.Deploy(program="press", bindings={"arm": "right"}))
    found = stack.call(m.CheckTask(deployment=deployed.id))
    assert found.feasible and [(step.state, step.what, step.unknown) for step in found.steps] == [
        ("pressing", "press", True)
    ]
    assert not daemon.kinds()


@pytest.mark.parametrize(
    ("text", "told"),
    [(LOOPS, "one: it waits for something that nobody brings"), (ASKS, "it goes on after 7 activities")],
)
def test_a_task_without_an_end_is_told(stack, deploy, monkeypatch, text, told):
    monkeypatch.setattr(rehearsal, "_IDLE_S", 0.1)
    monkeypatch.setattr(rehearsal, "MOST_STEPS", 7)
    found = stack.call(m.CheckTask(deployment=deploy(text)))
    assert not found.feasible and found.detail == told


def test_a_program_is_checked_without_anything_that_runs_and_the_first_infeasible_step_is_named(tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    asked = ["check", "turn_valve", "--robot", "talos_upper", "--bind", "arm=right", "--set", "goal_deg=10"]
    good = CliRunner().invoke(cli.app, [*asked, "--scene", "valve"])
    assert good.exit_code == 0, good.output
    assert "planning" in good.output and "feasible: turned " in good.output and "in 1 strokes" in good.output
    far = tmp_path / "far.yaml"
    far.write_text("objects:\n  valve: {kind: wheel, pose_in_world: {position: [1.5, -0.35, 0.3]}}\n")
    bad = CliRunner().invoke(cli.app, [*asked, "--scene", str(far)])
    assert bad.exit_code == 1
    assert "not feasible: planning: no plan for turn at valve with the right arm" in bad.output
    nowhere = CliRunner().invoke(cli.app, [*asked, "--scene", "vavle"])
    assert nowhere.exit_code == 1 and "expected a file, or one of box, " in nowhere.output


def test_time_that_a_task_waits_for_goes_by_at_once(stack, deploy, monkeypatch):
    monkeypatch.setattr(rehearsal, "_IDLE_S", 0.1)
    found = stack.call(m.CheckTask(deployment=deploy(WAITS)))
    assert found.feasible and found.detail == "waited"
