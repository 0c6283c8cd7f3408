"""Owners who fall silent."""

from __future__ import annotations

from daemon.owners import Owners


def test_an_owner_that_checks_in_is_never_lost() -> None:
    owners = Owners(timeout_s=1.0)
    engine = owners.number("engine")
    for now in range(100):
        owners.check_in("engine", now * 0.5)
        assert owners.lost([engine], now * 0.5 + 0.4) == []


def test_an_owner_that_falls_silent_is_lost_after_the_timeout_and_not_before() -> None:
    owners = Owners(timeout_s=1.0)
    engine = owners.number("engine")
    owners.check_in("engine", 10.0)
    assert owners.lost([engine], 10.99) == []
    assert owners.lost([engine], 11.01) == [engine]


def test_the_timeout_begins_with_the_action_for_an_owner_who_never_spoke() -> None:
    owners = Owners(timeout_s=1.0)
    assert owners.lost([5], 100.0) == []
    assert owners.lost([5], 100.9) == []
    assert owners.lost([5], 101.1) == [5]


def test_an_owner_with_nothing_running_is_not_watched() -> None:
    owners = Owners(timeout_s=1.0)
    engine = owners.number("engine")
    owners.check_in("engine", 0.0)
    assert owners.lost([], 50.0) == []
    # and a later action gives it a full timeout anew
    assert owners.lost([engine], 100.0) == []
    assert owners.lost([engine], 101.5) == [engine]


def test_one_owners_silence_does_not_hide_behind_anothers_check_in() -> None:
    owners = Owners(timeout_s=1.0)
    engine, script = owners.number("engine"), owners.number("script")
    owners.check_in("engine", 0.0)
    owners.check_in("script", 0.0)
    owners.check_in("engine", 1.0)
    assert owners.lost([engine, script], 1.5) == [script]


def test_a_lost_owner_is_told_again_only_after_another_timeout() -> None:
    owners = Owners(timeout_s=1.0)
    owners.lost([5], 0.0)
    assert owners.lost([5], 1.1) == [5]
    assert owners.lost([5], 1.2) == []
    assert owners.lost([5], 2.3) == [5]


def test_an_owners_number_is_the_same_in_a_server_started_anew() -> None:
    assert Owners().number("engine") == Owners().number("engine") != 0
