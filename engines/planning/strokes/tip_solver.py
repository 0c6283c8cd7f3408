"""Inverse kinematics of a pointing tool: the tip's position and the tool's axis (five degrees of freedom), joint limits as bounds.

Damped Gauss-Newton on position, axis and a weak pull to a reference posture; joints at a bound that the step would cross leave the
step (an active set), so that the others make up for them. The pull to the posture resolves the chain's redundancy the same way for
neighbouring targets, which is what keeps a path on one branch. Nothing is random: same question, same answer.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from engines.planning.strokes.chain import Chain, chain_of, tip_of
from engines.planning.strokes.halton import halton
from handrail.compiled import compiled
from handrail.robot.description import Arm
from handrail.robot.kinematics import Kinematics

Array = NDArray[np.float64]

_AXIS_WEIGHT = 0.12
"""m/rad: how much a metre of position weighs against a radian of axis; about the length of a tool"""
_POSTURE_WEIGHT = 0.012
"""m/rad of the pull to the reference posture: a radian off costs as much as 12 mm of tip, squared a ten-thousandth of it"""
_TORSO_FACTOR = 3.5
"""joints that carry other arms too are moved that much less willingly"""
_COLD, _WARM = 150, 25
"""iterations: from a start somewhere, from a neighbouring solution"""


@dataclass(frozen=True)
class Reach:
    """Solutions at k targets."""

    q: Array
    """(k, m) rad"""
    residual: Array
    """(k,) m, distance of the tip from its target"""
    tilt: Array
    """(k,) rad, angle between the tool and its wanted axis"""


class TipSolver:
    """Solves for one arm. `margin` rad are kept from every joint limit."""

    def __init__(self, kinematics: Kinematics, arm: Arm, *, margin: float = 0.03):
        description = kinematics.description
        self.chain: Chain = chain_of(kinematics, arm)
        rows = description.index(arm.joints)
        self.lower = description.lower[rows] + margin
        self.upper = description.upper[rows] - margin
        others = {joint for other in description.arms.values() if other.name != arm.name for joint in other.joints}
        self._weights = np.array([_POSTURE_WEIGHT * (_TORSO_FACTOR if j in others else 1.0) for j in arm.joints])

        # Compiled (or read from numba's cache) now, not in the middle of the first plan.
        middle = (self.lower + self.upper) / 2
        position, pointing = self.tip(middle)
        self.solve(middle, position, pointing, middle)

    def tip(self, q: Array) -> tuple[Array, Array]:
        """Tip position (3,) m and pointing direction (3,) in the world at q (m,) rad."""
        m = len(q)
        position, pointing = np.empty(3), np.empty(3)
        tip_of(self.chain, np.ascontiguousarray(q), np.empty((m, 3)), np.empty((m, 3)), position, pointing)
        return position, pointing

    def tips(self, q: Array) -> tuple[Array, Array]:
        """Positions (k, 3) and pointing directions (k, 3) at q (k, m)."""
        positions, pointings = zip(*(self.tip(row) for row in q), strict=True)
        return np.array(positions), np.array(pointings)

    def solve(self, start: Array, position: Array, axis: Array, posture: Array) -> Reach:
        """One target (3,), (3,) from a start that may be far away; `posture` (m,) is the reference."""
        return self._many(start[None], position[None], axis[None], posture, _COLD)

    def track(self, start: Array, positions: Array, axes: Array, posture: Array) -> Reach:
        """Targets (k, 3) in order, each from the one before; the first from `start` (m,)."""
        return self._many(start[None], positions, axes, posture, _WARM)

    def solve_each(self, starts: Array, positions: Array, axes: Array, posture: Array) -> Reach:
        """Targets (k, 3), each from its own start (k, m) nearby."""
        return self._many(starts, positions, axes, posture, _WARM)

    def _many(self, starts: Array, positions: Array, axes: Array, posture: Array, iterations: int) -> Reach:
        # Contiguous, because numba would compile anew for other layouts.
        within = np.ascontiguousarray(np.clip(starts, self.lower, self.upper))
        points, directions = np.ascontiguousarray(positions), np.ascontiguousarray(axes)
        reference = np.ascontiguousarray(posture)
        q, residual, tilt = _solve_many(
            self.chain, within, points, directions, reference, self._weights, self.lower, self.upper, iterations
        )
        return Reach(q, residual, tilt)


def starts(near: list[Array], lower: Array, upper: Array, count: int) -> Array:
    """(count, m) deterministic starts: the postures given, then Halton points between them and the joints' ranges.

    A Halton point is drawn towards the first posture given, so that extreme postures come last.
    """
    given = [np.clip(posture, lower, upper) for posture in near]
    points = halton(count, len(lower))
    spread = np.linspace(0.35, 1.0, count)[:, None]
    scattered = given[0] + spread * (lower + points * (upper - lower) - given[0])
    return np.vstack([*given, scattered])[:count]


@compiled
def _solve_many(
    chain: Chain, starts: Array, positions: Array, axes: Array, posture: Array, weights: Array, lower: Array,
    upper: Array, iterations: int,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Each target from its own start, or from the solution before it once the starts are used up."""
    k, m = positions.shape[0], starts.shape[1]
    q, residual, tilt = np.empty((k, m)), np.empty(k), np.empty(k)
    for i in range(k):
        q[i] = starts[i] if i < starts.shape[0] else q[i - 1]
        residual[i], tilt[i] = _solve(chain, q[i], positions[i], axes[i], posture, weights, lower, upper, iterations)
    return q, residual, tilt


