"""The last word on what is about to be written: position, velocity, torque and torque rate, against the previous command.

Pure functions on arrays; nothing here knows controllers or buses. The torque that counts is the one that the drive makes of a
set-point, τ + K (q_d − q) + D (q̇_d − q̇): its size is limited, and how fast the *command* changes it at the state measured now,
so a step of any of the five set-point arrays is caught, and the robot's own motion is not.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from hal.joint import JointCommand, JointState
from handrail.robot.description import RobotDescription

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Limits:
    """Limits of one robot, arrays (n,)."""

    lower: Array
    """rad"""
    upper: Array
    velocity: Array
    """rad/s"""
    torque: Array
    """N·m"""
    torque_step: Array
    """N·m a cycle"""
    period: float
    """s"""

    @classmethod
    def of(cls, description: RobotDescription) -> Limits:
        """The limits in a robot's description, for its own loop period."""
        period = description.period_ns * 1e-9
        return cls(
            lower=description.lower,
            upper=description.upper,
            velocity=description.velocity_limit,
            torque=description.torque_limit,
            torque_step=description.torque_rate_limit * period,
            period=period,
        )

    @functools.cached_property
    def table(self) -> Array:
        """(5, n): the arrays in this order, for the kernel."""
        return np.array([self.lower, self.upper, self.velocity, self.torque, self.torque_step], float)


def effective_torque(command: JointCommand, position: Array, velocity: Array) -> Array:
    """Torque (n,) N·m that an impedance drive makes of `command` at a joint position (n,) rad and velocity (n,) rad/s."""
    return (
        command.torque
        + command.stiffness * (command.position - position)
        + command.damping * (command.velocity - velocity)
    )


def first_not_finite(command: JointCommand) -> int:
    """Index of the first joint with a set-point that is no finite number, −1 where all are."""
    return _first_not_finite(command.table)


def enforce(command: JointCommand, previous: JointCommand, state: JointState, limits: Limits) -> int:
    """Bring `command` (finite) within the limits, in place. Returns a count of the joints that had to be changed.

    A position already outside its limits may come back but not go further out. Torque and torque rate are judged after the
    other set-points have been cut, and kept by the feed-forward torque; where they contradict each other, torque wins.
    """
    return _enforce(command.table, previous.table, state.table, limits.table, limits.period)


# Few arguments, whole tables: handing an array to a compiled kernel costs more than what this one does with a row.


@numba.njit(cache=True)
def _first_not_finite(command):  # type: ignore[no-untyped-def]
    for j in range(command.shape[1]):
        if not np.isfinite(command[0, j] + command[1, j] + command[2, j] + command[3, j] + command[4, j]):
            return j
    return -1


@numba.njit(cache=True)
def _enforce(command, previous, measured, limits, dt):  # type: ignore[no-untyped-def]
    changed, qm, vm = 0, measured[0], measured[1]
    for j in range(command.shape[1]):
        q, v, torque, k, d = command[0, j], command[1, j], command[2, j], command[3, j], command[4, j]
        q0, v0, t0, k0, d0 = previous[0, j], previous[1, j], previous[2, j], previous[3, j], previous[4, j]
        lower, upper, vmax, tmax, step = limits[0, j], limits[1, j], limits[2, j], limits[3, j], limits[4, j]
        reach = vmax * dt * (1.0 + 1e-9)
        # Towards where the joint is, a command may jump: that lets a spring go, as fast as the torque rate below allows.
        position = min(max(q, min(q0, qm[j]) - reach), max(q0, qm[j]) + reach)
        position = min(max(position, min(lower, q0)), max(upper, q0))
        velocity = min(max(v, -vmax), vmax)
        stiffness, damping = max(k, 0.0), max(d, 0.0)
        # What the drive makes of the previous set-points, and of these but for the feed-forward torque.
        before = t0 + k0 * (q0 - qm[j]) + d0 * (v0 - vm[j])
        spring = stiffness * (position - qm[j]) + damping * (velocity - vm[j])
        low, high = max(before - step, -tmax), min(before + step, tmax)
        kept = torque
        if kept + spring > max(high, -tmax):
            kept = max(high, -tmax) - spring
        elif kept + spring < min(low, tmax):
            kept = min(low, tmax) - spring
        if position != q or velocity != v or kept != torque or stiffness != k or damping != d:
            changed += 1
        command[0, j], command[1, j], command[2, j], command[3, j], command[4, j] = (
            position, velocity, kept, stiffness, damping,
        )  # fmt: skip
    return changed
