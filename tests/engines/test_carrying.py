"""What a hand takes hold of goes along with it in the affordance server, and stands where the hand has opened."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from affordance_templates.placement import placed
from affordance_templates.server import AffordanceServer
from engines.activities.base import ActivityFailed
from engines.activities.hand import HandActivity
from engines.activities.trajectory import TrajectoryActivity
from handrail.messages import HoldInstance, MoveInstance, PlaceInstance, Pose
from handrail.robot import library as robots

START = Pose(position=(0.5, -0.3, 0.1))


class World:
    """A robot whose hands hold whatever they close on, and carry it up by `lifted` m."""

    def __init__(self, folder):
        self.robot = robots.load("talos_upper_grippers")
        self.affordances = AffordanceServer(folder / "instances.json")
        self.affordances.link_in_world = lambda link: placed(np.array([0.4, 0.0, self.lifted]), np.eye(3))
        self.affordances.place(PlaceInstance(name="it", template="box", pose_in_world=START, parameters={}))
        self.lifted, self.holds, self.said = 0.0, True, list[str]()
        self.meanwhile = lambda what: None
        self.context = SimpleNamespace(
            motion=self,
            services=SimpleNamespace(
                description=self.robot,
                affordances=self.affordances,
                daemon=SimpleNamespace(command=lambda: np.zeros(len(self.robot.joints))),
                tip_pose=lambda position, arm: (np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])),
                log=lambda level, text: self.said.append(text),
            ),
        )

    def run(self, motion, ends, cancelled, *, what, still, hoped):
        assert still() == ""
        self.lifted += 0.1 if what == "lift" else 0.0
        self.meanwhile(what)
        return SimpleNamespace(outcome=hoped)

    def run_behaviour(self, behaviour, robot, cancelled, *, what):
        return SimpleNamespace(outcome="gripper_holds" if self.holds else "gripper_at")

    def trajectory(self, **given):
        values = {
            "instance": "it", "trajectory": "grasp", "arm": "right", "other": "", "still": "", "first": "around", "last": "",
            "way": "forwards", "leaving": "", "plan": None, "grip": "carried", **given,
        }  # fmt: skip
        return TrajectoryActivity(self.context, values).run()

    def hand(self, pose: str, arm: str = "right"):
        return HandActivity(self.context, {"arm": arm, "pose": pose, "effort": 0.0, "speed": 0.0}).run()

    def there(self) -> tuple[str, float]:
        """What it goes along with, and how high it is, m."""
        self.affordances.follow()
        it = self.affordances.get("it")
        return it.attached_to, round(it.pose_in_world.position[2], 6)


@pytest.fixture
def world(tmp_path) -> World:
    return World(tmp_path)


def test_it_is_in_the_hand_before_it_is_lifted_and_the_lift_goes_on(world):
    seen = []
    world.meanwhile = lambda what: seen.append((what, world.there()[0]))
    assert world.trajectory()["waypoint"] == "lift"
    assert seen == [("around", ""), ("hold", ""), ("lift", "link:grasp_right")]
    assert world.there() == ("link:grasp_right", 0.2)


def test_what_is_not_carried_or_not_there_stays_where_it_is(world):
    world.trajectory(grip="fixed")
    assert world.there() == ("", 0.1)
    world.holds = False
    world.trajectory()
    assert world.there() == ("", 0.1)


def test_it_stands_where_the_hand_that_has_it_opens_and_another_hand_leaves_it_alone(world):
    world.trajectory()
    world.hand("open", arm="left")
    world.hand("closed")
    assert world.there()[0] == "link:grasp_right"
    world.lifted += 0.05
    world.hand("open")
    assert world.there() == ("", 0.25)
    world.lifted = 0.0
    assert world.there() == ("", 0.25)


def test_a_way_back_puts_it_down_and_goes_on(world):
    world.trajectory()
    assert world.trajectory(way="backwards", grip="fixed")["waypoint"] == "around"
    assert world.there()[0] == ""


def test_a_hand_that_closes_on_nothing_any_more_has_lost_it(world):
    world.trajectory()
    world.holds = False
    world.hand("closed")
    assert world.there() == ("", 0.2)


def test_an_edit_of_what_is_carried_is_stale_still(world):
    move = MoveInstance(name="it", pose_in_world=Pose(position=(0.5, 0.0, 0.1)))
    world.meanwhile = lambda what: world.affordances.move(move) and None if what == "hold" else None
    with pytest.raises(ActivityFailed, match="it was moved or edited while it was being used") as failed:
        world.trajectory()
    assert failed.value.reason == "stale"


def test_what_an_operator_holds_is_told_to_people_and_the_motion_goes_on(world):
    world.affordances.hold(HoldInstance(name="it", by="ann"))
    assert world.trajectory()["holds"]
    assert world.there()[0] == ""
    (said,) = world.said
    assert said.startswith(
        "it is not told to go along with grasp_right: it is held by ann, who is moving it; field name"
    )
