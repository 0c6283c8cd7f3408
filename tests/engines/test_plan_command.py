"""`handrail plan`: what people read of a plan, from the robot and from a file."""

from __future__ import annotations

import math
from contextlib import contextmanager
from types import SimpleNamespace

import msgspec
import pytest
from typer.testing import CliRunner

from handrail import messages as m
from handrail import robot_option
from handrail.client import Unreachable
from handrail.plan import cli

runner = CliRunner()


class LocalClient:
    """The client API on the engine's own sockets, without a link."""

    def __init__(self, stack):
        self._stack = stack

    def snapshot(self):
        return self._stack.call(m.GetEngine())

    def plan(self, instance, trajectory, arm, arc=None, seen=False, relax=()):
        call = m.MakePlan(instance=instance, trajectory=trajectory, arm=arm, arc=arc, seen=seen, relax=list(relax))
        return self._stack.call(call)

    def robot(self):
        return SimpleNamespace(joints=["angle", "depth", "other"])

    def plan_motion(self, goals, arm, **more):
        return self._stack.call(m.PlanMotion(goals=goals, arm=arm, **more))

    def edit_plan(self, plan, goals, **more):
        return self._stack.call(m.EditPlan(id=plan, goals=goals, **more))

    def get_plan(self, plan, *, details):
        return self._stack.call(m.GetPlan(id=plan, details=details))


@pytest.fixture
def handrail(stack, monkeypatch):
    """Runs `handrail plan ...` against the engine; rich may not break its lines."""

    @contextmanager
    def connect(address, keys):
        yield LocalClient(stack)

    monkeypatch.setattr(robot_option, "connect", connect)
    monkeypatch.setattr(cli, "_out", cli.Console(width=400))
    monkeypatch.setattr(cli, "_err", cli.Console(width=400, stderr=True))
    return lambda *words: runner.invoke(cli.app, [str(word) for word in words])


def test_plans_are_made_shown_with_the_worst_and_listed_with_the_reason_why_they_are_stale(stack, handrail):
    assert "no plan was made yet" in handrail("list").output
    stack.place()
    made = handrail("make", "wheel_1", "turn")
    assert made.exit_code == 0
    for words in (
        "approach",
        "30 mm",
        "nearest: arm and post, 30 mm at 1.00 s",
        "counts on 1 other joints to stay: other",
    ):
        assert words in made.output
    assert "fresh" in handrail("list").output
    stack.call(m.SetParameters(name="wheel_1", parameters={"radius": 0.16}))
    assert "stale: wheel_1 was changed, radius 0.15 to 0.16" in handrail("show").output
    assert "radius 0.15 to 0.16" in handrail("list").output


def test_a_plan_goes_to_a_file_and_comes_back_from_it_as_it_was(stack, handrail, planner, tmp_path):
    stack.place()
    handrail("make", "wheel_1", "turn", "--relax", "tilt", "--relax", "reach")
    assert planner.asked[-1]["relax"] == ["tilt", "reach"]
    file, picture = tmp_path / "plan.json", tmp_path / "plan.png"
    assert handrail("export", "last", "--json", file).exit_code == 0
    plan = msgspec.json.decode(file.read_bytes(), type=m.PlanPreview)
    assert plan == stack.call(m.GetPlan(id=plan.id, details=True))
    assert msgspec.json.decode(handrail("export", plan.id[-3:]).stdout, type=m.PlanPreview) == plan
    stack.engine.stop()
    assert handrail("show", file).output.startswith("turn wheel_1, right arm")
    drawn = handrail("plot", file, "--png", picture)
    assert drawn.exit_code == 0 and str(picture) in drawn.output
    assert picture.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_motions_are_planned_to_a_place_to_a_posture_and_edited(handrail, planner):
    assert handrail("reach", "right", 0.4, -0.35, -0.1).exit_code == 0
    reach = planner.asked[-1]["call"]
    assert reach.goals == [m.FrameGoal(pose=m.Pose(position=(0.4, -0.35, -0.1)), angle=math.pi)]
    handrail("reach", "left", 0, 0, 0, "--orientation", 0, 0, 0, 1, "--instance", "wheel_1", "--feature", "hinge")
    there = planner.asked[-1]["call"]
    assert there.goals == [m.FrameGoal(pose=m.Pose(), instance="wheel_1", feature="hinge")] and there.arm == "left"
    assert not reach.relax
    handrail("reach", "right", 0.4, -0.35, -0.1, "--relax")
    assert planner.asked[-1]["call"].relax == ["goals[0]"]
    edited = handrail("edit", 0.3, -0.2, 0.1, "--plan", "plan-1", "--time", 0.5)
    assert "passes key frames 0 at 0.50 s" in edited.output
    assert planner.asked[-1]["call"].through[0].goals[0].pose.position == (0.3, -0.2, 0.1)
    handrail("posture", "ready")
    assert planner.asked[-1]["call"].joints == ["angle", "depth", "other"]
    handrail("posture", "ready", "--arm", "right", "--after", "plan-3")
    last = planner.asked[-1]["call"]
    assert (last.goals, last.arm, last.joints, last.after) == ([m.PostureGoal(name="ready")], "right", [], "plan-3")


def test_what_can_not_be_shown_says_why(stack, handrail, tmp_path, monkeypatch):
    stack.place()
    unknown = handrail("show", "plan-99")
    assert unknown.exit_code == 1 and "no such plan" in unknown.output and "none made yet" in unknown.output
    unreadable = handrail("plot", tmp_path / "none.json")
    assert unreadable.exit_code == 1 and "none.json" in unreadable.output
    handrail("make", "wheel_1", "turn")
    assert "expected one of turn" in handrail("make", "wheel_1", "open").output
    nowhere = handrail("plot", "last", "--png", tmp_path / "no folder" / "plan.png")
    assert nowhere.exit_code == 2 and "folder that exists" in nowhere.output

    def away(address, keys):
        raise Unreachable("nobody is there")

    monkeypatch.setattr(robot_option, "connect", away)
    gone = handrail("list")
    assert gone.exit_code == 1 and "nobody is there" in gone.output
