"""The camera's geometry and the handle on a template: without a screen."""

from __future__ import annotations

import math

import numpy as np
import pytest

from affordance_templates.placement import placed, rotation_of
from tablet_client.models import handle
from tablet_client.models.view import View

VIEW = View(yaw=38, pitch=-14, distance=2.25, focus=(0.24, -0.12, 0.1), field=42, width=870, height=700)
POSE = placed(np.array([0.4, -0.2, 0.3]), rotation_of(np.array([0.3, -0.2, 0.5])))


def pixel(point: np.ndarray, view: View = VIEW) -> tuple[float, float]:
    (at,), _ = view.project(point[None])
    return float(at[0]), float(at[1])


def test_what_the_camera_looks_at_is_in_the_middle_and_up_is_up():
    assert pixel(np.array(VIEW.focus)) == pytest.approx((435, 350))
    assert pixel(np.add(VIEW.focus, (0, 0, 0.1)))[1] < 350
    front = View(yaw=90, pitch=0, distance=2, focus=(0, 0, 0), field=42, width=800, height=800)
    assert front.eye == pytest.approx([2, 0, 0])
    assert pixel(np.array([0, 0.1, 0]), front)[0] > 400, "seen from the front, the robot's left is on the right"


def test_a_ray_through_a_pixel_goes_through_what_the_pixel_shows():
    point = np.array([0.5, 0.1, -0.2])
    ray = VIEW.ray(*pixel(point))
    assert ray == pytest.approx((point - VIEW.eye) / np.linalg.norm(point - VIEW.eye))


def test_a_finger_hits_triangles_or_what_is_within_its_breadth():
    corners = np.array([[0.2, -0.1, 0.0], [0.4, -0.1, 0.0], [0.2, -0.1, 0.3]])
    faces = np.array([[0, 1, 2]])
    inside = corners.mean(axis=0)
    assert VIEW.hit(*pixel(inside), corners, faces, 24) == pytest.approx(np.linalg.norm(inside - VIEW.eye))
    x, y = pixel(corners[1])
    assert VIEW.hit(x + 20, y, corners, faces, 24) < math.inf
    assert VIEW.hit(x + 30, y, corners, faces, 24) == math.inf


@pytest.mark.parametrize("part", handle.PARTS)
def test_each_part_is_found_under_a_finger_that_is_a_little_off(part):
    length, axis = handle.size(VIEW, POSE), "xyz".index(part[1])
    if part[0] == "t":
        point = POSE[:3, 3] + length * POSE[:3, axis]
    else:
        one, other = POSE[:3, (axis + 1) % 3], POSE[:3, (axis + 2) % 3]
        # On the near side, away from where rings cross.
        angles = np.linspace(0, 2 * math.pi, 16, endpoint=False) + 0.4
        rim = [0.72 * length * (math.cos(a) * one + math.sin(a) * other) for a in angles]
        others = [each for each in handle.PARTS if each != part]

        def room(at: np.ndarray) -> float:
            here = np.array(pixel(POSE[:3, 3] + at))
            return min(
                float(np.linalg.norm(VIEW.project(handle._line(POSE, each, length))[0] - here, axis=1).min())
                for each in others
            )

        point = POSE[:3, 3] + max(rim, key=room)
    x, y = pixel(point)
    assert handle.part_at(VIEW, POSE, x + 3, y - 3) == part
    assert handle.part_at(VIEW, POSE, 5, 5) == ""


@pytest.mark.parametrize("part", ["tx", "ty", "tz"])
def test_an_arrow_follows_the_finger_along_its_axis_alone(part):
    axis = POSE[:3, "xyz".index(part[1])]
    grasped = POSE[:3, 3] + handle.size(VIEW, POSE) * axis
    grip = handle.Grip(part, POSE, *pixel(grasped))
    for share in (0.02, 0.05, 0.08):
        moved = grip.drag(VIEW, *pixel(grasped + share * axis))
        assert moved[:3, 3] == pytest.approx(POSE[:3, 3] + share * axis, abs=1e-6)
        assert moved[:3, :3] == pytest.approx(POSE[:3, :3])


@pytest.mark.parametrize("part", ["rx", "ry", "rz"])
def test_a_ring_turns_with_the_finger_more_than_half_round_too(part):
    axis = "xyz".index(part[1])
    one, other = POSE[:3, (axis + 1) % 3], POSE[:3, (axis + 2) % 3]
    oblique = View(yaw=80, pitch=-35, distance=2.25, focus=(0.24, -0.12, 0.1), field=42, width=870, height=700)
    radius = 0.72 * handle.size(oblique, POSE)

    def at(angle: float) -> tuple[float, float]:
        return pixel(POSE[:3, 3] + radius * (math.cos(angle) * one + math.sin(angle) * other), oblique)

    grip = handle.Grip(part, POSE, *at(0.2))
    for angle in np.linspace(0.2, 4.2, 12):
        turned = grip.drag(oblique, *at(float(angle)))
    expected = handle.shifted(POSE, part, 4.0)
    assert turned == pytest.approx(expected, abs=1e-6)


def test_a_ring_seen_on_its_edge_turns_with_a_finger_along_it():
    edge = View(yaw=0, pitch=0, distance=2, focus=(0, 0, 0), field=42, width=800, height=800)  # from the robot's right
    pose = np.eye(4)
    grip = handle.Grip("rz", pose, 400, 400)
    turned = grip.drag(edge, 430, 400)
    angle = math.atan2(turned[1, 0], turned[0, 0])
    assert 0.05 < angle < 1.0, "what is near goes with the finger"


def test_fine_is_a_tenth_and_snapping_goes_by_centimetres_and_five_degrees():
    axis = POSE[:3, 0]
    grasped = POSE[:3, 3] + handle.size(VIEW, POSE) * axis
    there = pixel(grasped + 0.064 * axis)
    fine = handle.Grip("tx", POSE, *pixel(grasped)).drag(VIEW, *there, fine=True)
    assert fine[:3, 3] == pytest.approx(POSE[:3, 3] + 0.0064 * axis, abs=1e-6)
    snapped = handle.Grip("tx", POSE, *pixel(grasped)).drag(VIEW, *there, snap=True)
    assert snapped[:3, 3] == pytest.approx(POSE[:3, 3] + 0.06 * axis, abs=1e-9)
