"""The last word on what is about to be written: position, velocity, torque and torque rate, against the previous command.

Pure functions on arrays; nothing here knows controllers or buses. The torque that counts is the one that the drive makes of a
set-point, τ + K (q_d − q) + D (q̇_d − q̇): its size is limited, and how fast the *command* changes it at the state measured now,
so a step of any of the five set-point arrays is caught, and the robot's own motion is not.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daemon.exchange import Rule
from hal.drives.rows import joint_command
from hal.joint import JointCommand, JointState, Mode
from handrail.compiled import compiled
from handrail.robot.description import RobotDescription

Array = NDArray[np.float64]

LIMITS = (Rule.POSITION, Rule.VELOCITY, Rule.TORQUE, Rule.TORQUE_RATE, Rule.GAIN)
"""The limits, in the order of the bits of `Cut.which`."""
_POSITION, _VELOCITY, _TORQUE, _RATE, _GAIN = 1, 2, 4, 8, 16
_DAMPING, _TORQUE_MODE, _IMPEDANCE, _LAST_MODE = int(Mode.DAMPING), int(Mode.TORQUE), int(Mode.IMPEDANCE), max(Mode)


class Cut(NamedTuple):
    """What the limits did to a command."""

    changed: int
    """joints whose set-points were changed; −1: `joint` can't be commanded at all, since something of it is no finite number"""
    which: int
    """bits 1 << i: LIMITS[i] cut something"""
    joint: int
    """the first joint that was changed, −1: none"""


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
    largest: JointCommand | None = None
    """the largest feed-forward torque, stiffness and damping that can be written: a larger one would arrive as another torque
    than was judged. None: whatever can be computed"""

    @classmethod
    def of(cls, description: RobotDescription, largest: JointCommand | None = None) -> Limits:
        """The limits in a robot's description, for its own loop period."""
        period = description.period_ns * 1e-9
        return cls(
            lower=description.lower,
            upper=description.upper,
            velocity=description.velocity_limit,
            torque=description.torque_limit,
            torque_step=description.torque_rate_limit * period,
            period=period,
            largest=largest,
        )

    @functools.cached_property
    def table(self) -> Array:
        """(8, n): the arrays in this order, then the largest feed-forward, stiffness and damping, for the kernel."""
        rows = [self.lower, self.upper, self.velocity, self.torque, self.torque_step]
        largest = np.full((3, len(self.lower)), 1e100) if self.largest is None else self.largest.table[2:]
        return np.array([*rows, *largest], float)


def effective_torque(command: JointCommand, position: Array, velocity: Array) -> Array:
    """Torque (n,) N·m that an impedance drive makes of `command` at a joint position (n,) rad and velocity (n,) rad/s."""
    return (
        command.torque
        + command.stiffness * (command.position - position)
        + command.damping * (command.velocity - velocity)
    )


def enforce(out: JointCommand, wanted: JointCommand, previous: JointCommand, state: JointState, limits: Limits) -> Cut:
    """Make `out` of `wanted`, brought within the limits. Where `changed` is −1, `out` must not be written.

    A position already outside its limits may come back but not go further out. Torque and torque rate are judged after the
    other set-points have been cut, and kept by the feed-forward torque; where they contradict each other, torque wins. Where
    the feed-forward can't be written, stiffness and damping give way. A joint of which anything is no finite number, wanted,
    previous or measured, can't be judged and so not be commanded.
    """
    return Cut(*_enforce(out.memory, wanted.memory, previous.memory, state.table, limits.table, limits.period))


