"""The last word before a plan leaves the planner: all that it promises, measured anew on its knots, by code that found none of it.

Limits are exact on the cubic pieces between knots; goals are measured by `ik.checker`; clearances by coal at postures ten times as
close as planning looks, of all pairs whose balls are near.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from engines.planning.broad_phase import BroadPhase
from engines.planning.ik.checker import ANGLE, LENGTH, Checker, missed
from engines.planning.ik.constraints import Constraint
from engines.planning.ik.report import Measure as Missed
from engines.planning.measures import CLEARANCE, LIMIT_MARGIN, TORQUE_SHARE, Measure
from engines.planning.plan import Cancelled, Infeasible
from engines.planning.timing import Knots, Limits, accelerations, peak_velocities
from engines.planning.world import World
from engines.retrace import hermite
from handrail.robot.model_memory import placements

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

SPACING = 0.006
"""rad (m) between two postures that are looked at, in the joint that moves most: a tenth of what planning looks at"""
BETWEEN = 20.0
"""times as much as at knots may be missed of what is kept along the way"""
_ROUNDING = 1e-3
"""of a velocity or acceleration limit"""
TOLD = 10
"""rows of which one is told"""
NEAR = 0.15
"""m: clearances beyond this are told as this"""


@dataclass(frozen=True)
class Verified:
    """What was measured along the way."""

    clearance: Measure
    """m, and between which bodies; at most NEAR"""
    limit_margin: Measure
    """rad, and of which joint"""

    @property
    def measures(self) -> tuple[Measure, ...]:
        return self.clearance, self.limit_margin


class Verifier:
    """For one world. Not for several threads at once."""

    def __init__(self, world: World, checker: Checker):
        self._world, self._checker = world, checker
        mechanism = world.mechanism
        self._model, self._data = mechanism.model, mechanism.model.createData()
        self._scratch = world.geometry.createData()
        self._placed = placements(self._scratch.oMg) if len(self._scratch.oMg) else np.empty((0, 12))

    def verify(
        self, knots: Knots, whole: Callable[[Array], Array], rows: Integers, limits: Limits, goals: Sequence[Constraint],
        keep: Sequence[Constraint], at_least: float, *, where: str, cancelled: Callable[[], bool],
    ) -> Verified:  # fmt: skip
        """Raises Infeasible with the first promise that is not kept, Cancelled as asked.

        :param knots: of the m coordinates that move
        :param whole: (k, m) → (k, nq)
        :param rows: (m,) of those coordinates in q
        :param goals: hold at the last knot
        :param keep: hold all the way
        :param at_least: m of clearance
        """
        self._rates(knots, limits, where)
        times = _close(knots)
        q = whole(hermite(knots.times, knots.positions, knots.velocities, times))
        margins = self._margins(times, q, rows)
        if not (worst := margins.worst()).value >= -LENGTH:
            raise Infeasible("joint limits", -worst.value, "rad", where, f"({worst.about}) on the way")
        self._refuse(self._checker.violations(goals, q[-1]), where)
        if keep:
            for one in q[::4]:
                loose = [m for m in self._checker.measures(keep, one) if m.by > BETWEEN * _tolerated(m)]
                self._refuse(missed(loose), f"{where}, on the way")
        clearances = self._clearance(times, q, at_least, cancelled)
        if not (worst := clearances.worst()).value >= at_least - LENGTH:
            raise Infeasible(
                "clearance",
                at_least - worst.value,
                "m",
                where,
                f"({worst.about}) is {worst.value:.3g} m, at least {at_least:g} allowed",
            )
        return Verified(clearances, margins)

    def torques(
        self, knots: Knots, whole: Callable[[Array], Array], rows: Integers, limit: Array, where: str
    ) -> Measure:
        """The share of its limit (m,) N·m that the joint needs that works hardest, at every knot, by inverse dynamics.

        Raises Infeasible where that is more than there is.
        """
        mechanism = self._world.mechanism
        columns = np.array([int(np.flatnonzero(mechanism.coordinate == row)[0]) for row in rows])
        rates = np.gradient(knots.velocities, knots.times, axis=0)
        velocity, acceleration = np.zeros(mechanism.nv), np.zeros(mechanism.nv)
        shares = np.empty(knots.positions.shape)
        for number, q in enumerate(whole(knots.positions)):
            velocity[columns], acceleration[columns] = knots.velocities[number], rates[number]
            shares[number] = np.abs(pin.rnea(self._model, self._data, q, velocity, acceleration)[columns]) / limit
        names = dict(zip(mechanism.q_rows.tolist(), mechanism.joints, strict=True))
        about = tuple(names[int(rows[joint])] for joint in shares.argmax(axis=1))
        found = Measure(TORQUE_SHARE, knots.times, shares.max(axis=1), about)
        if not (worst := found.worst()).value <= 1.0:
            raise Infeasible("joint torque", worst.value - 1.0, "of its limit", where, f"({worst.about})")
        return found

    def _margins(self, times: Array, q: Array, rows: Integers) -> Measure:
        mechanism = self._world.mechanism
        low, high = mechanism.model.lowerPositionLimit[rows], mechanism.model.upperPositionLimit[rows]
        room = np.minimum(q[:, rows] - low, high - q[:, rows])
        names = dict(zip(mechanism.q_rows.tolist(), mechanism.joints, strict=True))
        about = tuple(names[int(rows[joint])] for joint in room.argmin(axis=1))
        return Measure(LIMIT_MARGIN, times, room.min(axis=1), about)

    @staticmethod
    def _rates(knots: Knots, limits: Limits, where: str) -> None:
        if not all(np.isfinite(part).all() for part in (knots.times, knots.positions, knots.velocities)):
            raise Infeasible("finite numbers", 0.0, "rad", where)
        fast = float((peak_velocities(knots) - (1 + _ROUNDING) * limits.velocity).max())
        if fast > 0.0:
            raise Infeasible("velocity limits", fast, "rad/s", where)
        hard = float((np.abs(accelerations(knots)) - (1 + _ROUNDING) * limits.acceleration).max())
        if hard > 0.0:
            raise Infeasible("acceleration limits", hard, "rad/s²", where)

    @staticmethod
    def _refuse(violations: Sequence[Missed], where: str) -> None:
        if violations:
            worst = violations[0]
            raise Infeasible(
                worst.constraint, worst.by, worst.unit, where, f"({worst.what}) is {worst.value:.3g} {worst.unit}"
            )

    def _clearance(self, times: Array, q: Array, at_least: float, cancelled: Callable[[], bool]) -> Measure:
        """The smallest distances at every TOLD-th of (k, nq), up to NEAR, at all about the least, and at the first too near."""
        broad = BroadPhase(self._world, np.full(len(self._world.pairs), at_least - LENGTH))
        told: dict[int, tuple[float, str]] = {}
        for number, row in enumerate(q):
            if cancelled():
                raise Cancelled("planning was cancelled")
            if number % TOLD == 0 or number == len(q) - 1:
                told[number] = self._nearest(row)
            elif broad.met(row):
                told[number] = self._nearest(row)
                break
        least = min(told, key=lambda number: told[number][0])
        for number in range(max(least - TOLD + 1, 0), min(least + TOLD, len(q))):
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


def _close(knots: Knots) -> Array:
    """(k,) s between which no joint moves by more than SPACING, both ends among them."""
    step = np.abs(np.diff(knots.positions, axis=0)).max(axis=1)
    counts = np.maximum(np.ceil(step / SPACING), 1).astype(int)
    # Knots that hardly move are passed over: as many as stay within one step of the last that was looked at.
    ends, gone = [0], 0.0
    for number, length in enumerate(step.tolist(), 1):
        gone += length
        if gone > 0.5 * SPACING or number == len(step):
            ends.append(number)
            gone = 0.0
    times: list[Array] = [knots.times[:1]]
    for before, after in pairwise(ends):
        count = int(counts[before:after].max())
        times.append(np.linspace(knots.times[before], knots.times[after], count + 1)[1:])
    return np.concatenate(times)


def _tolerated(m: Missed) -> float:
    return ANGLE if m.unit == "rad" else LENGTH
