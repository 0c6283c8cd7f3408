"""Whose key a call came with over the link, and what it may say: owners, keepalives, speed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from daemon.exchange import Answer, Kind
from daemon.serving.challenges import Challenges
from handrail import messages as m
from handrail.keepalive import answer
from handrail.robot import library as robots
from handrail.topics import RefusedError
from tests.daemon.test_server import Rig


@pytest.fixture
def rig() -> Iterator[Rig]:
    made = Rig(robots.load("talos_upper_grippers"))
    yield made
    made.close()


def closing(owner: str, by: str, lease: m.Lease) -> m.CommandGripper:
    number = {"lease": lease.epoch, "sequence": lease.sequence + 1}
    return m.CommandGripper(gripper="gripper_right", position=-0.5, owner=owner, by=by, **number)


def test_over_the_link_a_client_commands_what_its_own_key_holds_and_nothing_of_anothers(rig: Rig) -> None:
    loop = rig.start_loop()
    held = rig.call(m.TakeLease(owner="anna/tablet", part="gripper_right"))
    for owner, by in (("anna/tablet", "ben"), ("anna", "ann"), ("anna/tablet", "anna/tab")):
        refused = rig.refusal(closing(owner, by, held))
        assert (refused.field, refused.expected) == ("owner", f"{by}, or {by}/ and more")
    assert rig.refusal(closing("", "ben", held)).field == "owner", "he is himself, and it is not his"
    assert not [command for command in loop.commands if command.kind is Kind.DEVICE]
    rig.call(closing("anna/tablet", "anna", held))
    loop.wait_for(Kind.DEVICE)


def test_a_keepalive_is_answered_and_ended_by_the_key_that_bound_it_by_a_server_started_anew_too(rig: Rig) -> None:
    loop = rig.start_loop()
    told = rig.call(m.BindKeepalive(owner="engine", timeout_s=5.0, by="anna"))
    good = answer(told.challenge, "engine")
    for call in (
        m.KeepAlive(owner="engine", answer=good, by="ben"),
        m.GetChallenge(owner="engine", by="ben"),
        m.ReleaseKeepalive(owner="engine", by="ben"),
        m.BindKeepalive(owner="engine", timeout_s=60.0, by="ben"),
    ):
        refused = rig.refusal(call)
        assert (refused.field, refused.value) == ("owner", "engine")
        assert "bound by anna's key" in refused.message
    rig.call(m.KeepAlive(owner="engine", answer=good, by="anna"))
    rig.stop_server()
    rig.start_server()
    assert rig.refusal(m.GetChallenge(owner="engine", by="ben")).field == "owner"
    loop.answers[Kind.KEEP_ALIVE] = (Answer.KEEPALIVE_LOST, -1, 0.0)
    challenge = rig.call(m.GetChallenge(owner="engine", by="anna")).challenge
    rig.refusal(m.KeepAlive(owner="engine", answer=answer(challenge, "engine"), by="anna"))
    rig.call(m.BindKeepalive(owner="engine", timeout_s=5.0, by="ben"))


def test_a_keepalive_stays_its_keys_while_the_loop_refuses_for_another_reason_and_ends_with_the_loops(rig: Rig) -> None:
    loop = rig.start_loop()
    told = rig.call(m.BindKeepalive(owner="engine", timeout_s=5.0, by="anna"))
    loop.answers[Kind.KEEP_ALIVE] = (Answer.TOO_MANY, -1, 0.0)
    rig.refusal(m.KeepAlive(owner="engine", answer=answer(told.challenge, "engine"), by="anna"))
    assert "bound by anna's key" in rig.refusal(m.GetChallenge(owner="engine", by="ben")).message
    loop.answers[Kind.BIND_KEEPALIVE] = (Answer.KEEPALIVE_LOST, -1, 0.0)
    rig.refusal(m.ReleaseKeepalive(owner="engine", by="anna"))
    del loop.answers[Kind.BIND_KEEPALIVE]
    rig.call(m.BindKeepalive(owner="engine", timeout_s=5.0, by="ben"))


def test_what_the_robots_own_machine_bound_no_client_ends_and_the_machine_may_end_what_a_client_bound(
    tmp_path: Path,
) -> None:
    challenges = Challenges(tmp_path / "keepalives.json")
    challenges.bind("engine", "")
    with pytest.raises(RefusedError, match="the robot's own machine"):
        challenges.allow("engine", "anna")
    challenges.bind("script", "anna")
    challenges.allow("script", "")


def test_people_set_any_speed_and_other_keys_slow_down_or_set_that_of_an_action_of_theirs(rig: Rig) -> None:
    loop = rig.start_loop()
    loop.cycle(speed=0.5)
    rig.call(m.StartAction(id="a", owner="far/arm", motion=rig.trajectory()))
    with loop._lock:
        loop.snapshot["actions"][0]["speed"] = 0.5
    loop.cycle()
    far = {"by": "far", "role": "engine"}
    refused = rig.refusal(m.SetSpeed(share=0.6, **far))
    assert (refused.field, refused.value, refused.expected) == ("share", "0.6", "at most 0.5")
    assert rig.refusal(m.SetSpeed(id="a", share=0.6, by="farther", role="engine")).field == "share"
    for allowed in (
        m.SetSpeed(share=0.4, **far),
        m.SetSpeed(id="a", share=1.0, **far),
        m.SetSpeed(share=1.0, by="anna", role="operator"),
        m.SetSpeed(share=1.0),
    ):
        rig.call(allowed)
    assert [command.value for command in loop.commands if command.kind is Kind.SET_SPEED] == [0.4, 1.0, 1.0, 1.0]


def test_an_action_is_ended_paused_and_steered_by_its_owners_key_alone_and_a_refusal_says_whose_it_is(rig: Rig) -> None:
    loop = rig.start_loop()
    rig.call(m.StartAction(id="a", owner="far/arm", motion=rig.trajectory()))
    for call in (
        m.CancelAction(id="a", by="farther"),
        m.PauseAction(id="a", by="farther"),
        m.ResumeAction(id="a", by="farther"),
        m.StreamPose(id="a", task="t", by="farther"),
        m.StreamJoints(id="a", sequence=1, positions=[], by="farther"),
    ):
        refused = rig.refusal(call)
        assert (refused.field, refused.value, refused.expected) == ("id", "a", "an action of farther")
        assert "far/arm's" in refused.message
    assert [command.kind for command in loop.commands] == [Kind.START]
    for call in (m.PauseAction(id="a", by="far"), m.ResumeAction(id="a", by="far/arm"), m.CancelAction(id="a")):
        rig.call(call)
    assert [command.kind for command in loop.commands[1:]] == [Kind.PAUSE, Kind.RESUME, Kind.CANCEL]
