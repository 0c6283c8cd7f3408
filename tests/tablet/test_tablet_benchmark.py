"""The window's benchmark gives VTK the scene that the window draws: robot, ghost, three templates, a cloud."""

from __future__ import annotations

import numpy as np

from benchmarks import tablet
from benchmarks.tablet_scene import PLACES, POINTS


def test_the_peer_is_given_the_robot_its_ghost_three_templates_and_all_points(tmp_path):
    tablet.scene(tmp_path / "scene.npz")
    scene = np.load(tmp_path / "scene.npz")
    count, ghost = int(scene["count"]), scene["ghost"]
    bodies = len(ghost)
    assert bodies > 15 and count == 2 * bodies + 3
    assert np.array_equal(scene["vertices_3"], scene[f"vertices_{bodies + 3}"]), "the ghost has the robot's meshes"
    assert not np.allclose(scene["poses_8"][5], scene[f"poses_{bodies + 8}"][5]), "and stands elsewhere"
    for number, place in enumerate(PLACES):
        wheel = scene[f"vertices_{2 * bodies + number}"]
        assert np.linalg.norm((wheel.min(0) + wheel.max(0)) / 2 - place) < 0.1
    assert len(scene["points"]) == len(scene["points_colors"]) == POINTS
