"""Time along a joint path: as fast as limits and the waypoint's duration allow, at rest at both ends, smooth in between.

toppra finds the fastest profile under velocity, acceleration and torque limits; the path's own parameter is one more column with
limits of its own, which is how a segment is made to last. The profile then passes through a moving average in time: the
path stays the same, steps of acceleration become ramps (as in FIR trajectory filters), both ends keep zero velocity. The knots'
velocities are those of a cubic spline through them: so acceleration is continuous, and jerk has a limit, too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from engines.planning.plan import Infeasible
from engines.planning.timing.bare_toppra import algorithm, constraint, toppra
from engines.planning.timing.path_torque import FELT, PathTorque

Array = NDArray[np.float64]

TIP_SPEED = 0.25
"""m/s, the tool tip's mean speed at most on a way that is free: people watch"""
_KNOT_SPACING = 0.02
"""s"""
_FINE, _MOST = 0.001, 3000
"""s between looks at a profile; of a long one so many in all"""
_SHORTEST = 0.2
"""s: no segment is shorter, so that even a tiny correction starts and stops smoothly"""
_RAMP, _WINDOW = 0.25, 0.15
"""of the duration: speeding up (and slowing down), moving average"""
_LOOKS, _USUAL = 25, 0.8
"""places of a path, share of the torque that may be used: where less is needed at all of them, torque is no question"""
_LEFT = 0.02
"""of the torque limit: a joint to which weight and friction leave less can't be moved"""


@dataclass(frozen=True)
class Limits:
    """What the knots must keep, (m,) each."""

    velocity: Array
    """rad/s"""
    acceleration: Array
    """rad/s²"""
    jerk: Array | None = None
    """rad/s³"""
    torque: PathTorque | None = None
    """of the whole robot"""


@dataclass(frozen=True)
class Knots:
    """A cubic-Hermite trajectory: (k,) s, (k, m) rad, (k, m) rad/s."""

    times: Array
    positions: Array
    velocities: Array


def accelerations(knots: Knots) -> Array:
    """(2 (k − 1), m) rad/s² at both ends of every Hermite piece; it is linear in between, so these are the largest."""
    h = np.diff(knots.times)[:, None]
    slope = np.diff(knots.positions, axis=0) / h
    first, second = knots.velocities[:-1], knots.velocities[1:]
    return np.vstack([(6 * slope - 4 * first - 2 * second) / h, (2 * first + 4 * second - 6 * slope) / h])


def jerks(knots: Knots) -> Array:
    """(k − 1, m) rad/s³ of each Hermite piece."""
    h = np.diff(knots.times)[:, None]
    slope = np.diff(knots.positions, axis=0) / h
    return np.asarray(6 * (knots.velocities[:-1] + knots.velocities[1:] - 2 * slope) / h**2)


def peak_velocities(knots: Knots) -> Array:
    """(m,) rad/s, the largest in size, also between the knots."""
    h = np.diff(knots.times)[:, None]
    slope = np.diff(knots.positions, axis=0) / h
    middle = 1.5 * slope - 0.25 * (knots.velocities[:-1] + knots.velocities[1:])
    return np.abs(np.vstack([knots.velocities, middle])).max(axis=0)


def parametrise(path: Array, limits: Limits, duration: float, *, where: str = "") -> Knots:
    """Timed knots through a path (k, m) rad, its rows evenly spaced in what should run evenly (the tip's way, mostly).

    Lasts at least `duration` s. Raises Infeasible when no profile keeps the limits, as where a joint can't carry what it bears.
    """
    duration = max(duration, _SHORTEST)
    if np.abs(np.diff(path, axis=0)).max(initial=0.0) < 1e-9:
        times = np.linspace(0.0, duration, max(2, round(duration / _KNOT_SPACING) + 1))
        return Knots(times, np.repeat(path[:1], len(times), axis=0), np.zeros((len(times), path.shape[1])))
    spline = _spline(path)
    torque = limits.torque if limits.torque is not None and _works_hard(spline, limits, limits.torque) else None
    profile_times, progress = _profile(spline, limits, torque, duration, where)
    window = _WINDOW * max(duration, profile_times[-1])
    knots = _smoothed(spline, profile_times, progress, window)
    return _stretched(knots, limits, torque)


