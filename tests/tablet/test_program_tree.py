"""The program as a tree of states, and what may be done with a run: without a screen."""

from __future__ import annotations

import msgspec
import pytest

from handrail.messages import (
    GetEngine,
    GetOutline,
    GetRobot,
    GetRunHistory,
    OutlineState,
    Run,
    RunFrom,
    RunHistory,
    SetBreakpoints,
    StateVisit,
    StepRun,
    TakeTransition,
)
from tablet_client.models import arrivals
from tablet_client.models.situation import Situation

S = 1_000_000_000
VISITS = [
    StateVisit(state="planning", entered_ns=S, left_ns=2 * S + S // 2),
    StateVisit(state="turning", entered_ns=3 * S),
    StateVisit(state="confirm", entered_ns=3 * S, left_ns=4 * S),
    StateVisit(state="stroking", entered_ns=4 * S, left_ns=5 * S),
    StateVisit(state="stroking", entered_ns=6 * S),
]


@pytest.fixture
def situation(robot) -> Situation:
    """A run that strokes for the second time, with its tree."""
    made = Situation("tcp://somewhere:47800")
    made.take(arrivals.Attached(robot.answer(GetRobot()), robot.status()))
    robot.run = robot.running(active=["turning", "stroking"])
    robot.visits = VISITS
    made.take(arrivals.EngineAttached(robot.answer(GetEngine())))
    for call in made.task.tree.want(0.0):
        made.take(arrivals.CallDone(call, robot.answer(call)))
    return made


def rows(situation: Situation, now: int = 12) -> dict[str, object]:
    return {row.id: row for row in situation.task.tree.rows(now * S)}


def test_the_tree_has_every_state_at_its_depth_and_lights_up_those_that_run(situation):
    found = rows(situation)
    assert list(found) == ["planning", "turning", "confirm", "stroking", "done", "failed"]
    assert [row.depth for row in found.values()] == [0, 0, 1, 1, 0, 0]
    assert [row.mark for row in found.values()] == ["passed", "active", "passed", "active", "", ""]


def test_a_state_says_how_long_it_took_how_often_it_came_and_how_long_it_has_lasted(situation):
    found = rows(situation, now=12)
    assert found["planning"].seconds == pytest.approx(1.5)
    assert (found["stroking"].seconds, found["stroking"].visits) == (6.0, 2)
    assert found["done"].seconds == -1.0


def test_a_state_that_has_not_begun_what_it_does_waits_and_breakpoints_stand_in_the_tree(situation, robot):
    situation.take(
        robot.running(
            active=["turning", "confirm"], status="paused", waiting=["confirm"], breakpoints=["confirm", "stroking"]
        )
    )
    found = rows(situation)
    assert found["confirm"].mark == "waiting" and found["turning"].mark == "active"
    assert [id for id, row in found.items() if row.halts] == ["confirm", "stroking"]


def test_a_run_that_failed_shows_where_and_what_to_do(situation, robot):
    situation.take(robot.running(status="failed", active=["failed"], detail="the tool met resistance"))
    found = rows(situation)
    assert [id for id, row in found.items() if row.mark == "failed"] == ["stroking", "failed"]
    assert situation.task.advice == "failed"
    assert situation.task.call("repeat") == RunFrom(state="stroking")


def test_a_state_that_failed_and_waits_for_help_can_be_tried_again_skipped_or_let_fail(situation, robot):
    situation.take(robot.running(status="paused", active=["turning", "stroking"], failing={"stroking": "not enabled"}))
    task = situation.task
    assert task.advice == "failing"
    assert [task.why_not(each) for each in ("resume", "skip", "let_fail")] == ["", "", ""]
    assert task.call("skip") == TakeTransition(state="stroking")
    assert task.call("let_fail") == TakeTransition(state="stroking", way="failed")
    situation.take(robot.running(active=["turning", "stroking"]))
    assert task.why_not("let_fail") == "nothing_failed"


def test_questions_about_a_run_are_asked_once_and_its_history_at_most_once_a_second(robot):
    tree = Situation("").task.tree
    tree.take_run(robot.running())
    assert [type(call) for call in tree.want(0.0)] == [GetOutline, GetRunHistory]
    assert tree.want(5.0) == []
    tree.take(robot.outline())
    tree.take(RunHistory(run="run-1", visits=VISITS))
    assert tree.want(5.0) == []
    tree.take_run(robot.running(active=["turning", "stroking"]))
    assert tree.want(0.9) == []
    assert tree.want(1.0) == [GetRunHistory()]


def test_an_engine_that_tells_no_tree_is_not_asked_again_and_what_is_active_is_still_shown(robot):
    tree = Situation("").task.tree
    tree.take_run(robot.running())
    tree.want(0.0)
    tree.failed(GetOutline(), refused=True)
    assert GetOutline not in [type(call) for call in tree.want(9.0)]
    assert [(row.id, row.mark) for row in tree.rows(0)] == [("turning", "active"), ("confirm", "active")]


def test_answers_about_another_run_or_another_program_are_left_aside(situation, robot):
    tree = situation.task.tree
    tree.take_run(robot.running(run="run-2", hash="another"))
    assert tree.outline is None and tree.visits == []
    tree.take(robot.outline())
    tree.take(RunHistory(run="run-1", visits=VISITS))
    assert tree.outline is None and tree.visits == []


@pytest.mark.parametrize(
    ("status", "free"),
    [
        ("running", {"pause", "stop_run", "skip", "repeat"}),
        ("paused", {"resume", "step", "stop_run", "skip", "repeat"}),
        ("failed", {"start", "repeat"}),
        ("succeeded", {"start", "repeat"}),
    ],
)
def test_only_what_means_something_can_be_done_with_a_run(situation, robot, status, free):
    ended = status in ("failed", "succeeded")
    situation.take(robot.running(status=status, active=["done"] if ended else ["turning", "stroking"]))
    commands = ("start", "pause", "resume", "step", "skip", "repeat", "stop_run")
    assert {command for command in commands if not situation.why_not_command(command)} == free


def test_each_command_is_the_call_that_it_says(situation):
    task = situation.task
    assert task.call("start") == Run(deployment="deployment-1", on_failure="pause")
    assert task.call("step") == StepRun()
    assert task.call("skip") == TakeTransition(state="stroking")
    assert task.call("from", "planning") == RunFrom(state="planning")
    assert task.call("breakpoint", "confirm") == SetBreakpoints(states=["confirm"])


def test_a_breakpoint_is_set_beside_the_others_and_taken_away_alone(situation, robot):
    situation.take(robot.running(breakpoints=["confirm", "planning"]))
    assert situation.task.call("breakpoint", "stroking") == SetBreakpoints(states=["confirm", "planning", "stroking"])
    assert situation.task.call("breakpoint", "planning") == SetBreakpoints(states=["confirm"])


def test_how_a_run_ended_is_in_sight_with_its_heading_however_far_down_it_was(robot, show):
    states = [OutlineState(id=f"state_{number}", title=f"State {number}", does="wait") for number in range(14)]
    outline = robot.outline()
    robot.outline = lambda: msgspec.structs.replace(outline, states=states)
    shown = show().drawn()
    shown.page("task")
    robot.publish(robot.running(active=["state_13"]))
    tree = shown.item("programTree")
    shown.until(lambda: tree.property("contentY") - tree.property("originY") > 100)
    for status, detail in (("stopped", "stopped by the operator"), ("failed", "the guard tripped; " * 12)):
        robot.publish(robot.running(status="running", active=["state_13"]))
        shown.until(lambda: shown.desk.run.view["status"] == "running")
        robot.publish(robot.running(status=status, active=[], detail=detail))
        shown.until(lambda status=status: shown.desk.run.view["status"] == status)
        shown.until(lambda: tree.property("contentY") == tree.property("originY"))
