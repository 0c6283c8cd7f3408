"""The torque that a motion needs of the whole robot: what carries it, friction, and what accelerates it.

Inverse dynamics along a path q(s) with derivatives q' and q″ by s, Bobrow, Dubowsky and Gibson (1985):
τ = M q' s̈ + (M q″ + C(q, q') q') ṡ² + g + F sign(q'), linear in s̈ and ṡ².
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from handrail.robot.description import RobotDescription

Array = NDArray[np.float64]

TORQUE_SHARE = 0.9
"""of the torque limits that weight, friction and acceleration may take together"""
FELT = 1e-6
"""N·m: a joint that a motion adds less to is none of its business"""


class Dynamics(Protocol):
    """Of a robot whose base is held (`Kinematics`), or that stands (`StandingDynamics`)."""

    @property
    def description(self) -> RobotDescription: ...
    def gravity(self, position: Array) -> Array: ...
    def inverse_dynamics(self, positions: Array, velocities: Array, accelerations: Array) -> Array: ...


class PathTorque:
    """Of one robot, of which some joints move while all others stand."""

    def __init__(self, dynamics: Dynamics, rows: NDArray[np.int64], position: Array, share: float):
        """`rows` (m,) that move; `position` (n,) rad, where the others stand; `share`: of the torque limits that may be used."""
        self._dynamics, self._rows, self._position = dynamics, rows, position.copy()
        description = dynamics.description
        self.joints = description.joints
        self.limit = share * description.torque_limit
        """(n,) N·m that may be used, all joints'"""
        self._friction = np.array([actuator.friction for actuator in description.actuators])

    def needed(self, q: Array, velocity: Array, acceleration: Array) -> tuple[Array, Array]:
        """Of (k, m) rad, rad/s, rad/s²: (k, n) N·m that the motion takes; (k, n) N·m against gravity and friction on top."""
        spread = np.zeros((3, len(q), len(self._position)))
        spread[0] = self._position
        spread[:, :, self._rows] = q, velocity, acceleration
        still = np.array([self._dynamics.gravity(row) for row in spread[0]])
        moving = self._dynamics.inverse_dynamics(*spread) - still
        still[:, self._rows] += self._friction[self._rows] * np.sign(velocity)
        return moving, still

    def whole(self, q: Array, velocity: Array, acceleration: Array) -> Array:
        """(k, m) N·m of those that move, for all of it: weight, friction and acceleration. (k, m) rad, rad/s, rad/s²."""
        moving, still = self.needed(q, velocity, acceleration)
        return (moving + still)[:, self._rows]

    def along(self, q: Array, slope: Array, curvature: Array) -> tuple[Array, Array, Array, NDArray[np.int64]]:
        """(a, b, c, joints): τ = a s̈ + b ṡ² + c, each (k, j) N·m, of those joints (j,) that feel the motion."""
        a, _ = self.needed(q, np.zeros_like(slope), slope)
        b, c = self.needed(q, slope, curvature)
        felt = np.flatnonzero((np.abs(a) + np.abs(b)).max(axis=0) > FELT)
        return a[:, felt], b[:, felt], c[:, felt], felt
