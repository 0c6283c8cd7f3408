"""`do: trajectory`, with a motion that goes nowhere: what it refuses before it moves, and what it stops for on the way."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from affordance_templates.placement import turn_about, turn_between
from affordance_templates.server import AffordanceServer
from engines.activities import lines
from engines.activities.base import ActivityFailed
from engines.activities.trajectory import TrajectoryActivity
from handrail.messages import MoveInstance, PlaceInstance, Pose, RemoveInstance
from handrail.robot import library as robots

ALL = {
    "leaving": "",
    "plan": None,
    "still": "",
    "other": "",
    "grip": "fixed",
    "instance": "it",
    "trajectory": "grasp",
    "arm": "right",
    "first": "around",
    "last": "hold",
    "way": "forwards",
}


class Moves:
    """Every motion goes as it is hoped; `meanwhile` is called while it is under way."""

    def __init__(self) -> None:
        self.done: list[str] = []
        self.why: list[str] = []
        self.joints: list[list[str]] = []
        self.ended = None
        self.meanwhile = lambda what: None

    def run(self, motion, ends, cancelled, *, what, still, hoped):
        self.joints.append(motion.joints)
        self.why.append(still())
        self.meanwhile(what)
        self.why.append(still())
        self.done.append(what)
        return SimpleNamespace(outcome=hoped)

    def run_behaviour(self, behaviour, robot, cancelled, *, what):
        self.meanwhile(what)
        self.done.append(what)
        return SimpleNamespace(outcome=behaviour.hoped)


@pytest.fixture
def moves() -> Moves:
    return Moves()


@pytest.fixture
def affordances(tmp_path) -> AffordanceServer:
    server = AffordanceServer(tmp_path / "instances.json")
    server.place(PlaceInstance(name="it", template="box", pose_in_world=Pose(position=(0.5, -0.3, 0.1)), parameters={}))
    return server


@pytest.fixture
def begin(moves, affordances):
    def begin(robot: str = "talos_upper_grippers", **given: str):
        description = robots.load(robot)
        services = SimpleNamespace(
            description=description,
            affordances=affordances,
            daemon=SimpleNamespace(command=lambda: np.zeros(len(description.joints))),
            tip_pose=lambda position, arm: (np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])),
        )
        return TrajectoryActivity(SimpleNamespace(services=services, motion=moves), {**ALL, **given})

    return begin


def test_waypoints_and_shapes_of_the_hand_follow_each_other(begin, moves):
    assert begin().run() == {"waypoint": "hold", "holds": True, "moved": 0.0}
    assert [what.split()[0] for what in moves.done] == ["around", "gripper_right", "hold", "gripper_right"]
    assert moves.why == [""] * 4


MOVED = "it was moved or edited while it was being used (version 1, now 2)"
EDITS = {
    "moved": (lambda of: of.move(MoveInstance(name="it", pose_in_world=Pose(position=(0.5, -0.2, 0.1)))), MOVED),
    "removed": (lambda of: of.remove(RemoveInstance(name="it")), "it was removed while it was being used"),
}


def test_while_another_arm_holds_something_what_both_have_stands(begin, moves):
    begin().run()
    begin(still="left").run()
    alone, beside = moves.joints[0], moves.joints[-1]
    assert set(alone) - set(beside) == {"torso_1_joint", "torso_2_joint"}
    assert len(beside) == 7


@pytest.mark.parametrize("edit", EDITS)
@pytest.mark.parametrize(("under_way", "failed_at"), [("around", "around"), ("gripper", "hold")])
def test_an_instance_that_was_edited_on_the_way_is_not_gone_on_to(
    begin, moves, affordances, edit, under_way, failed_at
):
    change, words = EDITS[edit]
    moves.meanwhile = lambda what: change(affordances) if what.startswith(under_way) else None
    with pytest.raises(ActivityFailed) as failed:
        begin().run()
    assert (failed.value.reason, str(failed.value)) == ("stale", f"{failed_at}: {words}")
    assert moves.done[-1].startswith(under_way), "nothing has begun after it"
    assert moves.why[0] == "" and (under_way == "gripper" or moves.why[1] == words), "a pause would not end in it"


def test_a_joint_of_the_instance_that_was_moved_is_no_edit(begin, moves, affordances):
    affordances.remove(RemoveInstance(name="it"))
    pose = Pose(position=(0.5, 0.1, 0.15))
    affordances.place(PlaceInstance(name="it", template="door", pose_in_world=pose, parameters={}))
    joint = next(iter(affordances.get("it").resolve().joints))
    moves.meanwhile = lambda what: affordances.set_joint("it", joint, 0.1) and None
    door = next(
        name for name, each in affordances.get("it").resolve().trajectories.items()
        if [waypoint.name for waypoint in each.waypoints][1:3] == ["around", "hold"]
    )  # fmt: skip
    assert begin(trajectory=door).run()["waypoint"] == "hold"


def test_a_rigid_tool_that_would_have_to_close_is_refused_before_anything_moves(begin, moves):
    with pytest.raises(ActivityFailed, match="right arm of talos_upper has no hand") as failed:
        begin("talos_upper").run()
    assert (failed.value.reason, moves.done) == ("no_hand", [])
    assert begin("talos_upper", first="around", last="around").run()["waypoint"] == "around"


@pytest.mark.parametrize(("share", "outcome"), [(0.5, "is down"), (0.1, "stuck")])
def test_a_push_by_itself_knows_from_the_motion_before_whether_it_is_at_its_stop(
    begin, moves, affordances, share, outcome
):
    affordances.remove(RemoveInstance(name="it"))
    affordances.place(PlaceInstance(name="it", template="button_panel", pose_in_world=Pose(), parameters={}))
    button = affordances.get("it").resolve().trajectories["push[0]"]
    press = next(waypoint for waypoint in button.waypoints if waypoint.approach == "along")
    joint = affordances.get("it").resolve().joints[press.joint]
    activity = begin("talos_upper", trajectory="push[0]", first=press.name, last=press.name)
    activity.services.tip_pose = lambda position, arm: (np.array(position), np.array([0.0, 0.0, 0.0, 1.0]))
    moves.ended = SimpleNamespace(position=[0.0, 0.0, 0.0])
    moves.run = lambda *_, **__: (
        setattr(  # it presses until its time is over
            moves, "ended", SimpleNamespace(position=(joint.axis * float(press.to) * share).tolist(), outcome="done")
        )
        or moves.ended
    )
    if outcome == "stuck":
        with pytest.raises(ActivityFailed, match="has not moved by") as failed:
            activity.run()
        assert failed.value.reason == "stuck"
    else:
        assert activity.run()["moved"] == press.to


@pytest.mark.parametrize(("slack", "turned"), [(0.0, 0.6), (0.2, 0.4), (0.7, 0.0)])
def test_a_tool_is_turned_no_further_than_to_where_it_may_point(slack, turned):
    here, there = np.eye(4), np.eye(4)
    there[:3, :3] = turn_about(np.array([0.0, 1.0, 0.0]), 0.6)
    after = np.eye(4)
    after[:3, :3] = lines.turned(here, there, slack)
    assert turn_between(here, after) == pytest.approx(turned)
    assert turn_between(after, there) == pytest.approx(0.6 - turned)
