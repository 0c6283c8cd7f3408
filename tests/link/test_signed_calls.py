"""The gate writes on a call whose key it came with, whatever the call says of itself."""

from __future__ import annotations

import shutil

from handrail.link import keys
from handrail.messages import (
    AttachInstance,
    Challenge,
    CommandGripper,
    EditInstance,
    GetChallenge,
    HoldInstance,
    MoveInstance,
    PlaceInstance,
    Pose,
    RedoEdit,
    ReleaseInstance,
    RemoveInstance,
    SetParameters,
    SetSpeed,
    UndoEdit,
)


def test_a_call_says_the_name_and_the_role_of_its_key_and_not_what_its_sender_wrote(stand, tmp_path):
    daemon, _ = stand.daemon(), stand.gate()
    daemon.answers[GetChallenge] = lambda call: Challenge(challenge=call.by)
    anna = keys.ensure(tmp_path / "anna")
    shutil.copy(stand.keys / "server.key", anna / "server.key")
    shutil.copy(anna / "client.key", stand.keys / "allowed" / "anna.key")
    client = stand.client(anna)
    client.call(CommandGripper(gripper="g", position=0.0, owner="ben", by="ben"))
    client.call(SetSpeed(share=1.0, by="", role="developer"))
    assert client.call(GetChallenge(owner="engine", by="ben")).challenge == "anna"
    gripper, speed, _ = daemon.asked
    assert (gripper.by, gripper.owner) == ("anna", "ben"), "who he says he is, is the daemon's to refuse"
    assert (speed.by, speed.role) == ("anna", "operator")
    (stand.keys / "allowed" / "anna.key").rename(stand.keys / "allowed" / "gone")
    client.call(SetSpeed(share=1.0, by="local", role="operator"))
    assert (daemon.asked[-1].by, daemon.asked[-1].role) == ("unknown", "none")


def test_who_edits_instances_is_whose_key_it_is(stand, tmp_path):
    engine, _, _ = stand.engine(), stand.daemon(), stand.gate()
    client = stand.client()
    for kind in (PlaceInstance, MoveInstance, SetParameters, EditInstance, AttachInstance, RemoveInstance, HoldInstance,
                 ReleaseInstance, UndoEdit, RedoEdit):  # fmt: skip
        given = {"name": "w", "template": "t", "pose_in_world": Pose(), "parameters": {}, "by": "somebody else"}
        client.call(kind(**{field: given[field] for field in kind.__struct_fields__ if field in given}))
        assert engine.asked[-1].by == "local", kind.__name__
