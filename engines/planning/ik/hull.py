"""The convex hull of a few points in the plane."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_AREA = 1e-10
"""m²: points that span less are in line"""


def hull(points: Array) -> tuple[Array, list[int]]:
    """(k, 2) corners anticlockwise and their rows in `points` (n, 2); k < 3 where all are in line.

    Andrew's monotone chain (1979).
    """
    order = sorted(range(len(points)), key=lambda i: (points[i][0], points[i][1]))

    def chain(rows: list[int]) -> list[int]:
        found: list[int] = []
        for i in rows:
            while len(found) > 1 and _turn(points[found[-2]], points[found[-1]], points[i]) <= _AREA:
                found.pop()
            found.append(i)
        return found

    corners = chain(order)[:-1] + chain(order[::-1])[:-1]
    return points[corners], corners


def _turn(a: Array, b: Array, c: Array) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
