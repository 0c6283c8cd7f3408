"""Valves of the demo: drawn from the seed, within the range that is promised."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest

from handrail.config import read
from handrail.demo.scenario import (
    ANGLE_ERROR,
    ANGLE_RANGE,
    NOMINAL,
    OBJECT,
    POSITION_ERROR,
    POSITION_RANGE,
    about,
    draw,
    multiply,
)

SEEDS = range(300)
HINGE = np.array([1.0, 0.0, 0.0])


def rotation(pose):
    return pin.Quaternion(np.array(pose.orientation)).matrix()


def test_the_same_seed_gives_the_same_valve_and_another_gives_another():
    assert draw(3) == draw(3)
    assert draw(3) != draw(4)


def test_valves_fill_the_range_and_stay_in_it():
    offsets = np.array([draw(seed).valve_in_world.position for seed in SEEDS]) - NOMINAL
    assert np.all(np.abs(offsets) <= POSITION_RANGE)
    assert np.all(offsets.max(axis=0) > 0.9 * POSITION_RANGE)
    assert np.all(offsets.min(axis=0) < -0.9 * POSITION_RANGE)


def test_hinges_look_up_to_twenty_degrees_to_each_side_up_and_down_and_never_roll():
    angles = []
    for seed in SEEDS:
        roll, pitch, yaw = pin.rpy.matrixToRpy(rotation(draw(seed).valve_in_world))
        assert roll == pytest.approx(0, abs=1e-9)
        angles.append((yaw, pitch))
    assert np.all(np.abs(angles) <= ANGLE_RANGE + 1e-9)
    assert np.all(np.ptp(angles, axis=0) > 1.8 * ANGLE_RANGE)


def test_the_template_is_off_by_what_the_scenario_says_and_never_by_more_than_allowed():
    sizes = []
    for seed in SEEDS:
        scenario = draw(seed)
        truth, placed = scenario.valve_in_world, scenario.instance_in_world
        shift = np.linalg.norm(np.subtract(placed.position, truth.position))
        turn = np.linalg.norm(pin.log3(rotation(placed) @ rotation(truth).T))
        assert shift == pytest.approx(scenario.position_error, abs=1e-9)
        assert turn == pytest.approx(scenario.angle_error, abs=1e-7)
        sizes.append((shift / POSITION_ERROR, turn / ANGLE_ERROR))
    assert np.all(np.array(sizes) <= 1 + 1e-6)
    assert np.all(np.max(sizes, axis=0) > 0.95)


def test_errors_point_everywhere():
    shifts = [np.subtract(s.instance_in_world.position, s.valve_in_world.position) for s in map(draw, SEEDS)]
    assert np.all(np.abs(np.mean([shift / np.linalg.norm(shift) for shift in shifts], axis=0)) < 0.15)


def test_the_scene_file_holds_the_true_pose_and_not_the_placed_one(tmp_path):
    scenario = draw(7)
    file = tmp_path / "scene.yaml"
    file.write_text(scenario.scene())
    valve = read(file).data["objects"][OBJECT]
    assert tuple(valve["pose_in_world"]["position"]) == scenario.valve_in_world.position
    assert tuple(valve["pose_in_world"]["orientation"]) == scenario.valve_in_world.orientation
    assert valve["radius"] == 0.15
    assert valve["hinge_friction"] >= 2.0
    assert str(scenario.instance_in_world.position[0]) not in scenario.scene()


def test_quaternions_follow_pinocchio():
    a, b = about((0, 0, 1), 0.7), about((0, 1, 0), -0.3)
    expected = pin.Quaternion(a).matrix() @ pin.Quaternion(b).matrix()
    np.testing.assert_allclose(pin.Quaternion(multiply(a, b)).matrix(), expected, atol=1e-12)
    np.testing.assert_allclose(
        pin.Quaternion(about((1, 0, 0), math.pi / 2)).matrix() @ [0, 1, 0], [0, 0, 1], atol=1e-12
    )
