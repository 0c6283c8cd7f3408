"""A template's stroke that runs alone, waypoint by waypoint over several runs, on one plan as long as that is fresh."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from engines.activities.base import ActivityFailed
from engines.activities.execute import left_to
from handrail import messages as m
from tests.engines.conftest import until


def ended(stack, begun: m.RunState) -> m.RunState:
    over = ("succeeded", "failed", "stopped")
    return stack.wait(lambda e: isinstance(e, m.RunState) and e.run == begun.run and e.status in over)


def step(stack, to: str, **call) -> m.RunState:
    """A run of the stroke, or of a part of it, that comes to a waypoint."""
    run = ended(stack, stack.call(m.RunTemplate(instance="wheel_1", trajectory="turn", arm="right", **call)))
    assert (run.status, run.data["at"]) == ("succeeded", to), run.detail
    return run


def test_each_run_goes_on_on_the_plan_of_the_first_and_the_last_one_leaves_the_wheel_turned(stack, planner, daemon):
    stack.place()
    plan = step(stack, "engage", steps=3).data["plan"]
    assert daemon.command[1] > 0.0 and daemon.wheel == 0.0
    assert step(stack, "turn", steps=1).data["plan"] == plan
    turned = daemon.wheel
    assert turned > 0.1
    assert step(stack, "withdraw", steps=9).data["plan"] == plan
    assert len(planner.asked) == 1
    assert daemon.command[1] < 0.0 and daemon.wheel == turned
    believed = stack.call(m.GetInstances()).instances[0].joint_state["hinge"]
    assert math.isclose(believed, turned, abs_tol=0.01)
    assert step(stack, "engage", steps=3).data["plan"] != plan, "the next stroke has a plan of its own"
    assert len(planner.asked) == 2 and planner.asked[1]["position"][1] < 0.0


def test_what_was_moved_between_two_steps_has_the_stroke_planned_anew(stack, planner):
    stack.place()
    step(stack, "engage", steps=3)
    stack.call(m.MoveInstance(name="wheel_1", pose_in_world=m.Pose(position=(0.5, 0.01, 0.0))))
    refused = stack.refusal(m.RunTemplate(instance="wheel_1", trajectory="turn", arm="right", first="turn"))
    assert (refused.field, refused.expected) == ("first", "approach")
    step(stack, "approach", steps=1)
    assert len(planner.asked) == 2


def test_a_stroke_that_was_stopped_in_a_step_is_not_gone_on_with_from_there(stack, planner, daemon):
    stack.place()
    step(stack, "engage", steps=3)
    daemon.slow = True
    begun = stack.call(m.RunTemplate(instance="wheel_1", trajectory="turn", arm="right", steps=1))
    until(lambda: stack.engine._run._motion._running)
    stack.call(m.StopRun())
    assert ended(stack, begun).status == "stopped"
    daemon.slow = False
    step(stack, "approach", steps=1)
    assert len(planner.asked) == 2


@pytest.mark.parametrize(
    ("reached", "to", "left"),
    [
        (-1, "standoff", []),
        (-1, "engage", ["return", "engage"]),
        (1, "turn", ["turn"]),
        (1, "withdraw", ["turn", "release", "withdraw"]),
        (2, "turn", []),
    ],
)
def test_a_later_stroke_comes_back_beside_the_wheel_before_it_reaches_in(stack, planner, daemon, reached, to, left):
    stack.place()
    daemon.command[1] = -0.08  # where a stroke ends
    wheel = stack.engine._services.affordances.get("wheel_1")
    plan = planner.plan(wheel, "turn", "right", daemon.command)
    record = SimpleNamespace(
        plan=plan,
        trajectory=wheel.resolve().trajectories["turn"],
        reached=reached,
        ended=SimpleNamespace(outcome="done"),
    )
    assert left_to(record, to) == left
    record.ended = None
    if reached >= 0:
        with pytest.raises(ActivityFailed, match=r"was stopped in \w+, and does not go on from its middle"):
            left_to(record, to)
    with pytest.raises(ActivityFailed, match="to: got 'nowhere'; expected one of approach, standoff"):
        left_to(record, "nowhere")
