"""An engine beside the one that owns the instances."""

from __future__ import annotations

import pytest

from engines.engine import Engine
from handrail import messages as m
from handrail.sole_holder import HeldElsewhere


def test_an_instance_that_the_first_engine_owns_is_used_by_a_run_of_the_second(stack, second, daemon, wait_until):
    stack.place()
    wait_until(second.engine._services.affordances.instances)
    run = second.run("turn_valve", goal_deg=30.0, max_strokes=1)
    assert run.run.endswith("@vision")
    prompt = second.prompt()
    assert prompt.id.endswith("@vision")
    second.call(m.AnswerPrompt(id=prompt.id, answer="approve", by="test"))
    second.ended()
    assert {call.owner for call in daemon.started()} == {"vision"}
    # What the tool turned is noted where the instance lives, and told from there.
    (wheel,) = stack.call(m.GetInstances()).instances
    assert wheel.joint_state["hinge"] > 0.1
    assert stack.call(m.GetEngine()).run is None


def test_edits_come_back_whoever_asks_for_them(stack, second, wait_until):
    here = second.engine._services.affordances
    pose = m.Pose(position=(0.5, 0.0, 0.3))
    placed = here.place(m.PlaceInstance(name="wheel_1", template="wheel", pose_in_world=pose))
    assert stack.call(m.GetInstances()).instances == [placed.state()]
    moved = stack.call(m.MoveInstance(name="wheel_1", pose_in_world=m.Pose(position=(0.6, 0.0, 0.3))))
    wait_until(lambda: here.get("wheel_1").state() == moved)
    here.remove(m.RemoveInstance(name="wheel_1"))
    wait_until(lambda: not here.instances())
    assert not stack.call(m.GetInstances()).instances


def test_a_plan_of_the_second_engine_is_stale_when_the_first_one_moves_its_instance(stack, second, wait_until):
    stack.place()
    wait_until(second.engine._services.affordances.instances)
    plan = second.call(m.MakePlan(instance="wheel_1", trajectory="turn", arm="right"))
    stack.call(m.MoveInstance(name="wheel_1", pose_in_world=m.Pose(position=(0.6, 0.0, 0.3))))
    stale = second.wait(lambda e: isinstance(e, m.PlanPreview) and e.id == plan.id and not e.fresh)
    assert "wheel_1" in stale.stale_because


def test_each_tells_what_it_is_and_does(stack, second):
    assert second.call(m.GetEngines()).engines[0].name == "vision"
    stack.run("press")
    stack.call(m.AnswerPrompt(id=stack.prompt().id, answer="press", by="test"))
    stack.ended()
    told = stack.wait(lambda e: isinstance(e, m.EngineInfo) and e.status not in ("", "ready", "running"))
    assert (told.name, told.program) == ("engine", "press")
    assert stack.call(m.GetEngines()).engines == [told]


def test_two_of_the_same_name_are_refused(stack, runtime, planner):
    with pytest.raises(HeldElsewhere):
        Engine(runtime, stack.engine._services.description, planner, stack.engine._services.tip_pose)
