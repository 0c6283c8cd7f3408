"""Inverse kinematics of a pointing tool: the tip's position and the tool's axis (five degrees of freedom), within joint limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from engines.planning.ik.constraints import Direction, JointLimits, Position
from engines.planning.ik.follower import COLD, WARM, Follower
from engines.planning.ik.mechanism import Mechanism
from engines.planning.strokes.halton import halton
from handrail.robot.description import Arm, RobotDescription

Array = NDArray[np.float64]

POINTING = (0.0, 0.0, -1.0)
"""where a tool points, in its tip's frame"""
_TORSO_FACTOR = 3.5
"""joints that carry other arms too are moved that much less willingly"""


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

    def __init__(self, mechanism: Mechanism, description: RobotDescription, arm: Arm, *, margin: float = 0.03,
        pointing: float = 1.0,
    ):  # fmt: skip
        """`pointing`: what the tool's axis counts for against its tip, as a factor.

        Raises ValueError when other joints than the arm's move its tip.
        """
        at_goal = Position.at(arm.tip, (0.0, 0.0, 0.0))
        along = Direction(frame=arm.tip, axis=POINTING, direction=(0.0, 0.0, 1.0))
        others = {joint for other in description.arms.values() if other.name != arm.name for joint in other.joints}
        try:
            self._follower = Follower(
                mechanism,
                [at_goal, along, JointLimits(margin=margin, joints=arm.joints)],
                arm.joints,
                {joint: _TORSO_FACTOR for joint in arm.joints if joint in others},
                (1.0, pointing, 1.0),
            )
        except ValueError as problem:
            raise ValueError(f"arm {arm.name}: {problem}") from None
        self._joint, self._tip = mechanism.place(arm.tip)
        self.lower, self.upper = self._follower.lower, self._follower.upper
        # Compiled (or read from numba's cache) now, not in the middle of the first plan.
        middle = (self.lower + self.upper) / 2
        position, axis = self.tip(middle)
        self.solve(middle, position, axis, middle)

    def tip(self, q: Array) -> tuple[Array, Array]:
        """Tip position (3,) m and pointing direction (3,) in the world at q (m,) rad."""
        positions, pointings = self.tips(q[None])
        return positions[0], pointings[0]

    def tips(self, q: Array) -> tuple[Array, Array]:
        """Positions (k, 3) and pointing directions (k, 3) at q (k, m)."""
        places = self._follower.joint_placements(q)[:, self._joint]
        columns = places[:, :9].reshape(-1, 3, 3)
        return self._tip[9:] @ columns + places[:, 9:], -self._tip[6:9] @ columns

    def solve(self, start: Array, position: Array, axis: Array, posture: Array) -> Reach:
        """One target (3,), (3,) from a start that may be far away; `posture` (m,) is the reference."""
        return self._many(start[None], position[None], axis[None], posture, COLD)

    def track(self, start: Array, positions: Array, axes: Array, posture: Array) -> Reach:
        """Targets (k, 3) in order, each from the one before; the first from `start` (m,)."""
        return self._many(start[None], positions, axes, posture, WARM)

    def solve_each(self, starts: Array, positions: Array, axes: Array, posture: Array) -> Reach:
        """Targets (k, 3), each from its own start (k, m) nearby."""
        return self._many(starts, positions, axes, posture, WARM)

    def _many(self, starts: Array, positions: Array, axes: Array, posture: Array, iterations: int) -> Reach:
        found = self._follower.solve(starts, _goals(positions, axes), posture, iterations)
        return Reach(found.q, found.missed[:, 0], found.missed[:, 1])


def starts(near: list[Array], lower: Array, upper: Array, count: int) -> Array:
    """(count, m) deterministic starts: the postures given, then Halton points between them and the joints' ranges.

    A Halton point is drawn towards the first posture given, so that extreme postures come last.
    """
    given = [np.clip(posture, lower, upper) for posture in near]
    points = halton(count, len(lower))
    spread = np.linspace(0.35, 1.0, count)[:, None]
    scattered = given[0] + spread * (lower + points * (upper - lower) - given[0])
    return np.vstack([*given, scattered])[:count]


def _goals(positions: Array, axes: Array) -> Array:
    """(k, 12) frames at positions (k, 3) whose z is along unit axes (k, 3); how they are turned about it does not matter.

    Directions across as in Duff et al. 2017 (Building an Orthonormal Basis, Revisited).
    """
    goals = np.empty((len(positions), 12))
    goals[:, 6:9], goals[:, 9:] = axes, positions
    x, y, z = axes.T
    sign = np.copysign(1.0, z)
    share = -1.0 / (sign + z)
    both = x * y * share
    goals[:, 0], goals[:, 1], goals[:, 2] = 1.0 + sign * x * x * share, sign * both, -sign * x
    goals[:, 3], goals[:, 4], goals[:, 5] = both, sign + y * y * share, -y
    return goals
