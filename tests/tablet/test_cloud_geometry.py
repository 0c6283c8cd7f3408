"""How a cloud reaches the graphics system: as points, or as small solids where points have no size."""

from __future__ import annotations

import numpy as np
import pytest

from tablet_client.scene.geometry import Grains, Points

POSITIONS = np.random.default_rng(1).uniform(-1, 1, (40_000, 3)).astype(np.float32)
COLOURS = np.random.default_rng(2).integers(0, 256, (40_000, 3), np.uint8)


def columns(geometry):
    return np.frombuffer(geometry.vertexData().data(), np.float32).reshape(-1, 7)


def test_every_point_is_drawn_where_it_is_in_its_colour():
    points = Points()
    points.show(POSITIONS, COLOURS)
    drawn = columns(points)
    assert np.array_equal(drawn[:, :3], POSITIONS)
    assert 255 * drawn[:, 3:6] ** (1 / 2.2) == pytest.approx(COLOURS, abs=0.05)
    assert points.boundsMin().toTuple() == pytest.approx(POSITIONS.min(0))
    points.show(POSITIONS[:10], None)
    assert len(columns(points)) == 10


def test_grains_are_thinned_out_evenly():
    grains = Grains()
    grains.show(POSITIONS, COLOURS)
    middles = columns(grains)[:, :3].reshape(-1, 6, 3).mean(axis=1)
    assert middles == pytest.approx(POSITIONS[::3], abs=1e-6)
