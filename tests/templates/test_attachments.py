"""Instances that go along with others, or with a link of the robot."""

from __future__ import annotations

import math

import numpy as np
import pytest

from affordance_templates import attachments
from affordance_templates.placement import moved_along, of_message, placed
from affordance_templates.server import AffordanceServer
from handrail.messages import (
    AttachInstance,
    Attachment,
    EditInstance,
    MoveInstance,
    PlaceInstance,
    Pose,
    RedoEdit,
    RemoveInstance,
    UndoEdit,
)
from handrail.topics import RefusedError

HALF = math.sqrt(0.5)


@pytest.fixture
def told():
    return []


@pytest.fixture
def links():
    """link → (4, 4) where it is."""
    return {"hand": placed(np.array([0.4, 0.0, 0.2]), np.eye(3))}


@pytest.fixture
def server(tmp_path, told, links):
    server = AffordanceServer(tmp_path / "instances.json", changed=told.append)
    server.link_in_world = links.get
    for name, x in (("door", 1.0), ("box", 1.5), ("cap", 1.6)):
        pose = Pose(position=(x, 0, 0))
        server.place(PlaceInstance(name=name, template="box", pose_in_world=pose, source="a test", by="anna"))
    return server


def attach(server, name, by="anna", **to):
    return server.attach(AttachInstance(name=name, by=by, **to))


def at(server, name):
    return server.get(name).pose_in_world.position


def turn_door(server, by="anna"):
    """A quarter about z, where it stands."""
    server.edit(EditInstance(name="door", orientation=(0, 0, HALF, HALF), by=by))


def test_what_is_attached_stays_where_it_is_and_then_goes_along_at_new_versions(server, told):
    answer = attach(server, "box", instance="door")
    assert answer.instance.attachment == Attachment(instance="door", pose=Pose(position=(0.5, 0, 0)))
    assert answer.instance.version == 2 and at(server, "box") == (1.5, 0, 0)
    attach(server, "cap", instance="box")
    told.clear()
    turn_door(server)
    assert at(server, "box") == pytest.approx((1.0, 0.5, 0)) and at(server, "cap") == pytest.approx((1.0, 0.6, 0))
    assert [(each.name, each.version) for each in told] == [("door", 2), ("box", 3), ("cap", 3)]
    server.undo(UndoEdit(by="anna"))
    assert at(server, "cap") == pytest.approx((1.6, 0, 0)) and server.get("cap").version == 4


def test_an_attached_one_is_moved_in_the_world_and_keeps_that_place_on_its_parent(server):
    turn_door(server)
    attach(server, "box", instance="door")
    server.move(MoveInstance(name="box", pose_in_world=Pose(position=(1.0, 0.3, 0.1))))
    assert at(server, "box") == pytest.approx((1.0, 0.3, 0.1))
    assert server.get("box").own_pose.position == pytest.approx((0.3, 0, 0.1))
    server.move(MoveInstance(name="door", pose_in_world=Pose(position=(2, 0, 0))))
    assert at(server, "box") == pytest.approx((2.3, 0, 0.1))


def test_what_the_robot_carries_follows_its_measured_link_without_a_new_version(server, told, links, tmp_path):
    assert server.follow() is False
    attach(server, "box", link="hand")
    attach(server, "cap", instance="box")
    told.clear()
    assert server.follow() is True and told == [], "it has not moved"
    links["hand"] = moved_along(np.array([0.0, 0.0, 1.0]), np.zeros(3), math.pi / 2, 0.1)
    links["hand"][:3, 3] += (0.4, 0, 0.2)
    server.follow()
    assert [(each.name, each.version) for each in told] == [("box", 2), ("cap", 2)]
    assert at(server, "box") == pytest.approx((0.4, 1.1, 0.1)) and at(server, "cap") == pytest.approx((0.4, 1.2, 0.1))
    server.follow()
    links["hand"][0, 3] += 5e-5
    server.follow()
    assert len(told) == 2, "nobody sees so little"
    assert sorted(attachments.carried(server.instances())) == ["box", "cap"]
    assert server.undo(UndoEdit(by="anna")).instance.attachment is None
    del links["hand"]
    again = AffordanceServer(tmp_path / "instances.json")
    again.link_in_world = links.get
    assert again.follow() is True and again.get("box").state().attachment.link == "hand"
    assert at(again, "box") == pytest.approx((0.4, 1.1, 0.1)), "until the robot tells where its hand is"