@compiled
def _solve(
    chain: Chain, q: Array, position: Array, axis: Array, posture: Array, weights: Array, lower: Array, upper: Array,
    iterations: int,
) -> tuple[float, float]:  # fmt: skip
    """Moves q (m,) to the target, in place; returns what is left of position (m) and axis (rad)."""
    m = q.shape[0]
    origins, directions = np.empty((m, 3)), np.empty((m, 3))
    tip, pointing, error, tilt = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    hessian, gradient, step = np.empty((m, m)), np.empty(m), np.empty(m)
    reference, refined = posture, 0
    for _ in range(iterations):
        tip_of(chain, q, origins, directions, tip, pointing)
        _errors(tip, pointing, position, axis, error, tilt)
        _normal_equations(origins, directions, tip, pointing, error, tilt, hessian, gradient)
        for j in range(m):
            hessian[j, j] += weights[j] ** 2 + 1e-6
            gradient[j] += weights[j] ** 2 * (reference[j] - q[j])
        _bounded_step(hessian, gradient, q, lower, upper, step)
        largest = 0.0
        for j in range(m):
            largest = max(largest, abs(step[j]))
        for j in range(m):
            q[j] = min(max(q[j] + step[j] * min(1.0, 0.4 / max(largest, 1e-9)), lower[j]), upper[j])
        if largest < 1e-4:
            if refined == 2:
                break
            # Near the least of both costs the pull still biases the tip by a millimetre. Pulling to where we are instead
            # takes the bias away along the shortest way, so that neighbours stay neighbours.
            refined += 1
            reference = q.copy()
    tip_of(chain, q, origins, directions, tip, pointing)
    left, cosine = 0.0, 0.0
    for a in range(3):
        left += (position[a] - tip[a]) ** 2
        cosine += pointing[a] * axis[a]
    return np.sqrt(left), np.arccos(min(1.0, max(-1.0, cosine)))


@compiled
def _errors(tip: Array, pointing: Array, position: Array, axis: Array, error: Array, tilt: Array) -> None:
    """The tip's way to its target and the rotation to its axis (3,), cut to what a linear step is good for."""
    far, turn, cosine = 0.0, 0.0, 0.0
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        error[a] = position[a] - tip[a]
        tilt[a] = pointing[b] * axis[c] - pointing[c] * axis[b]
        far += error[a] ** 2
        turn += tilt[a] ** 2
        cosine += pointing[a] * axis[a]
    far, turn = np.sqrt(far), np.sqrt(turn)
    for a in range(3):
        if far > 0.12:  # about a hand's breadth
            error[a] *= 0.12 / far
        if cosine < 0.0:  # beyond 90° the sine shrinks again: turn on at full speed
            tilt[a] /= max(turn, 1e-6)


@compiled
def _normal_equations(
    origins: Array, directions: Array, tip: Array, pointing: Array, error: Array, tilt: Array, hessian: Array,
    gradient: Array,
) -> None:  # fmt: skip
    """JᵀJ and Jᵀe of position and axis. Rotation about the tool itself is left free: it is projected out."""
    m = origins.shape[0]
    moving, turning = np.empty((m, 3)), np.empty((m, 3))
    for j in range(m):
        about = directions[j, 0] * pointing[0] + directions[j, 1] * pointing[1] + directions[j, 2] * pointing[2]
        for a in range(3):
            b, c = (a + 1) % 3, (a + 2) % 3
            arm_b, arm_c = tip[b] - origins[j, b], tip[c] - origins[j, c]
            moving[j, a] = directions[j, b] * arm_c - directions[j, c] * arm_b
            turning[j, a] = _AXIS_WEIGHT * (directions[j, a] - pointing[a] * about)
    for i in range(m):
        gradient[i] = 0.0
        for a in range(3):
            gradient[i] += moving[i, a] * error[a] + turning[i, a] * _AXIS_WEIGHT * tilt[a]
        for j in range(i + 1):
            total = 0.0
            for a in range(3):
                total += moving[i, a] * moving[j, a] + turning[i, a] * turning[j, a]
            hessian[i, j] = total
            hessian[j, i] = total


@compiled
def _bounded_step(hessian: Array, gradient: Array, q: Array, lower: Array, upper: Array, step: Array) -> None:
    """The Newton step of the joints that are not pushed into their bounds; the others stand still."""
    m = q.shape[0]
    free = np.ones(m, np.bool_)
    factor = np.empty((m, m))
    for _ in range(4):
        for i in range(m):  # Cholesky, a blocked joint's row and column replaced by the identity's
            for j in range(i + 1):
                total = hessian[i, j] if free[i] and free[j] else (1.0 if i == j else 0.0)
                for k in range(j):
                    total -= factor[i, k] * factor[j, k]
                factor[i, j] = np.sqrt(total) if i == j else total / factor[j, j]
        for i in range(m):
            step[i] = gradient[i] if free[i] else 0.0
            for k in range(i):
                step[i] -= factor[i, k] * step[k]
            step[i] /= factor[i, i]
        for i in range(m - 1, -1, -1):
            for k in range(i + 1, m):
                step[i] -= factor[k, i] * step[k]
            step[i] /= factor[i, i]
        more = False
        for j in range(m):
            at_upper = q[j] >= upper[j] - 1e-9 and step[j] > 0.0
            at_lower = q[j] <= lower[j] + 1e-9 and step[j] < 0.0
            if free[j] and (at_upper or at_lower):
                free[j] = False
                more = True
        if not more:
            break
