"""Owners who fall silent."""

from __future__ import annotations

import pytest

from daemon.serving.owners import LONGEST_TICK_S, Owners


class Watch:
    """Owners with a timeout of 1 s, looked after every 0.1 s of wall time."""

    def __init__(self) -> None:
        self.owners, self.wall, self.robot = Owners(timeout_s=1.0), 50.0, 7.0
        self.look(())

    def look(self, running: tuple[int, ...]) -> list[int]:
        self.owners.tick(self.wall, self.robot)
        return self.owners.lost(running)

    def go_on(self, seconds: float, *running: int, robot: float = 1.0) -> list[int]:
        """Those that were lost meanwhile; `robot`: how fast its time goes."""
        lost = []
        for _ in range(round(seconds * 10)):
            self.wall, self.robot = self.wall + 0.1, self.robot + 0.1 * robot
            lost += self.look(running)
        return lost


@pytest.fixture
def watch() -> Watch:
    return Watch()


def test_an_owner_that_checks_in_is_never_lost(watch: Watch) -> None:
    engine = watch.owners.number("engine")
    for _ in range(20):
        watch.owners.check_in("engine")
        assert watch.go_on(0.9, engine) == []


def test_an_owner_that_falls_silent_is_lost_after_the_timeout_and_not_before(watch: Watch) -> None:
    engine = watch.owners.number("engine")
    watch.owners.check_in("engine")
    assert watch.go_on(0.9, engine) == []
    assert watch.go_on(0.2, engine) == [engine]


def test_the_timeout_begins_with_the_action_for_an_owner_who_never_spoke(watch: Watch) -> None:
    watch.go_on(5.0)
    assert watch.go_on(0.9, 5) == []
    assert watch.go_on(0.3, 5) == [5]


def test_an_owner_with_nothing_running_is_not_watched(watch: Watch) -> None:
    engine = watch.owners.number("engine")
    watch.owners.check_in("engine")
    assert watch.go_on(50.0) == []
    # and a later action gives it a full timeout anew
    assert watch.go_on(0.9, engine) == []
    assert watch.go_on(0.3, engine) == [engine]


def test_one_owners_silence_does_not_hide_behind_anothers_check_in(watch: Watch) -> None:
    engine, script = watch.owners.number("engine"), watch.owners.number("script")
    watch.owners.check_in("engine")
    watch.owners.check_in("script")
    assert watch.go_on(0.9, engine, script) == []
    watch.owners.check_in("engine")
    assert watch.go_on(0.5, engine, script) == [script]


def test_a_lost_owner_is_told_again_only_after_another_timeout(watch: Watch) -> None:
    assert watch.go_on(1.2, 5) == [5]
    assert watch.go_on(0.8, 5) == []
    assert watch.go_on(0.3, 5) == [5]


def test_where_robot_time_goes_slowly_owners_have_the_second_in_it(watch: Watch) -> None:
    engine = watch.owners.number("engine")
    assert watch.go_on(4.8, engine, robot=0.2) == []
    assert watch.go_on(0.6, engine, robot=0.2) == [engine]


def test_where_robot_time_goes_fast_owners_have_the_second_of_the_wall(watch: Watch) -> None:
    engine = watch.owners.number("engine")
    assert watch.go_on(0.9, engine, robot=5.0) == []
    assert watch.go_on(0.3, engine, robot=5.0) == [engine]


def test_a_time_in_which_nobody_looked_is_not_an_owners_silence(watch: Watch) -> None:
    engine = watch.owners.number("engine")
    watch.look((engine,))
    watch.wall, watch.robot = watch.wall + 30.0, watch.robot + 30.0
    assert watch.look((engine,)) == []
    assert watch.go_on(1.0 - LONGEST_TICK_S - 0.1, engine) == []
    assert watch.go_on(0.3, engine) == [engine]


def test_without_a_loop_the_walls_time_counts(watch: Watch) -> None:
    engine = watch.owners.number("engine")
    watch.look((engine,))
    for _ in range(12):
        watch.wall += 0.1
        watch.owners.tick(watch.wall, None)
    assert watch.owners.lost((engine,)) == [engine]


def test_an_owners_number_is_the_same_in_a_server_started_anew() -> None:
    assert Owners().number("engine") == Owners().number("engine") != 0
