"""Key frame by key frame: where no way leads on from a posture the next one is tried; else the first reason is told."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from engines.planning.motion_search import MotionSearch
from engines.planning.plan import Infeasible


def search(ways: dict[tuple[float, str], list[float]], through: int = 2):
    """A search over postures that are numbers: (from, to where) → the postures that can be gone to."""
    made, asked = object.__new__(MotionSearch), []

    def to(here, goals, where):
        asked.append((float(here[0]), where))
        if not ways.get((float(here[0]), where)):
            raise Infeasible("clearance", 0.01, "m", where, f"from {here[0]:g}")
        for there in ways[float(here[0]), where]:
            yield np.array([there]), np.array([[here[0]], [there]])

    made._motion = SimpleNamespace(through=[["a goal"]] * through, goals=["the goal"])
    made._start, made._to = np.array([0.0]), to
    return made, asked


def test_the_next_posture_is_tried_where_no_way_leads_on():
    ways = {(0.0, "through[0]"): [1, 2], (1.0, "through[1]"): [3], (2.0, "through[1]"): [4, 5], (5.0, "goals"): [6, 7]}
    made, _ = search(ways)
    found = [[each[1, 0] for each in way] for _, way in made._stop_by_stop()]
    assert found == [[2, 5, 6], [2, 5, 7]]


def test_no_more_is_looked_for_than_is_asked_for():
    made, asked = search({(0.0, "through[0]"): [1, 2], (1.0, "through[1]"): [3], (3.0, "goals"): [4]})
    assert [each[1, 0] for each in next(made._stop_by_stop())[1]] == [1, 3, 4]
    assert asked == [(0.0, "through[0]"), (1.0, "through[1]"), (3.0, "goals")]


def test_where_none_leads_on_the_first_reason_is_told_after_three_postures():
    made, asked = search({(0.0, "through[0]"): [1, 2, 3, 4]}, through=1)
    with pytest.raises(Infeasible, match="from 1"):
        list(made._stop_by_stop())
    assert asked == [(0.0, "through[0]"), (1.0, "goals"), (2.0, "goals"), (3.0, "goals")]