def _spline(path: Array) -> toppra.SplineInterpolator:
    """A cubic spline through the path, straight at its ends, over a parameter from 0 to 1."""
    share = np.linspace(0.0, 1.0, len(path))
    if len(path) < 4:  # a line and a bit: more points keep the spline from swinging
        finer = np.linspace(0.0, 1.0, 9)
        path, share = np.column_stack([np.interp(finer, share, column) for column in path.T]), finer
    return toppra.SplineInterpolator(share, path, bc_type="natural")


def _profile(
    spline: toppra.SplineInterpolator, limits: Limits, torque: PathTorque | None, duration: float, where: str
) -> tuple[Array, Array]:
    """(k,) s and (k,) path parameter 0..1 of the fastest profile that leaves room for the moving average."""
    ramp = _RAMP * duration
    top = 1.0 / (duration * (1.0 - _WINDOW) - ramp)  # a trapezoid of that duration covers 1
    share = np.asarray(spline.ss_waypoints)
    # The parameter itself as the last joint: its velocity limit makes the segment last.
    path = toppra.SplineInterpolator(share, np.column_stack([spline(share), share]), bc_type="natural")
    velocity = np.append(limits.velocity, top)
    acceleration = np.append(limits.acceleration, top / ramp)
    with np.printoptions(formatter={"float_kind": str}):  # toppra puts limits into words: an eighth of planning's time
        bounds = [
            constraint.JointVelocityConstraint(np.column_stack([-velocity, velocity])),
            constraint.JointAccelerationConstraint(np.column_stack([-acceleration, acceleration])),
        ]
    if torque is not None:
        bounds.append(_TorqueConstraint(torque, where))
    instance = algorithm.TOPPRA(
        bounds,
        path,
        gridpoints=np.linspace(0.0, 1.0, 101),
        solver_wrapper="seidel",
    )
    instance.compute_parameterization(0.0, 0.0)
    found = instance.problem_data
    if found.return_code.name != "Ok":
        raise Infeasible("a speed along the path within velocity, acceleration and torque limits", 0.0, "rad/s", where)
    passed = np.concatenate(
        [[0.0], np.cumsum(2.0 * np.diff(found.gridpoints) / (found.sd_vec[:-1] + found.sd_vec[1:]))]
    )
    times = np.linspace(0.0, passed[-1], max(3, min(int(np.ceil(passed[-1] / _FINE)), _MOST) + 1))
    progress = np.clip(_at(times, passed, found.gridpoints, found.sd_vec), 0.0, 1.0)
    progress[0], progress[-1] = 0.0, 1.0
    return times, np.maximum.accumulate(progress)


def _at(times: Array, passed: Array, share: Array, rate: Array) -> Array:
    """The path's parameter at times, from its values and rates when grid points are passed; acceleration is constant in between.

    As toppra's ParametrizeConstAccel, which asks for one time after another: a tenth of planning's time.
    """
    i = np.clip(np.searchsorted(passed, times, side="right") - 1, 0, len(passed) - 2)
    dt, step = times - passed[i], np.diff(passed)
    return np.asarray(share[i] + dt * (rate[i] + 0.5 * dt * (np.diff(rate) / step)[i]))


