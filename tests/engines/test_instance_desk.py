"""What all are told of instances: a drag at most 30 times a second, its last value always; holds end with their holder."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from affordance_templates.holds import HOLD_S
from affordance_templates.placement import placed
from engines.instance_desk import RATE, LatestAtMost
from engines.link_poses import LinkPoses
from engines.tip_poses import tip_poses
from handrail import messages as m
from handrail.robot import library as robots
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


def test_what_the_robot_carries_goes_along_with_its_measured_joints(stack, daemon, wait_until):
    """The fake robot's `depth` is where its hand is along x."""

    def hand(link):
        now = stack.engine._services.daemon.measured()
        return placed(np.array([now[0][1], 0, 0]), np.eye(3)) if link == "hand" and now else None

    stack.place()
    stack.engine._services.affordances.link_in_world = hand
    assert "no link foot" in stack.refusal(m.AttachInstance(name="wheel_1", link="foot")).message
    attached = stack.call(m.AttachInstance(name="wheel_1", link="hand", by="anna")).instance
    plan = stack.call(m.MakePlan(instance="wheel_1", trajectory="turn"))
    daemon.command = daemon.command + np.array([0.0, 0.01, 0.0])
    went = stack.wait(lambda e: isinstance(e, m.InstanceState) and e.pose_in_world != attached.pose_in_world)
    wait_until(lambda: stack.call(m.GetInstances()).instances[0].pose_in_world.position[0] > 0.5599)
    assert went.version == attached.version == 2
    assert stack.call(m.GetPlan(id=plan.id)).fresh, "it was not edited, and the robot is within its tolerance"


def test_an_instance_is_saved_as_a_template_of_the_engines_workspace_and_placed_again(stack, tmp_path, monkeypatch):
    monkeypatch.delenv("HANDRAIL_WORKSPACE", raising=False)
    stack.place()
    stack.call(m.EditInstance(name="wheel_1", parameters={"radius": 0.22}))
    assert "handrail new workspace" in stack.refusal(m.SaveTemplate(instance="wheel_1", name="big")).expected
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    saved = stack.call(m.SaveTemplate(instance="wheel_1", name="big"))
    assert saved.file == str(tmp_path / "affordance_templates" / "big.yaml")
    placed_anew = stack.call(m.PlaceInstance(name="other", template="big", pose_in_world=m.Pose()))
    assert placed_anew.parameters["radius"] == 0.22 and placed_anew.template_hash == saved.hash
    assert "there is a template big" in stack.refusal(m.SaveTemplate(instance="wheel_1", name="big")).message
    assert stack.refusal(m.SaveTemplate(instance="wheel_1", name="../x")).field == "name"
    assert stack.refusal(m.SaveTemplate(instance="wheel_9", name="y")).field == "name"


def test_links_are_where_the_robots_joints_have_them():
    robot = robots.load("talos_upper")
    position, base = robot.home_position("ready"), None
    poses = LinkPoses(robot, lambda: (position, base))
    tip, _ = tip_poses(robot)(position, "right")
    assert poses(robot.arms["right"].tip)[:3, 3] == pytest.approx(tip)
    assert poses("no such link") is None and LinkPoses(robot, lambda: None)("base_link") is None
    still = {"linear_velocity": (0, 0, 0), "angular_velocity": (0, 0, 0), "position_deviation": 0, "time_ns": 0}
    base = m.Base(source="still", pose_in_world=m.Pose(position=(1.0, 2.0, 3.0)), orientation_deviation=0, **still)
    assert poses(robot.arms["right"].tip)[:3, 3] == pytest.approx(tip + np.array([1.0, 2.0, 3.0]))
    base = msgspec.structs.replace(base, source="none")
    assert poses("base_link") is None
