"""What all are told of instances: a drag at most 30 times a second, its last value always; holds end with their holder."""

from __future__ import annotations

from affordance_templates.holds import HOLD_S
from engines.instance_desk import RATE, LatestAtMost
from handrail import messages as m
from tests.engines.conftest import HINGE


def state(version: int, name: str = "w", **more) -> m.InstanceState:
    return m.InstanceState(
        name=name, template="wheel", template_hash="0", version=version, pose_in_world=m.Pose(), parameters={},
        joint_state={}, **more,
    )  # fmt: skip


def test_a_second_of_a_fast_drag_is_told_30_times_and_its_last_value_last():
    latest, told = LatestAtMost(), []
    for tick in range(1000):  # ms
        now_s = tick * 1e-3
        told += latest.due(now_s)
        if tick % 4 == 0 and latest.now(state(tick), now_s):
            told.append(state(tick))
    told += latest.due(0.999 + 1 / RATE)
    assert 29 <= len(told) <= RATE + 1
    assert [each.version for each in told] == sorted({each.version for each in told}) and told[-1].version == 996


def test_instances_wait_for_themselves_alone_and_their_end_for_nothing():
    latest = LatestAtMost()
    assert latest.now(state(1), 0.0) and latest.now(state(1, "v"), 0.0)
    assert not latest.now(state(2), 0.01) and latest.next_s(0.01) > 0
    assert latest.now(state(2, removed=True), 0.011)
    assert latest.due(1.0) == [] and latest.next_s(1.0) is None


def test_a_drag_is_told_to_its_end_and_a_hold_ends_when_its_holder_has_gone_silent(stack, monkeypatch):
    now = [0.0]
    monkeypatch.setattr(stack.engine._services.affordances._holds, "_clock", lambda: now[0])
    stack.place()
    held = stack.call(m.HoldInstance(name="wheel_1", by="anna"))
    assert held.held_by == "anna"
    for x in range(20):
        last = stack.call(m.EditInstance(name="wheel_1", position=(x / 20, -0.35, 0.3), by="anna")).instance
    assert "held by anna" in stack.refusal(m.MoveInstance(name="wheel_1", pose_in_world=m.Pose(), by="ben")).message
    now[0] += 1.01 * HOLD_S
    ended = stack.wait(
        lambda e: isinstance(e, m.InstanceState) and not e.held_by and e.version == last.version and last.version > 1
    )
    assert ended.pose_in_world.position == (0.95, -0.35, 0.3)
    told = [e for e in stack.events if isinstance(e, m.InstanceState)]
    assert [each.version for each in told] == sorted(each.version for each in told)
    undone = stack.call(m.UndoEdit(by="anna"))
    assert undone.instance.pose_in_world.position == tuple(HINGE.tolist()), "all of the drag was one step"


def test_edits_through_another_engine_are_merged_by_the_first(stack, second, wait_until):
    stack.place()
    wait_until(lambda: second.call(m.GetInstances()).instances)
    stack.call(m.EditInstance(name="wheel_1", parameters={"radius": 0.2}, by="anna"))
    answer = second.call(m.EditInstance(name="wheel_1", position=(1, 0, 0), base=1, by="ben"))
    assert answer.instance.parameters["radius"] == 0.2 and answer.instance.provenance.edited_by == "ben"
    assert second.call(m.HoldInstance(name="wheel_1", by="ben")).held_by == "ben"
    assert second.call(m.ReleaseInstance(name="wheel_1", by="ben")).held_by == ""
    assert second.call(m.UndoEdit(by="ben")).instance.pose_in_world.position == tuple(HINGE.tolist())
    assert second.call(m.RedoEdit(by="ben")).fields == ["position"]
