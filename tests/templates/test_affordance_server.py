"""Instances: edits count versions, wrong ones change nothing, and the disk has them all."""

from __future__ import annotations

import pytest

from affordance_templates.server import AffordanceServer
from handrail.messages import MoveInstance, PlaceInstance, Pose, RemoveInstance, SetParameters
from handrail.topics import RefusedError

POSE = Pose(position=(0.55, -0.35, 0.30))


@pytest.fixture
def file(tmp_path):
    return tmp_path / "instances.json"


@pytest.fixture
def told():
    return []


@pytest.fixture
def server(file, told):
    return AffordanceServer(file, changed=told.append)


def place(server, **parameters):
    return server.place(PlaceInstance(name="w", template="wheel", pose_in_world=POSE, parameters=parameters))


def test_every_edit_raises_the_version_and_is_told(server, told):
    place(server)
    server.move(MoveInstance(name="w", pose_in_world=Pose(position=(0.5, 0, 0))))
    server.set_parameters(SetParameters(name="w", parameters={"radius": 0.2}))
    assert [state.version for state in told] == [1, 2, 3]
    assert told[-1].parameters["radius"] == 0.2 and told[-1].parameters["spokes"] == 4
    assert server.versions() == {"w": 3}


def test_a_joint_believed_elsewhere_is_told_but_is_no_edit(server, told):
    place(server)
    server.set_joint("w", "hinge", 1.2)
    assert told[-1].version == 1 and told[-1].joint_state == {"hinge": 1.2}
    assert server.get("w").resolve().joints["hinge"].position == 1.2


def test_edits_keep_what_they_do_not_change(server):
    place(server, radius=0.2)
    server.set_joint("w", "hinge", 1.2)
    server.set_parameters(SetParameters(name="w", parameters={"arc": 90}))
    moved = server.move(MoveInstance(name="w", pose_in_world=Pose()))
    assert moved.state().parameters["radius"] == 0.2 and moved.state().parameters["arc"] == 90
    assert moved.joint_state == {"hinge": 1.2}


@pytest.mark.parametrize(
    ("request_", "field"),
    [
        (PlaceInstance(name="w", template="wheel", pose_in_world=POSE), "name"),
        (PlaceInstance(name="v", template="whale", pose_in_world=POSE), "template"),
        (
            PlaceInstance(name="v", template="wheel", pose_in_world=POSE, parameters={"radius": 9.0}),
            "parameters.radius",
        ),
        (PlaceInstance(name="v", template="wheel", pose_in_world=Pose(position=(float("inf"), 0, 0))), "pose_in_world"),
        (PlaceInstance(name="v", template="wheel", pose_in_world=Pose(position=(1e9, 0, 0))), "pose_in_world.position"),
        (MoveInstance(name="w", pose_in_world=Pose(position=(0, -2e3, 0))), "pose_in_world.position"),
        (MoveInstance(name="w", pose_in_world=Pose(orientation=(0, 0, 0, 2))), "pose_in_world.orientation"),
        (MoveInstance(name="v", pose_in_world=POSE), "name"),
        (SetParameters(name="w", parameters={"radius": 0.2, "spokes": 2.5}), "parameters.spokes"),
        (SetParameters(name="w", parameters={"radius": 0.08, "tool_radius": 0.03, "spoke_radius": 0.03}), "parameters"),
        (RemoveInstance(name="v"), "name"),
    ],
)
def test_a_wrong_edit_is_refused_and_changes_nothing(server, told, file, request_, field):
    place(server)
    before, on_disk, count = server.instances(), file.read_bytes(), len(told)
    do = {PlaceInstance: server.place, MoveInstance: server.move, SetParameters: server.set_parameters}
    with pytest.raises(RefusedError) as caught:
        do.get(type(request_), server.remove)(request_)
    assert caught.value.refusal.field == field
    assert caught.value.refusal.expected
    assert server.instances() == before and file.read_bytes() == on_disk and len(told) == count


def test_all_is_there_again_after_a_restart(server, file):
    place(server, radius=0.2)
    server.set_joint("w", "hinge", 1.2)
    server.move(MoveInstance(name="w", pose_in_world=Pose(orientation=(0, 0, 1, 0))))
    again = AffordanceServer(file)
    assert [each.state() for each in again.instances()] == [each.state() for each in server.instances()]
    assert not again.problems


def test_versions_go_on_after_removal_and_restart(server, file):
    place(server)
    server.remove(RemoveInstance(name="w"))
    assert place(AffordanceServer(file)).version == 2


def test_a_template_edited_between_two_starts_makes_a_new_version(server, file):
    place(server)
    text = file.read_text()
    file.write_text(text.replace(server.get("w").template.hash, "0" * 16))
    assert AffordanceServer(file).get("w").version == 2


def test_a_file_that_can_not_be_read_is_put_aside_not_overwritten(file):
    file.write_text('{"instances": [')
    server = AffordanceServer(file)
    assert server.instances() == [] and "put aside" in server.problems[0]
    place(server)
    assert file.with_suffix(".unreadable").read_text() == '{"instances": ['


def test_an_instance_whose_template_is_missing_stays_on_disk(server, file):
    place(server)
    file.write_text(file.read_text().replace('"template": "wheel"', '"template": "lost"'))
    again = AffordanceServer(file)
    assert again.instances() == [] and "instance w" in again.problems[0]
    again.place(PlaceInstance(name="v", template="wheel", pose_in_world=POSE))
    assert '"template": "lost"' in file.read_text()
