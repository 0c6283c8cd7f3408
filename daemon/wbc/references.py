"""What moves a task's reference from cycle to cycle: a trajectory, or somebody who streams it. A constant one needs nothing.

Trajectories are daemon.references' paths over a path parameter s, with its rate ṡ from the clock that may be slowed down:
ẋ_d = x' ṡ, ẍ_d = (ẋ_d − the last cycle's) / T. One clock may move several references: then whoever made it moves it on.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
import pinocchio as pin

from daemon.references import HermitePath, LinePath, PathClock
from daemon.wbc.handle import Handle
from daemon.wbc.memory import Array
from daemon.wbc.tasks import rotation as rotation_of


class Reference(Protocol):
    """Writes a task's reference; to be called once a cycle, before `solve`."""

    def advance(self) -> None:
        """One period on."""


class FrameTrajectory:
    """A straight line of a frame's pose, minimum-jerk in time; for CartPos, QuaternionOrientation and SE3."""

    def __init__(self, handle: Handle, path: LinePath, period: float, clock: PathClock | None = None):
        """`period`: of the loop, s; `clock`: shared with others; none: one of its own."""
        self._own = clock is None
        self.clock = PathClock(path.length, period) if clock is None else clock
        self._handle, self._path, self._period = handle, path, period
        self._velocity = np.zeros(6)

    def advance(self) -> None:
        if self._own:
            self.clock.advance()
        rotation, translation, linear, angular = self._path.evaluate(self.clock.s)
        velocity = np.concatenate((linear, angular)) * self.clock.rate
        self._handle.pose(translation, rotation, velocity, (velocity - self._velocity) / self._period)
        self._velocity = velocity


class JointTrajectory:
    """Cubic polynomials through knots of all joints; for JPos."""

    def __init__(self, handle: Handle, path: HermitePath, joints: int, period: float, clock: PathClock | None = None):
        """`joints`: how many, in the order of the model's; `period`: of the loop, s; `clock`: as of a FrameTrajectory."""
        self._own = clock is None
        self.clock = PathClock(path.length, period) if clock is None else clock
        self._handle, self._path, self._period = handle, path, period
        self._position, self._velocity, self._last = np.zeros(joints), np.zeros(joints), np.zeros(joints)

    def advance(self) -> None:
        if self._own:
            self.clock.advance()
        self._path.evaluate(self.clock.s, self._position, self._velocity)
        self._velocity *= self.clock.rate if self.clock.s < self._path.length else 0.0
        self._handle.joints(self._position, self._velocity, (self._velocity - self._last) / self._period)
        self._last[:] = self._velocity


class StreamedPose:
    """A frame's pose as somebody sends it, when it comes; between two, it goes on at the velocity that was sent with it.

    After `stale` s without a new one what was sent stands, and `silent` says so. The reference follows what was sent without lag
    where the velocity fits the poses, works off any gap g at g / `settle`, and never moves faster than `speed` and `turn`: a pose
    that is far off is gone to, not jumped to. A `clock` that slows down slows it down, too.
    """

    def __init__(
        self,
        handle: Handle,
        period: float,
        *,
        stale: float = 0.1,
        settle: float = 0.05,
        speed: float = 0.5,
        turn: float = 1.5,
        clock: PathClock | None = None,
    ):
        """`period` s of the loop; `stale`, `settle` s; `speed` m/s; `turn` rad/s."""
        self._handle, self._period, self._stale, self._clock = handle, period, stale, clock
        self._gain, self._speed, self._turn = 1.0 / max(settle, period), speed, turn
        position, rotation = handle.reference
        self._reference = position.copy(), rotation.copy()
        self._sent = position.copy(), rotation.copy()
        self._velocity, self._age = np.zeros(6), 0.0

    @property
    def silent(self) -> bool:
        """Nothing has come for longer than `stale` s."""
        return self._age > self._stale

    def receive(
        self, position: Array | None = None, rotation: Array | None = None, velocity: Array | None = None
    ) -> bool:
        """A new pose: (3,) m, (3, 3) or quaternion x y z w, (6,) m/s and rad/s; none: as it was, velocity 0. False, and nothing
        changed, where something is not finite."""
        parts = [part for part in (position, rotation, velocity) if part is not None]
        if not all(np.isfinite(part).all() for part in parts):
            return False
        if position is not None:
            self._sent[0][:] = position
        if rotation is not None:
            turned = np.asarray(rotation, float)
            self._sent[1][:] = rotation_of((turned[0], turned[1], turned[2], turned[3])) if turned.size == 4 else turned
        self._velocity, self._age = np.zeros(6) if velocity is None else np.array(velocity, float), 0.0
        return True

    def advance(self) -> None:
        period, rate = self._period, 1.0 if self._clock is None else self._clock.rate
        self._age += period
        if self.silent:
            self._velocity[:] = 0.0
        position, rotation = self._sent
        position += self._velocity[:3] * period
        rotation[:] = pin.exp3(self._velocity[3:] * period) @ rotation
        here, turned = self._reference
        linear = _at_most(self._velocity[:3] + self._gain * (position - here), self._speed) * rate
        angular = _at_most(self._velocity[3:] + self._gain * pin.log3(rotation @ turned.T), self._turn) * rate
        here += linear * period
        turned[:] = pin.exp3(angular * period) @ turned
        self._handle.pose(here, turned, np.concatenate((linear, angular)))


class Leash:
    """Keeps a frame's reference within reach of where the frame was measured in the cycle before, whoever moves it.

    A task that can't be met (something is in the way, the arm is stretched) otherwise asks for K times a distance that grows
    without end, drives go from bound to bound, and the frame shoots off when it comes free. `give` before the references
    advance, `take` after.
    """

    def __init__(self, handle: Handle, reach: float, turn: float):
        """`reach` m, `turn` rad."""
        self._reach, self._turn = reach, turn
        self._position, self._rotation = handle.reference
        self._wanted = self._position.copy(), self._rotation.copy()
        self._error = handle.error
        self.off = np.zeros(3)
        """(3,) m: what is wanted minus what was measured, on the task's axes"""
        self._short = False

    def give(self) -> None:
        """Put back the reference as it was wanted."""
        self._position_measured = self._position - self._error[:3]
        self._turn_measured = self._error[3:].copy()
        self._rotation_used = self._rotation.copy()
        if self._short:
            self._position[:], self._rotation[:] = self._wanted

    def take(self) -> None:
        """Shorten it."""
        self.off = self._position - self._position_measured
        here = pin.exp3(-self._turn_measured) @ self._rotation_used
        turn = pin.log3(self._rotation @ here.T)
        far, wide = float(np.linalg.norm(self.off)), float(np.linalg.norm(turn))
        self._short = far > self._reach or wide > self._turn
        if self._short:
            self._wanted[0][:], self._wanted[1][:] = self._position, self._rotation
            if far > self._reach:
                self._position[:] = self._position_measured + self.off * (self._reach / far)
            if wide > self._turn:
                self._rotation[:] = pin.exp3(turn * (self._turn / wide)) @ here


def _at_most(vector: Array, most: float) -> Array:
    size = float(np.linalg.norm(vector))
    return vector if size <= most else vector * (most / size)
