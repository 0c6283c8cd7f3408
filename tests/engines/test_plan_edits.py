"""Key frames: what an operator drags a ghost to is kept by the new plan, and by edits of that one."""

from __future__ import annotations

import pytest

from handrail import client
from handrail import messages as m


class Client(client.Client):
    """The client's API on the engine's own socket, without a link."""

    def call(self, message, timeout_s=None):
        return self._session.call(message)


def at(angle: float) -> list[m.Goal]:
    return [m.JointsGoal(positions={"angle": angle})]


@pytest.fixture
def reach(stack) -> m.PlanPreview:
    return stack.call(m.PlanMotion(goals=at(0.5), arm="right", clearance=0.02, label="aside"))


def frames(planner) -> list[float]:
    """Where the last plan's key frames, and at last its goals, have the first joint."""
    call = planner.asked[-1]["call"]
    return [goals[0].positions["angle"] for goals in (*(frame.goals for frame in call.through), call.goals)]


def test_edits_go_in_between_by_their_time_and_stay_in_later_ones(stack, planner, reach):
    assert reach.key_times == []
    first = stack.call(m.EditPlan(id=reach.id, goals=at(0.3), time=0.4))
    assert frames(planner) == [0.3, 0.5]
    assert (first.label, first.key_times) == ("aside", [0.5])
    assert planner.asked[-1]["call"].clearance == 0.02, "all else is asked for as before"
    second = stack.call(m.EditPlan(id=first.id, goals=at(0.1), time=0.2))
    third = stack.call(m.EditPlan(id=second.id, goals=at(0.4), time=0.9))
    assert frames(planner) == [0.1, 0.3, 0.4, 0.5]
    assert stack.call(m.GetPlan(id=third.id, details=True)).origin.asked["edits"] == second.id
    assert stack.call(m.GetPlan(id=reach.id)).key_times == [], "the plan that was edited is what it was"


def test_a_key_frame_or_the_end_is_changed_in_place(stack, planner, reach):
    first = stack.call(m.EditPlan(id=reach.id, goals=at(0.3), time=0.4))
    second = stack.call(m.EditPlan(id=first.id, goals=at(0.2), frame=0))
    assert frames(planner) == [0.2, 0.5]
    stack.call(m.EditPlan(id=second.id, goals=at(0.6), frame=1))
    assert frames(planner) == [0.2, 0.6]


def test_an_edit_that_can_not_be_is_refused_with_what_could(stack, planner, reach):
    assert "expected at most 1.000 s" in stack.refusal(m.EditPlan(id=reach.id, goals=at(0.3), time=1.5)).message
    assert "frame: got 1; expected at most 0" in stack.refusal(m.EditPlan(id=reach.id, goals=at(0.3), frame=1)).message
    assert "no such plan" in stack.refusal(m.EditPlan(id="plan-99", goals=at(0.3))).message
    stack.place()
    stroke = stack.call(m.MakePlan(instance="wheel_1", trajectory="turn"))
    assert "expected a motion to goals" in stack.refusal(m.EditPlan(id=stroke.id, goals=at(0.3))).message
    planner.infeasible = True
    assert "elbow limit missed by 0.12 rad" in stack.refusal(m.EditPlan(id=reach.id, goals=at(0.3))).message


def test_a_newer_edit_supersedes_one_that_still_plans_and_the_older_caller_is_told(stack, planner, reach, elsewhere):
    planner.pace.clear()
    older = elsewhere(m.EditPlan(id=reach.id, goals=at(0.3), time=0.4))
    stack.wait(lambda e: isinstance(e, m.PlanProgress) and e.what == f"edit of {reach.id}" and not e.done)
    newer = elsewhere(m.EditPlan(id=reach.id, goals=at(0.35), time=0.4))
    older.end()
    assert "superseded by a newer one" in older.refusal
    planner.pace.set()
    newer.end()
    assert frames(planner) == [0.35, 0.5]
    kept = [plan.id for plan in stack.call(m.GetEngine()).plans]
    assert kept == [reach.id, newer.answer.id], "what was superseded is nowhere"


def test_a_long_drag_leaves_the_plan_and_its_newest_edit_and_pushes_no_other_plan_out(stack, planner, reach):
    other = stack.call(m.PlanMotion(goals=at(0.7), arm="right"))
    for step in range(15):
        newest = stack.call(m.EditPlan(id=reach.id, goals=at(0.3 + 0.01 * step), time=0.4))
    assert [plan.id for plan in stack.call(m.GetEngine()).plans] == [other.id, reach.id, newest.id]
    assert frames(planner) == [pytest.approx(0.44), 0.5], "each is an edit of the plan, none of the one before it"


def test_an_edit_is_taken_back_and_what_others_build_on_stays(stack, daemon, reach):
    client = Client(stack)
    first = client.edit_plan(reach.id, at(0.3), time=0.4)
    second = client.edit_plan(first.id, at(0.1), time=0.2)
    third = client.edit_plan(reach.id, at(0.2), time=0.4)
    assert client.undo_edit(second.id).id == first.id, "it was edited, so a newer one has not taken its place"
    assert client.undo_edit(first.id).id == reach.id
    with pytest.raises(ValueError, match="no edit"):
        client.undo_edit(reach.id)
    client.execute_plan(third.id, wait=True)
    assert "start_left" in client.get_plan(reach.id).stale_causes
    again = client.edit_plan(reach.id, at(0.25), time=0.4)
    assert again.fresh, "an edit begins where the robot is now"
    assert client.get_plan(third.id).stale_causes == ["executed"], "what was executed is not taken away"
