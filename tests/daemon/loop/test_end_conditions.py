"""The measurements behind end conditions, as pure functions."""

import numpy as np
import pytest

from daemon.actions.end_conditions import beyond, distance, force_frames, room_to_limits
from handrail.messages import ContactEnd, ForceEnd, PoseErrorEnd, TimeEnd


def test_a_distance_counts_along_its_axis_only_and_without_sign() -> None:
    vector = np.array([3.0, 0.0, -4.0])
    assert distance(vector, None) == pytest.approx(5.0)
    assert distance(vector, (0.0, 0.0, 2.5)) == pytest.approx(4.0)
    assert distance(vector, (0.0, 1.0, 0.0)) == 0.0


def test_a_value_at_its_limit_is_not_beyond_it() -> None:
    assert beyond(1.0, 1.0) is None
    assert beyond(1.0001, 1.0) == 1.0001


def test_room_is_to_the_nearer_limit_and_negative_outside() -> None:
    room = room_to_limits(np.array([0.1, 0.9, 1.2]), np.zeros(3), np.ones(3))
    assert room == pytest.approx([0.1, 0.1, -0.2])


def test_forces_are_estimated_where_a_condition_asks_for_one() -> None:
    ends = (
        TimeEnd(after=1.0),
        PoseErrorEnd(frame="a", position=0.1),
        ForceEnd(frame="b", axis=(1.0, 0.0, 0.0), limit=3.0),
        ContactEnd(frame="c", threshold=3.0),
    )
    assert force_frames(ends) == ("b", "c")
