"""What a plan keeps along its way (clearance, residual, margins, torque), and who or what that is about at every sample."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from engines.runs.retrace import hermite
from handrail.messages import PlanSeries
from handrail.robot.model_memory import placements

if TYPE_CHECKING:
    from engines.planning.collision.world import World

Array = NDArray[np.float64]

CLEARANCE, RESIDUAL, TILT, LIMIT_MARGIN, TORQUE_SHARE = "clearance", "residual", "tilt", "limit_margin", "torque_share"
"""m to what is nearest, m and rad between the tool's tip and its goal, rad to the nearest joint limit, share of a torque limit"""
NEAR = 0.15
"""m: clearances beyond this are told as this"""
_SPACING, _TOLD = 0.006, 10
"""rad (m) between two postures of a motion in the joint that moves most; of so many one is told, all about the nearest"""
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


class Gauge:
    """Measures motions of a world's moving joints (m), the others standing still. Not for several threads at once."""

    def __init__(self, world: World):
        self._world, self._moving = world, world.moving
        mechanism = world.mechanism
        self._rows = [mechanism.row(joint) for joint in self._moving]
        self._model, self._data = mechanism.model, mechanism.model.createData()
        self._scratch = world.geometry.createData()
        self._placed = placements(self._scratch.oMg) if len(self._scratch.oMg) else np.empty((0, 12))

    def forget(self) -> None:
        """As if it had not measured anything yet."""
        self._world.forget(self._scratch)

    def motion(
        self, at: Array, times: Array, positions: Array, velocities: Array, torque: Array, going: Callable[[], None]
    ) -> tuple[Measure, Measure, Measure]:
        """Clearance, margin to the joint limits and share of `torque` (m,) N·m along knots (k,) s, (k, m) rad, (k, m) rad/s.

        The others stand where they are at `at` (nq,). `going` is called between clearances and may raise.
        """
        looks = _spaced(times, positions)
        way = hermite(times, positions, velocities, looks)
        return (
            self._clearances(looks, self._whole(at, way), going),
            self._limit_margins(looks, way),
            self._torque_shares(times, self._whole(at, positions), velocities, torque),
        )

    def _whole(self, at: Array, way: Array) -> Array:
        q = np.repeat(at[None], len(way), axis=0)
        q[:, self._world.mechanism.coordinate[self._rows]] = way
        return q

    def _limit_margins(self, times: Array, way: Array) -> Measure:
        mechanism = self._world.mechanism
        room = np.minimum(way - mechanism.lower[self._rows], mechanism.upper[self._rows] - way)
        about = tuple(self._moving[joint] for joint in room.argmin(axis=1))
        return Measure(LIMIT_MARGIN, times, room.min(axis=1), about)

    def _torque_shares(self, times: Array, q: Array, velocities: Array, limit: Array) -> Measure:
        """Of the joint that works hardest, at every knot, by inverse dynamics."""
        rates = np.gradient(velocities, times, axis=0)
        velocity, acceleration = np.zeros(self._model.nv), np.zeros(self._model.nv)
        shares = np.empty(velocities.shape)
        for number, one in enumerate(q):
            velocity[self._rows], acceleration[self._rows] = velocities[number], rates[number]
            needed = pin.rnea(self._model, self._data, one, velocity, acceleration)[self._rows]
            shares[number] = np.abs(needed) / limit
        about = tuple(self._moving[joint] for joint in shares.argmax(axis=1))
        return Measure(TORQUE_SHARE, times, shares.max(axis=1), about)

    def _clearances(self, times: Array, q: Array, going: Callable[[], None]) -> Measure:
        """The smallest distances at every _TOLD-th of (k, nq), up to NEAR, and at all about the least."""
        told: dict[int, tuple[float, str]] = {}
        for number in (*range(0, len(q), _TOLD), len(q) - 1):
            going()
            told[number] = self._nearest(q[number])
        least = min(told, key=lambda number: told[number][0])
        for number in range(max(least - _TOLD + 1, 0), min(least + _TOLD, len(q))):
            if number not in told:
                told[number] = self._nearest(q[number])
        numbers = sorted(told)
        distances, about = zip(*(told[number] for number in numbers), strict=True)
        return Measure(CLEARANCE, times[numbers], np.array(distances), about)

    def _nearest(self, q: Array) -> tuple[float, str]:
        """The smallest distance at (nq,), at most NEAR, and between whom."""
        world = self._world
        pin.forwardKinematics(self._model, self._data, q)
        pin.updateGeometryPlacements(self._model, self._data, world.geometry, self._scratch)
        turned = self._placed[:, :9].reshape(-1, 3, 3).transpose(0, 2, 1)  # kept by columns
        balls = np.einsum("bij,bj->bi", turned, world.centres) + self._placed[:, 9:]
        first, second = world.pairs.T
        gaps = np.linalg.norm(balls[first] - balls[second], axis=1) - world.radii[first] - world.radii[second]
        here, which = NEAR, -1
        for pair in np.argsort(gaps).tolist():
            if gaps[pair] >= here:
                break
            distance = pin.computeDistance(world.geometry, self._scratch, pair).min_distance
            if not distance >= here:
                here, which = float(distance), pair
        return here, world.between(which) if which >= 0 else ""


def _spaced(times: Array, positions: Array) -> Array:
    """(j,) s, about _SPACING from one another as the joint that moves most goes, however slowly; both ends."""
    gone = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(positions, axis=0)).max(axis=1))])
    at = np.interp(np.linspace(0.0, gone[-1], max(int(np.ceil(gone[-1] / _SPACING)), 1) + 1), gone, times)
    at[0], at[-1] = times[0], times[-1]
    return np.asarray(at)
