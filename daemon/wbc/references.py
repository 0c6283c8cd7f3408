"""What moves a task's reference from cycle to cycle: a trajectory, or somebody who streams it. A constant one needs nothing.

Trajectories are daemon.references' paths over a path parameter s, with its rate ṡ from the clock that may be slowed down:
ẋ_d = x' ṡ, ẍ_d = (ẋ_d − the last cycle's) / T.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from daemon.references import HermitePath, LinePath, PathClock
from daemon.wbc.handle import Handle
from daemon.wbc.memory import Array


class Reference(Protocol):
    """Writes a task's reference; to be called once a cycle, before `solve`."""

    def advance(self) -> None:
        """One period on."""


class FrameTrajectory:
    """A straight line of a frame's pose, minimum-jerk in time; for CartPos, QuaternionOrientation and SE3."""

    def __init__(self, handle: Handle, path: LinePath, period: float):
        """`period`: of the loop, s."""
        self.clock = PathClock(path.length, period)
        self._handle, self._path, self._period = handle, path, period
        self._velocity = np.zeros(6)

    def advance(self) -> None:
        self.clock.advance()
        rotation, translation, linear, angular = self._path.evaluate(self.clock.s)
        velocity = np.concatenate((linear, angular)) * self.clock.rate
        self._handle.pose(translation, rotation, velocity, (velocity - self._velocity) / self._period)
        self._velocity = velocity


class JointTrajectory:
    """Cubic polynomials through knots of all joints; for JPos."""

    def __init__(self, handle: Handle, path: HermitePath, joints: int, period: float):
        """`joints`: how many, in the order of the model's; `period`: of the loop, s."""
        self.clock = PathClock(path.length, period)
        self._handle, self._path, self._period = handle, path, period
        self._position, self._velocity, self._last = np.zeros(joints), np.zeros(joints), np.zeros(joints)

    def advance(self) -> None:
        self.clock.advance()
        self._path.evaluate(self.clock.s, self._position, self._velocity)
        self._velocity *= self.clock.rate if not self.clock.at_end else 0.0
        self._handle.joints(self._position, self._velocity, (self._velocity - self._last) / self._period)
        self._last[:] = self._velocity


class StreamedPose:
    """A frame's pose as somebody sends it, when it comes; between two, it goes on at the velocity that was sent with it.

    After `stale` s without a new one it stands where it is, and `silent` says so.
    """

    def __init__(self, handle: Handle, period: float, *, stale: float = 0.1):
        self._handle, self._period, self._stale = handle, period, stale
        self._position: Array | None = None
        self._velocity, self._age = np.zeros(6), 0.0

    @property
    def silent(self) -> bool:
        """Nothing has come for longer than `stale` s."""
        return self._age > self._stale

    def receive(self, position: Array, rotation: Array | None = None, velocity: Array | None = None) -> None:
        """A new pose: (3,) m, (3, 3) or quaternion x y z w, (6,) m/s and rad/s. What is not finite is left out."""
        parts = [part for part in (position, rotation, velocity) if part is not None]
        if not all(np.isfinite(part).all() for part in parts):
            return
        self._position = np.array(position, float)
        self._velocity, self._age = np.zeros(6) if velocity is None else np.array(velocity, float), 0.0
        self._handle.pose(self._position, rotation, self._velocity)

    def advance(self) -> None:
        if self._position is None:
            return
        self._age += self._period
        if self.silent:
            self._velocity[:] = 0.0
        self._position += self._velocity[:3] * self._period
        self._handle.pose(self._position, None, self._velocity)