def cut_of(
    limit: Rule, joint: int, wanted: JointCommand, previous: JointCommand, state: JointState, limits: Limits
) -> tuple[float, float]:
    """(what was asked for, what was allowed) where a limit has cut a joint's set-point, in the limit's unit; for people."""
    position, velocity = state.position, state.velocity
    match limit:
        case Rule.POSITION:
            asked = float(wanted.position[joint])
            return asked, float((limits.lower if asked < limits.lower[joint] else limits.upper)[joint])
        case Rule.VELOCITY:
            step = (wanted.position[joint] - previous.position[joint]) / limits.period
            speeds = (float(wanted.velocity[joint]), float(step))
            return max(speeds, key=abs), float(limits.velocity[joint])
        case Rule.TORQUE:
            return float(effective_torque(wanted, position, velocity)[joint]), float(limits.torque[joint])
        case Rule.TORQUE_RATE:
            after, before = (effective_torque(command, position, velocity)[joint] for command in (wanted, previous))
            return float(after - before), float(limits.torque_step[joint])
        case _:
            return float(wanted.stiffness[joint]), float(limits.table[6, joint])


# Few arguments, whole memories: handing an array to a compiled kernel costs more than what this one does with a row.


@compiled
def _enforce(out, wanted, previous, measured, limits, dt):  # type: ignore[no-untyped-def]
    n, qm, vm = limits.shape[1], measured[0], measured[1]
    command, mode = joint_command(out, n)
    asked, asked_mode = joint_command(wanted, n)
    last, _ = joint_command(previous, n)
    changed, which, first = 0, 0, -1
    for j in range(n):
        q, v, torque, k, d, law = asked[0, j], asked[1, j], asked[2, j], asked[3, j], asked[4, j], asked_mode[j]
        q0, v0, t0, k0, d0 = last[0, j], last[1, j], last[2, j], last[3, j], last[4, j]
        lower, upper, vmax, tmax, step = limits[0, j], limits[1, j], limits[2, j], limits[3, j], limits[4, j]
        # What the drive made of the previous set-points at the state measured now.
        before = t0 + k0 * (q0 - qm[j]) + d0 * (v0 - vm[j])
        if not math.isfinite(q + v + torque + k + d + before + q0) or law > _LAST_MODE:
            return -1, 0, j
        cut, reach = 0, vmax * dt * (1.0 + 1e-9)
        # Towards where the joint is, a command may jump: that lets a spring go, as fast as the torque rate below allows.
        near = min(max(q, min(q0, qm[j]) - reach), max(q0, qm[j]) + reach)
        velocity = min(max(v, -vmax), vmax)
        if near != q or velocity != v:
            cut |= _VELOCITY
        position = min(max(near, min(lower, q0)), max(upper, q0))
        if position != near:
            cut |= _POSITION
        stiffness, damping = min(max(k, 0.0), limits[6, j]), min(max(d, 0.0), limits[7, j])
        if stiffness != k or damping != d:
            cut |= _GAIN
        if law == _DAMPING:  # the drive looks at damping alone: let the others say so
            velocity, torque, stiffness = 0.0, 0.0, 0.0
        elif law == _TORQUE_MODE:
            stiffness, damping = 0.0, 0.0
        # What the drive makes of these but for the feed-forward torque.
        spring = stiffness * (position - qm[j]) + damping * (velocity - vm[j])
        if not math.isfinite(spring):
            return -1, 0, j
        low, high = max(before - step, -tmax), min(before + step, tmax)
        kept = torque
        if kept + spring > max(high, -tmax):
            cut |= _TORQUE if high == tmax else _RATE
            kept = max(high, -tmax) - spring
        elif kept + spring < min(low, tmax):
            cut |= _TORQUE if low == -tmax else _RATE
            kept = min(low, tmax) - spring
        if abs(kept) > limits[5, j]:
            cut |= _GAIN
            kept = min(max(min(max(kept + spring, min(low, tmax)), max(high, -tmax)), -limits[5, j]), limits[5, j])
            stiffness, damping = 0.0, 0.0
        if law == _DAMPING and kept != 0.0:
            law = _IMPEDANCE  # the same law, and the feed-forward that the rate needs
        if cut:
            changed, which = changed + 1, which | cut
            if first < 0:
                first = j
        command[0, j], command[1, j], command[2, j], command[3, j], command[4, j], mode[j] = (
            position, velocity, kept, stiffness, damping, law,
        )  # fmt: skip
    return changed, which, first
