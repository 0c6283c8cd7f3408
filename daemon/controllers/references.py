"""References that controllers follow: paths over a path parameter s in seconds, and the clock that moves s along.

At rate 1 a path runs as it was planned. Pausing, resuming, cancelling and the operator's speed change the rate, jerk-limited, so
the robot slows down along its path instead of leaving it (ruckig, velocity interface, one degree of freedom). Of a path q(s) with
derivatives by s of q', q″ and q‴ the joints do q̈ = q″ ṡ² + q' s̈ and q⃛ = q‴ ṡ³ + 3 q″ ṡ s̈ + q' s⃛: how fast the rate may change
is what the path leaves of their limits.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from ruckig import ControlInterface, InputParameter, OutputParameter, Ruckig

from handrail.compiled import compiled
from handrail.messages import Pose

Array = NDArray[np.float64]

MAX_RATE_CHANGE = 5.0
"""1/s"""
MAX_RATE_JERK = 60.0
"""1/s²"""
LEAST_ROOM = 0.25
"""of the limits that a change of rate may use where the path uses them up itself: it must come to a stand all the same"""
HORIZON = 1.0
"""s of a path that a change of rate has to look at: with the least room it takes less, by the usual limits"""
SLOWEST = 0.1
"""share of the planned speed that an operator may ask for, at least"""


class PathClock:
    """The path parameter s, s, with its rate in [0, 1] from 1 at the start: ds/dt, but where the path is waited for."""

    def __init__(self, length: float, period: float):
        """`length`: s at the path's end; `period`: of the loop, s."""
        self.length, self._period = length, period
        self.s, self.rate = 0.0, 1.0
        self.speed = 1.0
        """the rate that it has, or comes to, where nobody holds it"""
        self.room: Callable[[], tuple[float, float]] | None = None
        """the rate's acceleration 1/s and jerk 1/s² that the rest of the path leaves room for"""
        self.share = 1.0
        """of the rate, in [0, 1]: what whoever follows the path keeps up with now"""
        self._target = 1.0
        self._ruckig = Ruckig(1, period)
        self._input, self._output = InputParameter(1), OutputParameter(1)
        self._input.control_interface = ControlInterface.Velocity
        self._input.max_acceleration, self._input.max_jerk = [MAX_RATE_CHANGE], [MAX_RATE_JERK]
        self._input.current_acceleration = [0.0]
        self._steady = True

    def hold(self) -> None:
        """Slow down to a stand."""
        self._bring_to(0.0)

    def go(self) -> None:
        """Go on, at `speed`."""
        self._bring_to(self.speed)

    def run_at(self, speed: float) -> None:
        """Bring the rate to `speed` in (0, 1]; where somebody holds it, as soon as it goes on."""
        self.speed = speed
        if not self.held:
            self._bring_to(speed)

    def begin(self, speed: float, held: bool) -> None:
        """Have this rate from the start on, where the path is at rest; `held`: stand, until it is told to go on."""
        self.speed = speed
        self.rate = self._target = 0.0 if held else speed

    @property
    def held(self) -> bool:
        """It stands, or is on its way to."""
        return self._target == 0.0

    def _bring_to(self, rate: float) -> None:
        if rate == self._target:
            return
        if self._steady:
            self._input.current_velocity, self._input.current_acceleration = [self.rate], [0.0]
        if self.room is not None:
            change, jerk = self.room()
            self._input.max_acceleration = [min(change, MAX_RATE_CHANGE)]
            self._input.max_jerk = [min(jerk, MAX_RATE_JERK)]
        self._target, self._steady = rate, False
        self._input.target_velocity = [rate]

    def begin_anew(self, length: float) -> None:
        """From here on another path, of which s is 0 here; the rate is what it was."""
        self.s, self.length = 0.0, length

    def advance(self) -> None:
        """Move on by one cycle."""
        if self._steady:
            self.s = min(self.s + self.pace * self._period, self.length)
            return
        self._input.current_position = [0.0]
        self._ruckig.update(self._input, self._output)
        self._output.pass_to_input(self._input)
        self.s = min(self.s + self.share * self._output.new_position[0], self.length)
        self.rate = min(max(self._output.new_velocity[0], 0.0), 1.0)
        if abs(self.rate - self._target) < 1e-9 and abs(self._output.new_acceleration[0]) < 1e-9:
            self.rate, self._steady = self._target, True

    @property
    def pace(self) -> float:
        """ds/dt."""
        return self.rate * self.share

    @property
    def at_end(self) -> bool:
        """The path has been run to its end."""
        return self.s >= self.length

    @property
    def standing(self) -> bool:
        """s does not move, and will not until the rate is brought up."""
        return self._steady and self.rate == 0.0


