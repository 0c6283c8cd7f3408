"""The clearance that a timed motion keeps along its way, told close together only where it is least."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from engines.planning.collision.sweep import Sweep
from engines.planning.measures import CLEARANCE, Measure
from engines.planning.waiting import go_on

Array = NDArray[np.float64]

NEAR = 0.15
"""m: clearances beyond this are told as this"""
_SPACING, _TOLD = 0.006, 10
"""rad (m) between two postures of a motion in the joint that moves most; of so many one is told, all about the nearest"""


def looks(times: Array, positions: Array) -> Array:
    """(j,) s, close together as the joint that moves most goes along knots (k,) s, (k, m) rad, however slowly; both ends."""
    gone = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(positions, axis=0)).max(axis=1))])
    at = np.interp(np.linspace(0.0, gone[-1], max(int(np.ceil(gone[-1] / _SPACING)), 1) + 1), gone, times)
    at[0], at[-1] = times[0], times[-1]
    return np.asarray(at)


def clearances(sweep: Sweep, times: Array, q: Array, cancelled: Callable[[], bool]) -> Measure:
    """The smallest distances at every _TOLD-th of (k, nq), up to NEAR, and at all about the least.

    `times` (k,) s; `cancelled` is asked before each look. Raises Cancelled.
    """
    told: dict[int, tuple[float, str]] = {}

    def look(number: int) -> None:
        go_on(cancelled)
        nearest = sweep.nearest(q[number], within=NEAR)
        told[number] = nearest.distance, nearest.between

    for number in (*range(0, len(q), _TOLD), len(q) - 1):
        look(number)
    least = min(told, key=lambda number: told[number][0])
    for number in range(max(least - _TOLD + 1, 0), min(least + _TOLD, len(q))):
        if number not in told:
            look(number)
    numbers = sorted(told)
    distances, about = zip(*(told[number] for number in numbers), strict=True)
    return Measure(CLEARANCE, times[numbers], np.array(distances), about)
