"""How far points are from a solid, for many at once: what coal answers one pair at a time."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

Array = NDArray[np.float64]


class PointDistance:
    """Of one convex solid, in its own frame. Raises ValueError for a kind of shape that is not known."""

    def __init__(self, shape: coal.CollisionGeometry):
        shape.computeLocalAABB()
        self._low, self._high = shape.aabb_local.min_.copy(), shape.aabb_local.max_.copy()
        self._shape = shape
        self._faces: Array | None = None
        if isinstance(shape, coal.ConvexBase):
            self._faces = ConvexHull(shape.points()).equations
        elif not isinstance(shape, coal.Box | coal.Sphere | coal.Capsule | coal.Cylinder):
            raise ValueError(
                f"shape: got {type(shape).__name__}; expected a convex hull, box, sphere, capsule or cylinder"
            )

    def within(self, points: Array, placement: pin.SE3, reach: float) -> NDArray[np.bool_]:
        """(n,) which of the points (n, 3) m are inside the placed solid or at most `reach` m from its faces."""
        local = (points - placement.translation) @ placement.rotation
        near = np.flatnonzero(((local >= self._low - reach) & (local <= self._high + reach)).all(axis=1))
        inside = np.zeros(len(points), bool)
        inside[near] = self._outside(local[near]) <= reach
        return inside

    def _outside(self, p: Array) -> Array:
        """(n,) m from the nearest face's plane, negative inside; of round shapes from the surface itself."""
        shape = self._shape
        if self._faces is not None:
            return np.asarray((p @ self._faces[:, :3].T + self._faces[:, 3]).max(axis=1, initial=-np.inf))
        match shape:
            case coal.Box():
                return np.asarray((np.abs(p) - shape.halfSide).max(axis=1, initial=-np.inf))
            case coal.Sphere():
                return np.asarray(np.linalg.norm(p, axis=1) - shape.radius)
            case coal.Capsule():
                along = np.clip(p[:, 2], -shape.halfLength, shape.halfLength)
                return np.asarray(np.linalg.norm(p - along[:, None] * [0.0, 0.0, 1.0], axis=1) - shape.radius)
            case _:
                across = np.hypot(p[:, 0], p[:, 1]) - shape.radius
                return np.maximum(across, np.abs(p[:, 2]) - shape.halfLength)
