"""Measures of postures and ways of one arm: margins, torques, manipulability, clearances (see `constraints`)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from engines.planning import constraints
from engines.planning.collision.bodies import Clearance, CollisionScene
from engines.planning.collision.sweep import Nearest
from engines.planning.constraints import Constraint
from engines.planning.measures import Measure, limit_margins, torque_shares
from engines.planning.strokes.giving import Leeway
from engines.planning.timing.path_torque import TORQUE_SHARE, PathTorque
from handrail.robot.description import Arm
from handrail.robot.kinematics import Kinematics

Array = NDArray[np.float64]


class Assessor:
    """Measures one arm while all other joints stay at `position` (n,) rad."""

    def __init__(
        self, kinematics: Kinematics, arm: Arm, scene: CollisionScene, position: Array, leeway: Leeway | None = None
    ):
        """`leeway`: what its tip's goals are bounded by, where it is not what a stroke keeps unasked."""
        self._kinematics, self._scene = kinematics, scene
        self.leeway = leeway or Leeway()
        description = kinematics.description
        self.arm = arm
        self.rows = description.index(arm.joints)
        self.start = position[self.rows].copy()
        self._position = position.copy()
        self._lower, self._upper = description.lower[self.rows], description.upper[self.rows]
        others = {joint for other in description.arms.values() if other.name != arm.name for joint in other.joints}
        self._own = np.array([row for row, joint in enumerate(arm.joints) if joint not in others])
        self._torque_limit = description.torque_limit[self.rows]
        self.torque = PathTorque(kinematics, self.rows, position, TORQUE_SHARE)

    def all_joints(self, q: Array) -> Array:
        """(k, n) positions of the whole robot for the arm's (k, m)."""
        positions = np.repeat(self._position[None], len(q), axis=0)
        positions[:, self.rows] = q
        return positions

    def limit_margin(self, q: Array) -> float:
        """rad, the smallest distance of (k, m) to a joint's limit."""
        return float(self.limit_room(q).min())

    def limit_room(self, q: Array) -> Array:
        """(k,) rad, the distance of each of (k, m) to its nearest joint limit."""
        return np.asarray(np.minimum(q - self._lower, self._upper - q).min(axis=1))

    def static(self, q: Array, forces: Array) -> dict[Constraint, float]:
        """The arm's worst torque (share of the limit) and manipulability at (k, m), `forces` (k, 3) N acting on the tip."""
        torque, manipulability = 0.0, np.inf
        for position, force in zip(self.all_joints(q), forces, strict=True):
            jacobian = self._kinematics.jacobian(position, self.arm.tip)[:3, self.rows]
            needed = self._kinematics.gravity(position)[self.rows] - jacobian.T @ force
            torque = max(torque, float((np.abs(needed) / self._torque_limit)[self._own].max()))
            singular = np.linalg.svd(jacobian[:, self._own], compute_uv=False)
            manipulability = min(manipulability, float(singular[-1]))
        return {constraints.TORQUE: torque, constraints.MANIPULABILITY: manipulability}

    def limit_margins(self, times: Array, q: Array) -> Measure:
        """rad, over a motion's (k,) s and (k, m) rad: to the nearest joint limit, and of which joint."""
        return limit_margins(self.arm.joints, times, q, self._lower, self._upper)

    def torque_shares(self, times: Array, q: Array, velocities: Array, forces: Array) -> Measure:
        """Share of its limit that the hardest worked of the arm's joints needs, over a motion's (k,) s, (k, m) rad and rad/s.

        Inverse dynamics and friction, `forces` (k, 3) N acting on the tip; accelerations are the velocities' differences.
        """
        accelerations = np.gradient(velocities, times, axis=0)
        torques = self.torque.whole(q, velocities, accelerations)
        pushed = forces.any(axis=1)
        for row, position in zip(np.flatnonzero(pushed), self.all_joints(q[pushed]), strict=True):
            torques[row] -= self._kinematics.jacobian(position, self.arm.tip)[:3, self.rows].T @ forces[row]
        return torque_shares(self.arm.joints, times, torques, self._torque_limit)

    def clearances(self, q: Array, *, tool_may_touch: bool) -> dict[Constraint, Clearance]:
        """To the template's object and to the robot itself over (k, m)."""
        positions = self.all_joints(q)
        return {
            constraints.CLEARANCE: self._scene.to_obstacles(positions, tool_may_touch=tool_may_touch),
            self._scene.itself: self._scene.to_self(positions),
        }

    def between(self, q: Array, *, tool_may_touch: bool) -> tuple[Constraint, Nearest] | None:
        """Where the way through (k, m) comes too near to something between its rows, if anywhere."""
        return self._scene.between(self.all_joints(q), tool_may_touch=tool_may_touch)

    def way(self, start: Array, goal: Array, cancelled: Callable[[], bool]) -> Array:
        """(k, m) a clear way between two postures of the arm. Raises Infeasible, Cancelled."""
        here, there = self.all_joints(np.array([start, goal]))
        return self._scene.way(here, there, cancelled)[:, self.rows]
