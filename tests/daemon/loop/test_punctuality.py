"""Late is what comes later than its channel's replies usually do."""

import numpy as np

from hal.punctuality import SETTLES_AFTER, Punctuality

LOST = 50
CHANNEL = (0, 0, 0, 1, 1)


def count(punctuality: Punctuality, *ages: int, cycles: int = 1) -> int:
    return sum(punctuality.late(np.array(ages), any(ages)) for _ in range(cycles))


def test_replies_that_are_there_in_their_cycle_are_not_late() -> None:
    assert count(Punctuality(CHANNEL, 2, LOST), 0, 0, 0, 0, 0, cycles=100) == 0


def test_a_channel_that_always_answers_a_cycle_late_is_counted_until_that_is_usual() -> None:
    punctuality = Punctuality(CHANNEL, 2, LOST)
    assert count(punctuality, 0, 0, 0, 1, 1, cycles=SETTLES_AFTER - 1) == 2 * (SETTLES_AFTER - 1)
    assert count(punctuality, 0, 0, 0, 1, 1, cycles=1000) == 0
    assert punctuality.usual.tolist() == [0, 1]
    assert count(punctuality, 0, 0, 0, 2, 1) == 1, "later than the others of its channel"
    assert count(punctuality, 0, 0, 0, 2, 2) == 2, "a cycle in which all are"


def test_a_drive_that_is_always_later_than_the_others_of_its_channel_counts_in_each_cycle() -> None:
    assert count(Punctuality(CHANNEL, 2, LOST), 0, 1, 0, 0, 0, cycles=500) == 500


def test_a_channel_that_becomes_prompt_again_is_held_to_that_at_once() -> None:
    punctuality = Punctuality(CHANNEL, 2, LOST)
    count(punctuality, 0, 0, 0, 1, 1, cycles=100)
    assert count(punctuality, 0, 0, 0, 0, 0) == 0
    assert count(punctuality, 0, 0, 0, 1, 1) == 2


def test_a_cut_cable_counts_until_its_drives_are_lost_and_does_not_become_usual() -> None:
    punctuality = Punctuality(CHANNEL, 2, LOST)
    for age in range(1, 200):
        assert count(punctuality, 0, 0, 0, age, age) == (2 if age <= LOST else 0)
    assert punctuality.usual.tolist() == [0, 0]
