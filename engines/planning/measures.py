"""What a plan keeps along its way (clearance, residual, margins, torque), and who or what that is about at every sample."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from handrail.messages import PlanSeries

Array = NDArray[np.float64]

CLEARANCE, RESIDUAL, TILT, LIMIT_MARGIN, TORQUE_SHARE = "clearance", "residual", "tilt", "limit_margin", "torque_share"
"""m to what is nearest, m and rad between the tool's tip and its goal, rad to the nearest joint limit, share of a torque limit"""
_LEAST_IS_WORST = frozenset({CLEARANCE, LIMIT_MARGIN})


@dataclass(frozen=True)
class Worst:
    """A measure's worst sample."""

    value: float
    time: float
    """s"""
    about: str


@dataclass(frozen=True)
class Measure:
    """One figure along a way."""

    name: str
    times: Array
    """(k,) s, not decreasing, at least one"""
    values: Array
    """(k,)"""
    about: tuple[str, ...] = ()
    """(k,) the joint, or the two bodies, that each value is about; empty: nothing in particular"""

    def shifted(self, by: float) -> Measure:
        """The same later, s."""
        return Measure(self.name, self.times + by, self.values, self.about)

    def within(self, begin: float, end: float) -> Measure | None:
        """Its samples from `begin` to `end`, s; None where there are none."""
        rows = np.flatnonzero((self.times >= begin - 1e-9) & (self.times <= end + 1e-9))
        if not len(rows):
            return None
        about = tuple(self.about[row] for row in rows) if self.about else ()
        return Measure(self.name, self.times[rows], self.values[rows], about)

    def worst(self) -> Worst:
        """The worst sample, the first of equal ones."""
        row = int(self.values.argmin() if self.name in _LEAST_IS_WORST else self.values.argmax())
        return Worst(float(self.values[row]), float(self.times[row]), self.about[row] if self.about else "")

    def series(self) -> PlanSeries:
        """As clients get it, in figures that they can tell apart (10 µm, 10 µrad, 1 ms)."""
        names = list(dict.fromkeys(self.about))
        number = {name: row for row, name in enumerate(names)}
        return PlanSeries(
            times=np.round(self.times, 3).tolist(),
            values=np.round(self.values, 5).tolist(),
            names=names,
            which=[number[name] for name in self.about],
        )


def joined(parts: Iterable[Sequence[Measure]], starts: Sequence[float]) -> dict[str, Measure]:
    """name → measure over a whole plan, from the measures of its segments, which begin at `starts` s."""
    found: dict[str, list[Measure]] = {}
    for measures, start in zip(parts, starts, strict=True):
        for measure in measures:
            found.setdefault(measure.name, []).append(measure.shifted(start))
    return {
        name: Measure(
            name,
            np.concatenate([piece.times for piece in pieces]),
            np.concatenate([piece.values for piece in pieces]),
            tuple(one for piece in pieces for one in piece.about) if all(piece.about for piece in pieces) else (),
        )
        for name, pieces in found.items()
    }


def limit_margins(joints: Sequence[str], times: Array, q: Array, lower: Array, upper: Array) -> Measure:
    """rad (m), over a motion's (k,) s and (k, m): to the nearest of the limits (m,), and of which joint.

    A joint that turns without end is told as though it had half a turn left: what clients are told are numbers.
    """
    room = np.minimum(q - lower, upper - q)
    room[~np.isfinite(room)] = np.pi
    return Measure(LIMIT_MARGIN, times, room.min(axis=1), tuple(joints[row] for row in room.argmin(axis=1)))


def torque_shares(joints: Sequence[str], times: Array, torques: Array, limit: Array) -> Measure:
    """Share of its limit (m,) N·m that the hardest worked joint needs, over (k,) s and (k, m) N·m, and which joint that is."""
    shares = np.abs(torques) / limit
    return Measure(TORQUE_SHARE, times, shares.max(axis=1), tuple(joints[row] for row in shares.argmax(axis=1)))


def times_of(path: Array, times: Array, positions: Array) -> Array:
    """(k,) s at which a timed motion along a path passes the path's rows (k, m): as far along it in joint space, in share.

    `times` (j,) s and `positions` (j, m) rad: the motion's knots. A path that goes nowhere is passed evenly.
    """
    way, done = _lengths(path), _lengths(positions)
    if way[-1] < 1e-9 or done[-1] < 1e-9:
        return np.linspace(times[0], times[-1], len(path))
    passed = np.interp(way / way[-1], done / done[-1], times)
    passed[0] = times[0]  # a motion may wait at its start: `interp` takes the last of equal shares
    return np.asarray(passed)


def _lengths(path: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
