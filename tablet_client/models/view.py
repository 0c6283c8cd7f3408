"""The 3-D view's camera: where a point of the world is on the screen, and what lies under a finger."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """A camera that orbits a point, as qml/CameraRig.qml has it. Angles in degrees, lengths in m, the picture in pixels."""

    yaw: float
    pitch: float
    distance: float
    focus: tuple[float, float, float]
    """world"""
    field: float
    """degrees, from the picture's top to its bottom"""
    width: float
    height: float

    @cached_property
    def axes(self) -> Array:
        """(3, 3): rows are the directions right, up and back (towards the eye), in the world."""
        yaw, pitch = math.radians(self.yaw), math.radians(self.pitch)
        turn = np.array([[math.cos(yaw), 0, math.sin(yaw)], [0, 1, 0], [-math.sin(yaw), 0, math.cos(yaw)]])
        tilt = np.array([[1, 0, 0], [0, math.cos(pitch), -math.sin(pitch)], [0, math.sin(pitch), math.cos(pitch)]])
        right, up, back = (turn @ tilt).T
        return np.array([[x, -z, y] for x, y, z in (right, up, back)])  # Quick 3D has y up, the world z

    @cached_property
    def eye(self) -> Array:
        """(3,) m, world."""
        return np.array(self.focus) + self.distance * self.axes[2]

    @property
    def _focal(self) -> float:
        return self.height / 2 / math.tan(math.radians(self.field) / 2)

    def project(self, points: Array) -> tuple[Array, Array]:
        """Pixels (n, 2) and depths (n,) m of points (n, 3); what is behind the eye is far off the screen."""
        seen = (np.atleast_2d(points) - self.eye) @ self.axes.T
        depth = -seen[:, 2]
        scale = self._focal / np.where(depth > 1e-6, depth, 1e-6)
        return np.stack([self.width / 2 + seen[:, 0] * scale, self.height / 2 - seen[:, 1] * scale], -1), depth

    def ray(self, x: float, y: float) -> Array:
        """(3,) unit vector from the eye through a pixel."""
        across = np.array([(x - self.width / 2) / self._focal, (self.height / 2 - y) / self._focal, -1.0])
        along = across @ self.axes
        return np.asarray(along / np.linalg.norm(along))

    def hit(self, x: float, y: float, vertices: Array, faces: NDArray[np.integer], reach: float) -> float:
        """m from the eye to triangles under a pixel, or, where there are none, to vertices within `reach` pixels; inf: neither."""
        if not len(faces):
            return math.inf
        ray = self.ray(x, y)
        a, b, c = (vertices[faces[:, corner]] for corner in range(3))
        one, other = b - a, c - a  # Möller and Trumbore
        across = np.cross(ray, other)
        share = np.einsum("ij,ij->i", one, across)
        safe = np.where(np.abs(share) > 1e-12, share, np.inf)
        from_a = self.eye - a
        u = np.einsum("ij,ij->i", from_a, across) / safe
        turned = np.cross(from_a, one)
        v = turned @ ray / safe
        depth = np.einsum("ij,ij->i", other, turned) / safe
        met = depth[(u >= 0) & (v >= 0) & (u + v <= 1) & (depth > 0) & np.isfinite(safe)]
        if len(met):
            return float(met.min())
        pixels, depths = self.project(vertices)
        near = depths[(np.linalg.norm(pixels - (x, y), axis=1) <= reach) & (depths > 0)]
        return float(near.min()) if len(near) else math.inf