def _smoothed(spline: toppra.SplineInterpolator, times: Array, progress: Array, window: float) -> Knots:
    """The profile averaged over the last `window` s, as knots. It ends `window` later."""
    end = times[-1] + window
    integral = np.concatenate([[0.0], np.cumsum((progress[1:] + progress[:-1]) / 2 * np.diff(times))])

    def area(t: Array) -> Array:  # ∫ progress, 0 before the start and 1 after the end of the profile
        return np.interp(t, times, integral) + np.maximum(t - times[-1], 0.0)

    knots = np.linspace(0.0, end, max(3, round(end / _KNOT_SPACING) + 1))
    share = np.clip((area(knots) - area(knots - window)) / window, 0.0, 1.0)
    share[0], share[-1] = 0.0, 1.0
    positions = spline(share)
    velocities = CubicSpline(knots, positions, bc_type="clamped")(knots, 1)
    velocities[[0, -1]] = 0.0
    return Knots(knots, positions, velocities)


def _works_hard(spline: toppra.SplineInterpolator, limits: Limits, torque: PathTorque) -> bool:
    """Whether some joint might need more than is usual if all went as fast as velocity and acceleration allow: most need less by
    far, and then looking here and there is enough."""
    q, slope, curvature = (spline(np.linspace(0.0, 1.0, _LOOKS), order) for order in range(3))
    a, b, c, felt = torque.along(q, slope, curvature)
    size = np.maximum(np.abs(slope), 1e-9)
    squared = ((limits.velocity / size) ** 2).min(axis=1, keepdims=True)
    change = ((limits.acceleration + np.abs(curvature) * squared) / size).min(axis=1, keepdims=True)
    needed = np.abs(a) * change + np.abs(b) * squared + np.abs(c)
    return bool((needed > _USUAL * torque.limit[felt]).any())


def _stretched(knots: Knots, limits: Limits, torque: PathTorque | None) -> Knots:
    """The averaged profile runs late against the path, by a hair: slow the whole down where that passes a limit."""
    fast = float((peak_velocities(knots) / limits.velocity).max())
    hard = float(np.sqrt((np.abs(accelerations(knots)).max(axis=0) / limits.acceleration).max()))
    factor = max(1.0, fast * 1.0001, hard * 1.0001)
    if limits.jerk is not None:
        factor = max(factor, float(np.cbrt((np.abs(jerks(knots)).max(axis=0) / limits.jerk).max())) * 1.0001)
    if torque is not None:
        factor = max(factor, float(np.sqrt(_overload(knots, torque))) * 1.0001)
    return Knots(knots.times * factor, knots.positions, knots.velocities / factor)


def _overload(knots: Knots, torque: PathTorque) -> float:
    """How many times the torque that moves the robot is, at a knot, what weight and friction leave of the limit."""
    acceleration = np.vstack([accelerations(knots)[: len(knots.times) - 1], np.zeros_like(knots.velocities[:1])])
    moving, still = torque.needed(knots.positions, knots.velocities, acceleration)
    felt = np.abs(moving) > FELT
    left = torque.limit - np.sign(moving) * still
    return float(np.where(felt, np.abs(moving) / np.maximum(left, _LEFT * torque.limit), 0.0).max())


class _TorqueConstraint(constraint.LinearConstraint):  # type: ignore[misc]
    """|a s̈ + b ṡ² + c| ≤ limit for toppra, of a path whose last column is the parameter itself."""

    def __init__(self, torque: PathTorque, where: str):
        super().__init__()
        self._torque, self._where, self.identical = torque, where, True

    def compute_constraint_params(self, path: toppra.SplineInterpolator, gridpoints: Array) -> tuple[Array | None, ...]:
        q, slope, curvature = (path(gridpoints, order)[:, :-1] for order in range(3))
        a, b, c, felt = self._torque.along(q, slope, curvature)
        limit, both = self._torque.limit[felt], np.eye(len(felt))
        missing = np.abs(c).max(axis=0) - (1.0 - _LEFT) * limit
        if len(felt) and missing.max() > 0.0:
            worst = int(np.argmax(missing))
            what = f"torque of {self._torque.joints[felt[worst]]} against weight and friction"
            raise Infeasible(what, float(missing[worst]), "N·m", self._where)
        return a, b, c, np.vstack([both, -both]), np.concatenate([limit, limit]), None, None
