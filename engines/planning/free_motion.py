"""A free way from one posture to another: the straight line in joint space where it is clear, else RRT-Connect.

The random tree's seed is fixed, and its end is counted in nodes, not in seconds: same question, same answer.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Clear = Callable[[Array], bool]
"""says whether postures (k, m) rad keep all clearances"""

SPACING = 0.06
"""rad between the postures that are checked on an edge, in the joint that moves most"""
_STEP = 0.4
"""rad that a tree grows at once"""
_MOST_NODES = 1500
_SHORTCUTS = 30


def free_way(start: Array, goal: Array, lower: Array, upper: Array, clear: Clear) -> Array | None:
    """(k, m) rad from start to goal, close together; None when there is no clear way or none was found."""
    direct = _between(start, goal)
    if _all_clear(direct, clear):
        return direct
    if not clear(start[None]) or not clear(goal[None]):
        return None
    generator = np.random.default_rng(0)
    corners = _connect(start, goal, lower, upper, clear, generator)
    if corners is None:
        return None
    return _rounded(_shortened(corners, clear, generator), clear)


def _between(a: Array, b: Array) -> Array:
    count = max(2, int(np.ceil(np.abs(b - a).max() / SPACING)) + 1)
    return a + np.linspace(0.0, 1.0, count)[:, None] * (b - a)


def _all_clear(way: Array, clear: Clear) -> bool:
    """Every fourth posture first: a way that is not clear mostly shows it soon."""
    return all(clear(way[first::4]) for first in (2, 0, 1, 3) if len(way) > first)


def _through(corners: list[Array]) -> Array:
    pieces = [_between(a, b)[1:] for a, b in pairwise(corners)]
    return np.vstack([corners[0][None], *pieces])


class _Tree:
    def __init__(self, root: Array):
        self.nodes, self.parents = [root], [-1]

    def nearest(self, target: Array) -> int:
        return int(np.linalg.norm(np.array(self.nodes) - target, axis=1).argmin())

    def extend(self, target: Array, clear: Clear) -> int | None:
        """The number of a new node one step towards the target, None when the way there is not clear."""
        near = self.nearest(target)
        way = target - self.nodes[near]
        length = float(np.linalg.norm(way))
        new = target if length <= _STEP else self.nodes[near] + way * (_STEP / length)
        if not _all_clear(_between(self.nodes[near], new)[1:], clear):
            return None
        self.nodes.append(new)
        self.parents.append(near)
        return len(self.nodes) - 1

    def to_root(self, node: int) -> list[Array]:
        way = []
        while node >= 0:
            way.append(self.nodes[node])
            node = self.parents[node]
        return way


def _connect(
    start: Array, goal: Array, lower: Array, upper: Array, clear: Clear, generator: np.random.Generator
) -> list[Array] | None:
    """Corners of a clear way by two trees that grow towards each other (Kuffner and LaValle, 2000)."""
    one, other = _Tree(start), _Tree(goal)
    # Ways around an object rarely lead far: sample about the box that both postures span.
    low = np.maximum(np.minimum(start, goal) - 1.0, lower)
    high = np.minimum(np.maximum(start, goal) + 1.0, upper)
    for _ in range(_MOST_NODES):
        grown = one.extend(generator.uniform(low, high), clear)
        if grown is not None:
            target = one.nodes[grown]
            while (reached := other.extend(target, clear)) is not None:
                if other.nodes[reached] is target:
                    way = [*reversed(one.to_root(grown)), *other.to_root(reached)[1:]]
                    return way if way[0] is start else way[::-1]
        one, other = other, one
    return None


def _shortened(corners: list[Array], clear: Clear, generator: np.random.Generator) -> list[Array]:
    for _ in range(_SHORTCUTS):
        if len(corners) < 3:
            break
        i, j = sorted(generator.choice(len(corners), 2, replace=False))
        if j - i > 1 and _all_clear(_between(corners[i], corners[j]), clear):
            corners = [*corners[: i + 1], *corners[j:]]
    return corners


def _rounded(corners: list[Array], clear: Clear) -> Array:
    """Corners rounded by a moving average along the way, as far as that stays clear."""
    way = _through(corners)
    for width in (9, 5, 3):
        padded = np.pad(way, ((width // 2, width // 2), (0, 0)), mode="edge")
        smooth = np.column_stack([np.convolve(column, np.ones(width) / width, "valid") for column in padded.T])
        smooth[0], smooth[-1] = way[0], way[-1]
        if _all_clear(smooth, clear):
            return smooth
    return way
