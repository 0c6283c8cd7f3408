"""Waiting awake: what is asked how often, and when nobody asks any more."""

import os
from collections.abc import Iterator

import pytest

from hal import awake as waiting
from hal.awake import Awake

ALLOWED = os.sched_getaffinity(0)


@pytest.fixture(autouse=True)
def _all_cores_afterwards() -> Iterator[None]:
    yield
    os.sched_setaffinity(0, ALLOWED)


class _Answers:
    """Says no so often, then yes."""

    def __init__(self, noes: int):
        self.noes, self.asked = noes, 0

    def __call__(self, timeout: int) -> bool:
        assert timeout == 0
        self.asked += 1
        return self.asked > self.noes


@pytest.mark.skipif(len(ALLOWED) < 2, reason="this machine lets us have one core only")
def test_what_comes_soon_is_seen_without_sleep(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        waiting, "_AWAKE_S", 30.0
    )  # on a busy machine others have the core for long between two questions
    answers = _Answers(5)
    assert Awake().look(answers)
    assert answers.asked == 6


@pytest.mark.skipif(len(ALLOWED) < 2, reason="this machine lets us have one core only")
def test_who_has_waited_in_vain_sleeps_at_once_until_something_has_come(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(waiting, "_AWAKE_S", 0.2)
    awake, never = Awake(), _Answers(1 << 60)
    assert not awake.look(never)
    assert never.asked > 1
    never.asked = 0
    assert not awake.look(never)
    assert never.asked == 1
    awake.woken()
    assert not awake.look(never)
    assert never.asked > 2


def test_who_is_kept_on_one_core_sleeps_at_once() -> None:
    os.sched_setaffinity(0, {min(ALLOWED)})
    never = _Answers(1 << 60)
    assert not Awake().look(never)
    assert never.asked == 1
