"""A scene is read strictly: what is wrong is named with file, line, field and expectation."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hal.plant.merge import rotation_from_rpy
from hal.plant.scene import load, quaternion
from handrail.config import ConfigError

GOOD = """\
objects:
  valve:
    kind: wheel
    pose_in_world: {position: [0.5, 0, 0.3], rpy_deg: [0, 0, 90]}
    radius: 0.15
    spokes: 4
    hinge_friction: 2.0
"""


def _load(tmp_path, text):
    file = tmp_path / "scene.yaml"
    file.write_text(text)
    return load(file)


def test_angles_in_degrees_and_quaternions_say_the_same(tmp_path):
    by_angles = _load(tmp_path, GOOD).poses_in_world["valve"]
    by_quaternion = _load(
        tmp_path, GOOD.replace("rpy_deg: [0, 0, 90]", f"orientation: [0, 0, {math.sqrt(0.5)}, {math.sqrt(0.5)}]")
    ).poses_in_world["valve"]
    assert by_angles.position == by_quaternion.position == (0.5, 0.0, 0.3)
    np.testing.assert_allclose(by_angles.orientation, by_quaternion.orientation, atol=1e-12)
    np.testing.assert_allclose(by_angles.orientation, [0, 0, math.sqrt(0.5), math.sqrt(0.5)], atol=1e-12)


@pytest.mark.parametrize(
    ("was", "becomes", "line", "field", "says"),
    [
        ("radius: 0.15", "radius: -1", 5, "objects.valve.radius", "0.03"),
        ("radius: 0.15", "radius: .nan", 5, "objects.valve.radius", "got nan"),
        ("spokes: 4", "spokes: many", 6, "objects.valve.spokes", "int"),
        ("spokes: 4", "spoks: 4", 6, "objects.valve.spoks", "unknown field"),
        ("kind: wheel", "kind: whel", 3, "objects.valve.kind", "whel"),
        ("hinge_friction: 2.0", "hinge_friction: -2.0", 7, "objects.valve.hinge_friction", ">= 0"),
        ("rpy_deg: [0, 0, 90]", "rpy_deg: [0, 90]", 4, "objects.valve.pose_in_world.rpy_deg", "length 3"),
        ("rpy_deg: [0, 0, 90]", "orientation: [0, 0, 0, 2]", 4, "objects.valve.pose_in_world.orientation", "unit"),
        ("rpy_deg: [0, 0, 90]", "rpy_deg: [0, 0, .inf]", 4, "objects.valve.pose_in_world.rpy_deg[2]", "finite"),
        ("radius: 0.15", "tube_radius: 0.09", 5, "objects.valve.tube_radius", "at most half the radius, 0.075"),
        ("{position: [0.5, 0, 0.3], rpy_deg: [0, 0, 90]}", "{rpy_deg: [0, 0, 90]}", 4, "position", "required"),
        ("  valve:", "  the valve:", 2, "objects.the valve", "letters"),
    ],
)
def test_a_bad_scene_is_refused_with_line_field_and_expectation(tmp_path, was, becomes, line, field, says):
    with pytest.raises(ConfigError) as caught:
        _load(tmp_path, GOOD.replace(was, becomes))
    message = str(caught.value)
    assert message.startswith(f"{tmp_path / 'scene.yaml'}:{line}: ")
    assert field in message
    assert says in message


def test_a_scene_that_is_not_there_names_those_that_are():
    with pytest.raises(ConfigError, match=r"no such scene; expected one of .*valve"):
        load("nowhere")


def test_a_users_scene_comes_before_the_built_in_one(tmp_path, monkeypatch):
    (tmp_path / "scenes").mkdir()
    (tmp_path / "scenes" / "valve.yaml").write_text(GOOD)
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    assert load("valve").poses_in_world["valve"].position == (0.5, 0.0, 0.3)


def test_every_rotation_has_its_quaternion():
    generator = np.random.default_rng(3)
    for _ in range(100):
        x, y, z, w = q = quaternion(rotation_from_rpy(*generator.uniform(-np.pi, np.pi, 3)))
        assert math.hypot(*q) == pytest.approx(1.0)
        assert w >= 0
    rotation = rotation_from_rpy(0.1, -0.4, 2.0)
    x, y, z, w = quaternion(rotation)
    rebuilt = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    np.testing.assert_allclose(rebuilt, rotation, atol=1e-12)
