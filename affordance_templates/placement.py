"""Rigid placements (4, 4), without a kinematics library: the tablet reads templates, too."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from handrail.messages import Pose

Array = NDArray[np.float64]


def placed(position: Array, rotation: Array) -> Array:
    """(4, 4) of a position (3,) m and a rotation (3, 3)."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    return pose


def inverse(pose: Array) -> Array:
    """(4, 4) of the opposite placement."""
    back = np.eye(4)
    back[:3, :3] = pose[:3, :3].T
    back[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return back


def rotation_of(rpy: Array) -> Array:
    """(3, 3) rotation of URDF's roll, pitch, yaw: about the fixed x, then y, then z axis."""
    sr, sp, sy = (math.sin(angle) for angle in rpy)
    cr, cp, cy = (math.cos(angle) for angle in rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def skew(vector: Array) -> Array:
    """(3, 3) that multiplies as the cross product with the vector does."""
    x, y, z = vector.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def turn_about(axis: Array, angle: float) -> Array:
    """(3, 3) rotation about a unit vector by `angle` rad (Rodrigues)."""
    cross = skew(axis)
    return np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross


def moved_along(axis: Array, origin: Array, angle: float, distance: float) -> Array:
    """(4, 4) screw motion: by `angle` rad about the axis (unit vector through `origin`), and by `distance` m along it."""
    turned = turn_about(axis, angle)
    return placed(origin - turned @ origin + axis * distance, turned)


def shortest_turn(start: Sequence[float], end: Array) -> Array:
    """(3, 3): the shortest rotation that brings one unit vector along another; of opposite ones, about some axis across."""
    first = np.asarray(start, float)
    axis, cosine = skew(first) @ end, float(first @ end)
    if cosine < -1 + 1e-9:
        across = np.cross(first, np.eye(3)[int(np.argmin(np.abs(first)))])
        return turn_about(across / np.linalg.norm(across), math.pi)
    cross = skew(axis)
    return np.eye(3) + cross + cross @ cross / (1 + cosine)


def turn_between(here: Array, there: Array) -> float:
    """rad from one placement's orientation to the other's."""
    cosine = (float(np.trace(here[:3, :3].T @ there[:3, :3])) - 1.0) / 2.0
    return math.acos(min(1.0, max(-1.0, cosine)))


def pointing(direction: Array, across: Array | None = None) -> Array:
    """(3, 3) of a hand that points along `direction` (−z), its y as nearly along `across` as that allows; without: by the shortest
    turn. Raises ValueError where both are parallel.
    """
    if across is None:
        return shortest_turn((0.0, 0.0, -1.0), direction)
    z = -direction
    y = across - z * float(z @ across)
    length = float(np.linalg.norm(y))
    if length < 1e-6:
        raise ValueError("is parallel to the pointing direction; expected one across it")
    y = y / length
    return np.column_stack([skew(y) @ z, y, z])


def of_message(pose: Pose) -> Array:
    """(4, 4) of a message's pose."""
    x, y, z, w = pose.orientation
    return placed(
        np.array(pose.position, float),
        np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
            ]
        ),
    )


def to_message(pose: Array) -> Pose:
    """A placement as messages say it, the quaternion's w ≥ 0."""
    r = pose[:3, :3]
    # Each row holds 4 q_i q_j (Bar-Itzhack): the largest diagonal is never small, so nothing is lost to cancellation.
    products = np.array(
        [
            [1 + r[0, 0] - r[1, 1] - r[2, 2], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0], r[2, 1] - r[1, 2]],
            [r[0, 1] + r[1, 0], 1 - r[0, 0] + r[1, 1] - r[2, 2], r[1, 2] + r[2, 1], r[0, 2] - r[2, 0]],
            [r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], 1 - r[0, 0] - r[1, 1] + r[2, 2], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], 1 + r[0, 0] + r[1, 1] + r[2, 2]],
        ]
    )
    row = products[int(np.argmax(np.diag(products)))]
    row = row / np.linalg.norm(row) * (1.0 if row[3] >= 0 else -1.0)
    x, y, z, w = row.tolist()
    px, py, pz = pose[:3, 3].tolist()
    return Pose(position=(px, py, pz), orientation=(x, y, z, w))


def rpy_of(rotation: Array) -> Array:
    """(3,) rad, URDF's roll, pitch, yaw of a rotation (3, 3); at pitch ±π/2 the roll is 0."""
    pitch = math.asin(min(1.0, max(-1.0, -rotation[2, 0])))
    if abs(rotation[2, 0]) > 1 - 1e-9:
        return np.array([0.0, pitch, math.atan2(-rotation[0, 1], rotation[1, 1])])
    return np.array([math.atan2(rotation[2, 1], rotation[2, 2]), pitch, math.atan2(rotation[1, 0], rotation[0, 0])])
