"""The handle on a selected instance: which of its parts a finger is on, and where dragging it puts the instance.

Arrows move along an axis, rings turn about one. Everything is worked out from the camera, so it needs no scene.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from affordance_templates.placement import moved_along, turn_about
from tablet_client.models.view import Array, View

PARTS = ("tx", "ty", "tz", "rx", "ry", "rz")
_SHARE = 0.17  # of the distance to the eye: as large on the screen wherever it stands
_RING = 0.72  # of an arrow's length
_GRASP = 26.0  # px from a part's line that are still on it: a finger is 9 mm wide
_EDGE_ON = 0.25  # of the sine between a ring's plane and the line of sight: flatter ones are dragged along their rim
FINE = 0.1
STEP, TURN = 0.01, math.radians(5)  # m, rad: what snapping goes by


def size(view: View, pose: Array) -> float:
    """m, the length of an arrow."""
    return max(float(_SHARE * np.linalg.norm(pose[:3, 3] - view.eye)), 0.02)


def part_at(view: View, pose: Array, x: float, y: float, parts: Sequence[str] = PARTS) -> str:
    """The part under a finger, nearest first, of those that there are; empty: none."""
    best, found = _GRASP, ""
    for part in parts:
        pixels, depths = view.project(_line(pose, part, size(view, pose)))
        if (depths <= 0).any():
            continue
        away = _away(pixels, np.array([x, y]))
        if away < best:
            best, found = away, part
    return found


def _line(pose: Array, part: str, length: float) -> Array:
    """(k, 3) m: what of a part is drawn, as a line."""
    axis = "xyz".index(part[1])
    if part[0] == "t":
        along = np.linspace(0.35, 1.0, 8)[:, None] * length
        return pose[:3, 3] + along * pose[:3, axis]
    angles = np.linspace(0, 2 * math.pi, 49)[:, None]
    one, other = pose[:3, (axis + 1) % 3], pose[:3, (axis + 2) % 3]
    return np.asarray(pose[:3, 3] + _RING * length * (np.cos(angles) * one + np.sin(angles) * other))


def _away(line: Array, point: Array) -> float:
    start, end = line[:-1], line[1:]
    along = end - start
    share = np.einsum("ij,ij->i", point - start, along) / np.maximum(np.einsum("ij,ij->i", along, along), 1e-9)
    nearest = start + np.clip(share, 0, 1)[:, None] * along
    return float(np.linalg.norm(nearest - point, axis=1).min())


@dataclass
class Grip:
    """A finger on a part, from when it was put there."""

    part: str
    pose: Array
    """(4, 4), where the instance was"""
    x: float
    y: float
    moved: float = 0.0
    """m or rad, so far, before it is made fine or snapped"""

    def drag(self, view: View, x: float, y: float, *, fine: bool = False, snap: bool = False) -> Array:
        """(4, 4): where the instance is to be with the finger at a pixel."""
        axis, origin = self.pose[:3, "xyz".index(self.part[1])], self.pose[:3, 3]
        step = self._along(view, axis, origin, x, y) if self.part[0] == "t" else self._about(view, axis, origin, x, y)
        self.x, self.y = x, y
        self.moved += step * (FINE if fine else 1.0)
        unit = STEP if self.part[0] == "t" else TURN
        amount = round(self.moved / unit) * unit if snap else self.moved
        return shifted(self.pose, self.part, amount)

    def _along(self, view: View, axis: Array, origin: Array, x: float, y: float) -> float:
        """m along the axis from the finger's last place to this one."""
        here, there = (_nearest(view, axis, origin, *at) for at in ((self.x, self.y), (x, y)))
        return 0.0 if here is None or there is None else there - here

    def _about(self, view: View, axis: Array, origin: Array, x: float, y: float) -> float:
        """rad about the axis from the finger's last place to this one."""
        sight = origin - view.eye
        if abs(axis @ sight) / np.linalg.norm(sight) >= _EDGE_ON:
            before, after = (_on_plane(view, axis, origin, *at) for at in ((self.x, self.y), (x, y)))
            if before is not None and after is not None:
                return math.atan2(float(axis @ np.cross(before, after)), float(before @ after))
        # Seen on its edge a ring is a line: along it, as though on the side that is nearer.
        radius = _RING * size(view, self.pose)
        rim = -sight + axis * (axis @ sight)
        rim *= radius / np.linalg.norm(rim)
        pixels, _ = view.project(np.array([origin + rim, origin + rim + 0.01 * np.cross(axis, rim)]))
        tangent = pixels[1] - pixels[0]
        return float(0.01 * (np.array([x - self.x, y - self.y]) @ tangent) / max(float(tangent @ tangent), 1e-9))


def shifted(pose: Array, part: str, amount: float) -> Array:
    """(4, 4): a pose moved along (m) or turned about (rad) one of its own axes."""
    axis, origin = pose[:3, "xyz".index(part[1])], pose[:3, 3]
    if part[0] == "r":
        after = pose.copy()
        after[:3, :3] = turn_about(axis, amount) @ pose[:3, :3]
        return after
    return np.asarray(moved_along(axis, origin, 0.0, amount) @ pose)


def _nearest(view: View, axis: Array, origin: Array, x: float, y: float) -> float | None:
    """m along the axis to where it is nearest to what a pixel shows; None where one looks along it."""
    ray = view.ray(x, y)
    cosine = float(axis @ ray)
    if abs(cosine) > 0.985:
        return None
    apart = origin - view.eye
    return float((cosine * (ray @ apart) - axis @ apart) / (1 - cosine * cosine))


def _on_plane(view: View, axis: Array, origin: Array, x: float, y: float) -> Array | None:
    """(3,) m from the origin to where a pixel shows the plane across the axis; None where it does not."""
    ray = view.ray(x, y)
    along = float(axis @ ray)
    if abs(along) < 1e-6:
        return None
    far = float(axis @ (origin - view.eye)) / along
    return None if far <= 0 else np.asarray(view.eye + far * ray - origin)
