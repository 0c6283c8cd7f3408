"""Where the wall time of a turn goes in lock-step, as `handrail bench hal_turn` tells it."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import hal_turn
from benchmarks.hal_turn import account
from benchmarks.turn_marks import LoopMark, PlantMark

_LOOP = [0, 10, 13, 20, 29, 33, 38, 45, 0, 0]
"""a turn of 100 ns: waits, heard, decoded, judged, decided, encoded, sent, published, switches"""
_PLANT = [0, 40, 44, 90, 96, 106, 0, 0]
"""its answer: waits, heard, decoded, stepped, encoded, sent, switches"""


def _turns(first: list[int], n: int) -> np.ndarray:
    """The same turn again and again, every 100 ns from 1000 on; in each one sleep, and no core lost."""
    rows = np.tile(first, (n, 1))
    rows[:, :-2] += 1000 + 100 * np.arange(n)[:, None]
    rows[:, -2] = np.arange(n)
    return rows


def test_the_parts_of_a_turn_follow_one_another_and_add_up_to_the_whole() -> None:
    told = account(_turns(_LOOP, 5), _turns(_PLANT, 5))
    assert told.whole.tolist() == [100] * 4  # the fifth has no next one
    assert [int(took[0]) for took in told.parts.values()] == [3, 7, 9, 4, 7, 4, 46, 6, 14]
    assert (sum(told.parts.values()) == told.whole).all()
    assert told.behind["behind: the loop is not there yet for the plant's answer"].tolist() == [0] * 4
    assert told.switches["loop sleeps"].tolist() == [1] * 4


def test_a_process_that_is_not_back_when_frames_come_is_waited_for() -> None:
    loop, plant = _turns(_LOOP, 3), _turns(_PLANT, 3)
    loop[1, LoopMark.WAITS] = plant[0, PlantMark.SENT] + 2
    plant[1, PlantMark.WAITS] = loop[1, LoopMark.SENT] + 1
    told = account(loop, plant)
    assert told.behind["behind: the loop is not there yet for the plant's answer"].tolist() == [2, 0]
    assert told.behind["behind: the plant is not there yet for the loop's command"].tolist() == [0, 1]


def test_a_turn_that_the_plant_did_not_answer_is_left_out() -> None:
    plant = np.delete(_turns(_PLANT, 5), 2, axis=0)
    told = account(_turns(_LOOP, 5), plant)
    assert (sum(told.parts.values()) == told.whole).all() and len(told.whole) == 3


def test_plant_and_loop_account_for_all_of_their_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hal_turn, "_TIMED_S", 0.3)
    rows = hal_turn.rows()
    for when in ("holding", "an arm moves"):
        whole, *others = [part for part in rows if part.when == when]
        parts = others[:9]
        assert whole.name == "whole turn" and all(part.value > 0 for part in parts)
        assert sum(part.value for part in parts) == pytest.approx(whole.value, abs=0.1)