def test_what_is_carried_has_its_place_on_the_link_edited_as_any_other(server, links):
    attach(server, "box", link="hand")
    links["hand"] = placed(np.array([0.0, 1.0, 0.0]), np.eye(3))
    server.follow()
    server.edit(EditInstance(name="box", position=(0.0, 1.0, 0.5), by="ben"))
    links["hand"] = np.eye(4)
    server.follow()
    assert at(server, "box") == pytest.approx((0, 0, 0.5)) and server.get("box").version == 3


@pytest.mark.parametrize(
    ("to", "field", "words"),
    [
        ({"instance": "cap"}, "instance", "along with itself"),
        ({"instance": "door"}, "instance", "along with itself"),
        ({"instance": "nothing"}, "instance", "not there"),
        ({"link": "tail"}, "link", "no link tail"),
        ({"link": "hand", "instance": "box"}, "instance", "a link and an instance"),
    ],
)
def test_what_can_not_be_is_refused_and_changes_nothing(server, told, to, field, words):
    attach(server, "box", instance="door")
    attach(server, "cap", instance="box")
    count = len(told)
    with pytest.raises(RefusedError, match=words) as caught:
        attach(server, "door", **to)
    assert caught.value.refusal.field == field and len(told) == count


def test_what_others_are_attached_to_is_not_removed(server):
    attach(server, "box", instance="door", by="ben")
    with pytest.raises(RefusedError, match="box would have nothing to go along with"):
        server.remove(RemoveInstance(name="door"))
    server.undo(UndoEdit(by="anna"))  # placing the cap
    server.undo(UndoEdit(by="anna"))
    assert "ben" not in server.undo(UndoEdit(by="anna")).left["instance"]
    assert at(server, "door") == (1, 0, 0)
    attach(server, "box", by="ben")
    assert at(server, "box") == (1.5, 0, 0) and server.get("box").state().attachment is None
    server.remove(RemoveInstance(name="door"))


def test_an_attachment_goes_back_with_its_place_or_not_at_all(server):
    attach(server, "box", instance="door")
    turn_door(server, "ben")
    answer = server.undo(UndoEdit(by="anna"))
    assert set(answer.fields) == {"attachment", "position"} and at(server, "box") == (1.5, 0, 0)
    assert server.redo(RedoEdit(by="anna")).instance.attachment.instance == "door"
    assert at(server, "box") == pytest.approx((1.0, 0.5, 0))
    server.edit(EditInstance(name="box", position=(0, 0, 0), by="ben"))
    answer = server.undo(UndoEdit(by="anna"))
    assert answer.fields == [] and answer.left.keys() == {"attachment", "position", "orientation"}
    assert answer.instance.attachment.instance == "door" and at(server, "box") == pytest.approx((0, 0, 0), abs=1e-12)


def test_taking_back_does_not_make_a_circle(server):
    attach(server, "box", instance="door")
    attach(server, "box")
    attach(server, "door", instance="box", by="ben")
    answer = server.undo(UndoEdit(by="anna"))
    assert "itself" in answer.left["attachment"] and server.get("box").attached_to == ""


def test_what_was_removed_comes_back_on_its_parent_or_in_the_world(server):
    attach(server, "box", instance="door")
    server.remove(RemoveInstance(name="box", by="ben"))
    server.move(MoveInstance(name="door", pose_in_world=Pose(position=(3, 0, 0)), by="cleo"))
    assert server.undo(UndoEdit(by="ben")).instance.pose_in_world.position == (3.5, 0, 0)
    server.redo(RedoEdit(by="ben"))
    server.remove(RemoveInstance(name="door", by="cleo"))
    back = server.undo(UndoEdit(by="ben")).instance
    assert back.attachment is None and back.pose_in_world.position == (3.5, 0, 0)


def test_attachments_survive_a_restart(server, tmp_path):
    attach(server, "box", instance="door")
    again = AffordanceServer(tmp_path / "instances.json")
    assert [each.state() for each in again.instances()] == [each.state() for each in server.instances()]
    again.move(MoveInstance(name="door", pose_in_world=Pose(position=(0, 0, 0))))
    assert at(again, "box") == pytest.approx((0.5, 0, 0))
    assert of_message(again.get("box").pose_in_world)[:3, :3] == pytest.approx(np.eye(3))
