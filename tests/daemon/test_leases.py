"""Leases: who may command which part, what an old command is, and what a server that was started anew still knows."""

from __future__ import annotations

from pathlib import Path

import pytest

from daemon.serving.leases import Leases
from handrail.robot import library as robots
from handrail.topics import RefusedError

TALOS = robots.load("talos_upper")
LEFT, RIGHT = TALOS.groups["arm_left"], TALOS.groups["arm_right"]


@pytest.fixture
def leases(tmp_path: Path) -> Leases:
    return Leases(TALOS, tmp_path / "leases.json")


def refused(leases: Leases, owner: str, moved: tuple[str, ...], epoch: int, sequence: int) -> str:
    """The field that is refused; empty: none."""
    try:
        leases.check(owner, moved, epoch, sequence)
    except RefusedError as error:
        return error.refusal.field
    return ""


def test_what_nobody_has_taken_anybody_may_command(leases: Leases) -> None:
    assert not refused(leases, "script", TALOS.joints, 0, 0)
    leases.take("tablet", "arm_left")
    assert not refused(leases, "script", RIGHT, 0, 0)
    assert refused(leases, "script", LEFT, 0, 0) == "owner"
    assert refused(leases, "script", TALOS.joints, 0, 0) == "owner"
    assert refused(leases, "", LEFT[:1], 0, 0) == "owner"


def test_a_part_has_one_owner_and_the_body_is_all_of_them(leases: Leases) -> None:
    arm, _ = leases.take("tablet", "arm_left")
    for part in ("arm_left", "body"):
        with pytest.raises(RefusedError, match="arm_left is tablet's"):
            leases.take("script", part)
    head, _ = leases.take("script", "head")
    assert head.epoch > arm.epoch
    assert [(lease.part, lease.owner) for lease in leases.held()] == [("arm_left", "tablet"), ("head", "script")]
    with pytest.raises(RefusedError, match=r"no such part.*part = 'tail'|tail"):
        leases.take("script", "tail")


def test_a_command_counts_once_and_only_in_its_order(leases: Leases) -> None:
    lease, _ = leases.take("tablet", "arm_left")
    assert not refused(leases, "tablet", LEFT, lease.epoch, 1)
    assert refused(leases, "tablet", LEFT, lease.epoch, 1) == "sequence"
    assert not refused(leases, "tablet", LEFT, lease.epoch, 5)
    assert refused(leases, "tablet", LEFT, lease.epoch, 4) == "sequence"
    assert leases.sequence("tablet") == 5


def test_a_command_from_before_the_part_was_lost_and_taken_again_does_not_count(leases: Leases) -> None:
    old, _ = leases.take("tablet", "arm_left")
    new, ended = leases.take("script", "arm_left", take_over=True)
    assert [lease.epoch for lease in ended] == [old.epoch]
    assert refused(leases, "tablet", LEFT, old.epoch, 1) == "owner"
    again, _ = leases.take("tablet", "arm_left", take_over=True)
    assert refused(leases, "tablet", LEFT, old.epoch, 1) == "lease"
    assert refused(leases, "tablet", LEFT, again.epoch + 1, 1) == "lease"
    assert refused(leases, "script", LEFT, new.epoch, 1) == "owner"
    assert not refused(leases, "tablet", LEFT, again.epoch, 1)


def test_one_command_may_move_several_parts_of_its_owner(leases: Leases) -> None:
    arm, _ = leases.take("tablet", "arm_left")
    torso, _ = leases.take("tablet", "torso")
    both = (*LEFT, *TALOS.groups["torso"])
    assert refused(leases, "tablet", both, arm.epoch, 1) == "lease", "it knew nothing of the torso's"
    assert not refused(leases, "tablet", both, torso.epoch, 1)
    assert not refused(leases, "tablet", LEFT, arm.epoch, 2), "the arm's is as good as it was"


def test_a_lease_is_returned_by_its_number_and_lost_by_its_owner(leases: Leases) -> None:
    old, _ = leases.take("tablet", "arm_left")
    new, _ = leases.take("tablet", "arm_left")
    for owner, epoch in (("script", new.epoch), ("tablet", old.epoch)):
        with pytest.raises(RefusedError):
            leases.give_back(owner, "arm_left", epoch)
    leases.give_back("tablet", "arm_left", new.epoch)
    assert not refused(leases, "script", LEFT, 0, 0)
    leases.take("tablet", "head")
    leases.take("tablet", "torso")
    assert {lease.part for lease in leases.lose("tablet")} == {"head", "torso"}
    assert leases.held() == leases.lose("tablet") == []


def test_a_server_that_was_started_anew_knows_leases_epochs_and_sequences(leases: Leases, tmp_path: Path) -> None:
    lease, _ = leases.take("tablet", "arm_left")
    leases.check("tablet", LEFT, lease.epoch, 7)
    anew = Leases(TALOS, tmp_path / "leases.json")
    assert anew.held() == leases.held()
    assert refused(anew, "tablet", LEFT, lease.epoch, 7) == "sequence"
    assert anew.take("script", "head")[0].epoch > lease.epoch
    (tmp_path / "leases.json").write_bytes(b"{")
    assert Leases(TALOS, tmp_path / "leases.json").held() == []
