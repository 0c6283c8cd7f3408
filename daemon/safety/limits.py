"""The last word on what is about to be written: position, velocity, torque and torque rate, against the previous command.

Pure functions on arrays; nothing here knows controllers or buses. The torque that counts is the one that the drive makes of a
set-point, τ + K (q_d − q) + D (q̇_d − q̇): its size is limited, and how fast the *command* changes it at the state measured now,
so a step of any of the five set-point arrays is caught, and the robot's own motion is not.
"""

from __future__ import annotations

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
            lower=np.ascontiguousarray(description.lower, float),
            upper=np.ascontiguousarray(description.upper, float),
            velocity=np.ascontiguousarray(description.velocity_limit, float),
            torque=np.ascontiguousarray(description.torque_limit, float),
            torque_step=np.ascontiguousarray(description.torque_rate_limit, float) * period,
            period=period,
        )


def effective_torque(command: JointCommand, position: Array, velocity: Array) -> Array:
    """Torque (n,) N·m that an impedance drive makes of `command` at a joint position (n,) rad and velocity (n,) rad/s."""
    return (
        command.torque
        + command.stiffness * (command.position - position)
        + command.damping * (command.velocity - velocity)
    )


def first_not_finite(command: JointCommand) -> int:
    """Index of the first joint with a set-point that is no finite number, −1 where all are."""
    return int(
        _first_not_finite(command.position, command.velocity, command.torque, command.stiffness, command.damping)
    )


def enforce(command: JointCommand, previous: JointCommand, state: JointState, limits: Limits) -> int:
    """Bring `command` (finite) within the limits, in place. Returns a count of the joints that had to be changed.

    A position already outside its limits may come back but not go further out. Torque and torque rate are judged after the
    other set-points have been cut, and kept by the feed-forward torque; where they contradict each other, torque wins.
    """
    return int(
        _enforce(
            command.position,
            command.velocity,
            command.torque,
            command.stiffness,
            command.damping,
            previous.position,
            previous.velocity,
            previous.torque,
            previous.stiffness,
            previous.damping,
            state.position,
            state.velocity,
            limits.lower,
            limits.upper,
            limits.velocity,
            limits.torque,
            limits.torque_step,
            limits.period,
        )
    )


@numba.njit(cache=True)
def _first_not_finite(q, v, t, k, d):  # type: ignore[no-untyped-def]
    for j in range(q.shape[0]):
        if not np.isfinite(q[j] + v[j] + t[j] + k[j] + d[j]):
            return j
    return -1


@numba.njit(cache=True)
def _enforce(q, v, t, k, d, q0, v0, t0, k0, d0, qm, vm, lower, upper, vmax, tmax, step, dt):  # type: ignore[no-untyped-def]
    changed = 0
    for j in range(q.shape[0]):
        reach = vmax[j] * dt * (1.0 + 1e-9)
        # Towards where the joint is, a command may jump: that lets a spring go, as fast as the torque rate below allows.
        position = min(max(q[j], min(q0[j], qm[j]) - reach), max(q0[j], qm[j]) + reach)
        position = min(max(position, min(lower[j], q0[j])), max(upper[j], q0[j]))
        velocity = min(max(v[j], -vmax[j]), vmax[j])
        stiffness, damping = max(k[j], 0.0), max(d[j], 0.0)
        # What the drive makes of the previous set-points, and of these but for the feed-forward torque.
        before = t0[j] + k0[j] * (q0[j] - qm[j]) + d0[j] * (v0[j] - vm[j])
        spring = stiffness * (position - qm[j]) + damping * (velocity - vm[j])
        low, high = max(before - step[j], -tmax[j]), min(before + step[j], tmax[j])
        torque = t[j]
        if torque + spring > max(high, -tmax[j]):
            torque = max(high, -tmax[j]) - spring
        elif torque + spring < min(low, tmax[j]):
            torque = min(low, tmax[j]) - spring
        if position != q[j] or velocity != v[j] or torque != t[j] or stiffness != k[j] or damping != d[j]:
            changed += 1
        q[j], v[j], t[j], k[j], d[j] = position, velocity, torque, stiffness, damping
    return changed