class DetourClock(PathClock):
    """A clock that stands while the joints are on their way back to its path, which has a clock of its own."""

    detour: PathClock | None = None

    def leave(self, detour: PathClock) -> None:
        """Stand here, until that has been run to its end; then go on."""
        self.detour = detour
        detour.begin(self.speed, held=False)

    def hold(self) -> None:
        if self.detour is None:
            super().hold()
        else:
            self.detour.hold()

    def go(self) -> None:
        if self.detour is None:
            super().go()
        else:
            self.detour.go()

    def run_at(self, speed: float) -> None:
        if self.detour is None:
            super().run_at(speed)
        else:
            self.speed = speed
            self.detour.run_at(speed)

    @property
    def held(self) -> bool:
        return super().held if self.detour is None else self.detour.held

    @property
    def standing(self) -> bool:
        return self._steady and self.rate == 0.0 if self.detour is None else self.detour.standing

    def advance(self) -> None:
        if self.detour is None:
            PathClock.advance(self)
            return
        self.detour.advance()
        if self.detour.at_end:
            self.detour = None
            super().go()


class HermitePath:
    """Joint positions over s: cubic Hermite polynomials between knots."""

    def __init__(self, times: Array, positions: Array, velocities: Array):
        """`times` (k,) s, increasing from 0; `positions`, `velocities` (k, m) rad, rad/s."""
        self.knots = np.column_stack(
            (times, positions, velocities)
        )  # one table: an array more costs a kernel's call more
        """(k, 1 + 2 m)"""
        self.at = 0
        """the knot before s, as of the last evaluation"""
        self.length = float(times[-1])

    def evaluate(self, s: float, position: Array, velocity: Array) -> None:
        """Write position (m,) rad and its derivative by s (m,) rad/s; s only grows from call to call, beyond the end it stays."""
        self.at = hermite(s, self.at, self.knots, position, velocity)

    def place(self, s: float) -> Array:
        """(m,) rad, at any s, which changes nothing."""
        position = np.empty((self.knots.shape[1] - 1) // 2)
        hermite(s, 0, self.knots, position, np.empty_like(position))
        return position

    def most(self, s: float) -> Array:
        """(3, m) the most of velocity, acceleration and jerk by s in the next second from s on, by size."""
        first = max(int(np.searchsorted(self.knots[:, 0], s, side="right")) - 1, 0)
        return _most(min(first, len(self.knots) - 1), self.knots)  # type: ignore[no-any-return]

    def room(self, limits: Array) -> tuple[float, float]:
        """The rate's acceleration 1/s and jerk 1/s² for which the next second of the path leaves room.

        `limits` (2, m): rad/s² and rad/s³ that the joints may do.
        """
        return _room(self.at, self.knots, limits)  # type: ignore[no-any-return]


@compiled
def hermite(s, at, knots, position, velocity):  # type: ignore[no-untyped-def]
    """HermitePath.evaluate; returns the knot before s."""
    last, m = knots.shape[0] - 1, position.shape[0]
    if s >= knots[last, 0]:
        position[:] = knots[last, 1 : 1 + m]
        velocity[:] = knots[last, 1 + m :]
        return last
    while knots[at + 1, 0] <= s:
        at += 1
    h = knots[at + 1, 0] - knots[at, 0]
    u = (s - knots[at, 0]) / h
    uu, uuu = u * u, u * u * u
    for j in range(m):
        p0, p1, v0, v1 = knots[at, 1 + j], knots[at + 1, 1 + j], knots[at, 1 + m + j], knots[at + 1, 1 + m + j]
        position[j] = (
            (2 * uuu - 3 * uu + 1) * p0 + (uuu - 2 * uu + u) * h * v0 + (3 * uu - 2 * uuu) * p1 + (uuu - uu) * h * v1
        )
        velocity[j] = (6 * uu - 6 * u) / h * (p0 - p1) + (3 * uu - 4 * u + 1) * v0 + (3 * uu - 2 * u) * v1
    return at


@compiled
def _most(at, knots):  # type: ignore[no-untyped-def]
    m = (knots.shape[1] - 1) // 2
    until = knots[at, 0] + HORIZON
    most = np.zeros((3, m))  # of each joint's velocity, acceleration and jerk by s
    for k in range(at, knots.shape[0] - 1):
        if knots[k, 0] > until:
            break
        per = 1.0 / (knots[k + 1, 0] - knots[k, 0])
        for j in range(m):
            v0, v1 = knots[k, 1 + m + j], knots[k + 1, 1 + m + j]
            slope = (knots[k + 1, 1 + j] - knots[k, 1 + j]) * per
            most[0, j] = max(most[0, j], abs(v0), abs(v1), abs(1.5 * slope - 0.25 * (v0 + v1)))
            hard = max(abs(6.0 * slope - 4.0 * v0 - 2.0 * v1), abs(2.0 * v0 + 4.0 * v1 - 6.0 * slope)) * per
            most[1, j] = max(most[1, j], hard)
            most[2, j] = max(most[2, j], 6.0 * abs(v0 + v1 - 2.0 * slope) * per * per)
    return most


@compiled
def _room(at, knots, limits):  # type: ignore[no-untyped-def]
    most, m = _most(at, knots), limits.shape[1]
    change, jerk = MAX_RATE_CHANGE, MAX_RATE_JERK
    for j in range(m):
        change = min(change, max(limits[0, j] - most[1, j], LEAST_ROOM * limits[0, j]) / (most[0, j] + 1e-12))
    for j in range(m):
        left = limits[1, j] - most[2, j] - 3.0 * most[1, j] * change
        jerk = min(jerk, max(left, LEAST_ROOM * limits[1, j]) / (most[0, j] + 1e-12))
    return change, jerk


class LinePath:
    """A frame's pose over s: a straight line and the shortest turn, both with minimum-jerk timing (Flash and Hogan 1985)."""

    def __init__(self, rotation: Array, translation: Array, goal: pin.SE3, duration: float):
        """From `rotation` (3, 3) and `translation` (3,) m to `goal`, world frame, in `duration` s."""
        self.length = duration
        self.rotation, self.translation = rotation, translation
        self.shift = goal.translation - translation
        self.turn = pin.log3(rotation.T @ goal.rotation)

    def evaluate(self, s: float) -> tuple[Array, Array, Array, Array]:
        """(rotation (3, 3), translation (3,) m, linear (3,) m/s, angular (3,) rad/s): velocities by s, world axes."""
        u = min(max(s / self.length, 0.0), 1.0)
        share = u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
        slope = 30.0 * u * u * (1.0 - u) ** 2 / self.length
        rotation = self.rotation @ pin.exp3(share * self.turn)
        return rotation, self.translation + share * self.shift, slope * self.shift, rotation @ (slope * self.turn)

    def shares(self, s: Array) -> tuple[Array, Array, Array, Array]:
        """Of (k,) s: how much of the way has been gone, 0 to 1, and that share's first three derivatives by s."""
        u = np.clip(s / self.length, 0.0, 1.0)
        share, slope = u**3 * (10.0 - 15.0 * u + 6.0 * u * u), 30.0 * u * u * (1.0 - u) ** 2 / self.length
        bend = 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / self.length**2
        return share, slope, bend, 60.0 * (1.0 - 6.0 * u + 6.0 * u * u) / self.length**3

    def twist(self, s: float) -> Array:
        """(6,) m and rad, world axes: the whole way, as a frame's velocity is it times the share's slope, at `s`."""
        return np.concatenate((self.shift, self.evaluate(s)[0] @ self.turn))


def placement(pose: Pose) -> pin.SE3:
    """A goal as messages have it, for a path."""
    return pin.SE3(pin.Quaternion(np.array(pose.orientation)).normalized().matrix(), np.array(pose.position))


def fade(elapsed: float, duration: float) -> float:
    """A smooth 1 → 0 over `duration` s, flat at both ends."""
    u = min(max(elapsed / duration, 0.0), 1.0)
    return 1.0 - u * u * (3.0 - 2.0 * u)


def faded(elapsed: Array, duration: float) -> Array:
    """The same of each of many, (m,) s."""
    u = np.clip(elapsed / duration, 0.0, 1.0)
    return np.asarray(1.0 - u * u * (3.0 - 2.0 * u))
