"""Cubic splines through knots, at rest at both ends, as matrices on the knots: positions, velocities, accelerations at any time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Spline:
    """Twice continuously differentiable; its velocity is 0 at the first and the last knot."""

    def __init__(self, times: Array):
        """`times` (k,) s, strictly increasing, k ≥ 2."""
        self.times = times
        k, h = len(times), np.diff(times)
        # Slopes s of the knots' values y: s₀ = s_k = 0, and the second derivative goes on smoothly at each knot between.
        left, right = np.eye(k), np.zeros((k, k))
        for i in range(1, k - 1):
            left[i, i - 1 : i + 2] = 1 / h[i - 1], 2 / h[i - 1] + 2 / h[i], 1 / h[i]
            right[i, i - 1 : i + 2] = -3 / h[i - 1] ** 2, 3 / h[i - 1] ** 2 - 3 / h[i] ** 2, 3 / h[i] ** 2
        self.velocity = np.linalg.solve(left, right)
        """(k, k): velocities at the knots for values there"""
        self.acceleration = self.at(times, 2)
        """(k, k)"""

    def at(self, when: Array, derivative: int = 0) -> Array:
        """(n, k): values (or their first or second derivative) at times (n,) for values at the knots; beyond the ends at rest."""
        when = np.clip(when, self.times[0], self.times[-1])
        piece = np.clip(np.searchsorted(self.times, when, "right") - 1, 0, len(self.times) - 2)
        h = np.diff(self.times)[piece]
        u = (when - self.times[piece]) / h
        if derivative == 0:
            ends, slopes = (
                ((1 + 2 * u) * (1 - u) ** 2, u * u * (3 - 2 * u)),
                (u * (1 - u) ** 2 * h, u * u * (u - 1) * h),
            )
        elif derivative == 1:
            ends, slopes = (6 * u * (u - 1) / h, 6 * u * (1 - u) / h), ((1 - u) * (1 - 3 * u), u * (3 * u - 2))
        else:
            ends = ((12 * u - 6) / h**2, (6 - 12 * u) / h**2)
            slopes = ((6 * u - 4) / h, (6 * u - 2) / h)
        found = slopes[0][:, None] * self.velocity[piece] + slopes[1][:, None] * self.velocity[piece + 1]
        found[np.arange(len(when)), piece] += ends[0]
        found[np.arange(len(when)), piece + 1] += ends[1]
        return found
