"""Going over a trajectory again begins at the robot's command, follows the same way and stays slow."""

from __future__ import annotations

import numpy as np
import pytest

from engines.runs import retrace

TIMES = np.linspace(0, 2, 9)
POSITIONS = np.column_stack([np.sin(TIMES), TIMES**2 / 4])
VELOCITIES = np.column_stack([np.cos(TIMES), TIMES / 2])
LIMIT = np.array([1.0, 2.0])


@pytest.mark.parametrize("back", [True, False])
def test_the_way_leads_from_the_command_to_the_trajectory_s_end_or_start(back):
    command = np.array([np.sin(1.3), 1.3**2 / 4]) + 0.003
    path = retrace.way(TIMES, POSITIONS, VELOCITIES, command, back=back)
    assert path[0] == pytest.approx(command)
    assert path[-1] == pytest.approx(POSITIONS[0 if back else -1], abs=1e-9)
    on = np.column_stack([np.arcsin(np.clip(path[1:, 0], -1, 1)), 2 * np.sqrt(path[1:, 1])])
    assert (np.abs(np.sin(on[:, 1]) - path[1:, 0]) < 2e-3).all(), "every point lies on the curve (sin t, t²/4)"


def test_the_timed_way_starts_and_ends_at_rest_within_a_share_of_the_limits():
    path = retrace.way(TIMES, POSITIONS, VELOCITIES, POSITIONS[-1], back=True)
    trajectory = retrace.timed(("a", "b"), path, LIMIT)
    velocities, times = np.array(trajectory.velocities), np.array(trajectory.times)
    assert np.abs(velocities[[0, -1]]).max() == 0
    assert (np.abs(velocities) <= 0.31 * LIMIT).all()
    assert (np.diff(times) > 0).all() and times[0] == 0
    assert trajectory.positions[0] == pytest.approx(path[0]) and trajectory.positions[-1] == pytest.approx(path[-1])
    slopes = np.diff(trajectory.positions, axis=0) / np.diff(times)[:, None]
    assert np.abs(slopes - (velocities[1:] + velocities[:-1]) / 2).max() < 0.05, "velocities belong to the positions"


def test_no_way_is_no_motion():
    assert retrace.timed(("a", "b"), np.zeros((3, 2)), LIMIT) is None
    assert retrace.timed(("a", "b"), np.zeros((1, 2)), LIMIT) is None
