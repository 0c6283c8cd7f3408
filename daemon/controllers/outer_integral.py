"""The integral on the joint encoders' error, around the loops that close in the drives, and what is known ahead of it.

A drive whose own loop closes on an angle measured at its motor holds that angle, and backlash, the calibration of its sensor and
friction keep the joint elsewhere. After Fallon et al., "An Architecture for Online Affordance-based Perception and Whole-body
Planning" (J. Field Robotics 2015), §6, eq. 2 and 3: the drive follows q_ref = q_des + z with ż = K_i (q_des − q_enc).

An integral is too slow for what comes all at once: where a joint's load turns, its motor has to cross the backlash, and where it
sets off or turns round, friction does. Of a joint whose friction F and backlash 2 b are known about, both are fed forward:

    q_ref = q_des + z + b s,   τ = g + F d

d in −1..1, the direction of friction, follows the reference alone: ḋ = q̇_des / PRESLIDING within its bounds, the stop operator of
Prandtl, which Dahl's model (1968) is the smooth form of. What moves no reference moves no torque, so nothing can hunt.

s in −1..1, the side of the gap, is the inverse of the backlash (Tao and Kokotović, "Adaptive Control of Systems with Actuator and
Sensor Nonlinearities", 1996; Nordin and Gutman's survey, Automatica 38, 2002). Where the spring carries something, its sign is the
side. Where it carries nothing, the motor is in the gap, and leaves it to the side of the torque that the joint needs, g + F d +
K (q_des − q_enc): so a friction that is known badly costs a milliradian of error, not a crossing at the wrong time. From side to
side s takes `CROSSING` s, and the integral waits meanwhile. A joint that has not been in touch since it was enabled has a motor
nobody knows where in the gap: s goes slowly, within `SEARCHING` s, and at the touch z takes over what was too much of it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hal.joint import Mode
from handrail.compiled import compiled
from handrail.robot.description import IntegralGains

Array = NDArray[np.float64]

PRESLIDING = 0.002
"""rad of reference over which friction comes to act in its direction"""
CROSSING = 0.03
"""s, from one side of the gap to the other"""
SEARCHING = 0.3
"""s, likewise, of a joint that has never been in touch"""
_TOUCH = 0.2
"""of its friction: a spring that carries less carries nothing"""
_TURN, _TURN_STANDING = 0.1, 1.0
"""of its friction: the torque that a joint must need for its motor to go to the other side, while it moves and while it stands"""
_IMPEDANCE = int(Mode.IMPEDANCE)


class OuterIntegral:
    """What has been learned of each joint, z rad (n,), by the controllers that follow joint references (`write`).

    Written is K z as torque, which in joint impedance is the same as q_des + z for the set-point, so that the command's position
    stays what was asked for: starts, switches, guards and clients go by that. z belongs to the joint, not to a controller: what
    takes over goes on with it, and a switch leaves no bump. It stands still while nothing follows a joint reference.

    An error within `band` is left alone: stiction and backlash make an integral hunt around what it cannot reach. z is bounded
    twice by the robot's file. |z| ≤ limit. And where the spring carries more than gravity and `push`, the joint leans on
    something: z does not grow in that direction, so that the integral adds to no contact what friction does not explain.
    """

    def __init__(self, gains: IntegralGains, period: float):
        """`period`: of the loop, s."""
        zero = np.zeros(len(gains.rate))
        known = [
            gains.rate * period,
            gains.limit,
            gains.push,
            gains.band,
            gains.friction + zero,
            gains.backlash / 2.0 + zero,
        ]
        self.table = np.array([*known, zero, zero, zero, zero, zero])
        """(11, n): rate a cycle, limit rad, push N·m, band rad, friction N·m, half the backlash rad; z rad, friction's direction,
        side of the gap, the side that it goes to, 1 where it has been in touch: in this order, for the kernel"""
        self.offset = self.table[6]
        """z, rad (n,)"""
        self._remembered = self.table[6:]
        self._period = period

    def forget(self, joints: NDArray[np.bool_]) -> None:
        """Begin anew with these joints (n,): what was learned may have been a contact's."""
        self._remembered[:, joints] = 0.0

    def write(
        self,
        rows: NDArray[np.int64],
        position: Array,
        velocity: Array,
        gravity: Array,
        gains: Array,
        measured: Array,
        out: Array,
        mode: NDArray[np.uint8],
    ) -> None:
        """Joint impedance about `position`, `velocity` (m,) with gravity (n,), K (z + b s) and F d, moved on by a cycle.

        `gains` (2, n): stiffness, damping; `measured`, `out`, `mode`: JointState's table, JointCommand's table and mode.
        """
        _follow(rows, position, velocity, gravity, gains, measured, self.table, self._period, out, mode)


@compiled
def _follow(rows, position, velocity, gravity, gains, measured, table, period, out, mode):  # type: ignore[no-untyped-def]
    for i in range(rows.shape[0]):
        j = rows[i]
        error, carried, stiffness = position[i] - measured[0, j], measured[2, j] - gravity[j], gains[0, j]
        limit, push, band = table[1, j], table[2, j], table[3, j]
        friction, slack, z = table[4, j], table[5, j], table[6, j]
        ahead, crossing = 0.0, False
        if friction > 0.0:
            moved = velocity[i] * period / PRESLIDING
            if np.isfinite(moved):
                table[7, j] = min(max(table[7, j] + moved, -1.0), 1.0)
            ahead = friction * table[7, j]
            if slack > 0.0:
                turn = _TURN * friction if velocity[i] != 0.0 else _TURN_STANDING * friction
                needed = gravity[j] + ahead + stiffness * error
                crossing, found = _cross(measured[2, j], needed, turn, friction, period, table[8:, j])
                z = min(max(z + slack * found, -limit), limit)
                ahead += stiffness * slack * table[8, j]
        if not crossing and ((error > band and carried < push) or (error < -band and carried > -push)):
            beyond = error - band if error > 0.0 else error + band
            z = min(max(z + table[0, j] * beyond, -limit), limit)
        table[6, j] = z
        out[0, j], out[1, j], out[2, j], out[3, j], out[4, j], mode[j] = (
            position[i], velocity[i], gravity[j] + stiffness * z + ahead, stiffness, gains[1, j], _IMPEDANCE,
        )  # fmt: skip


@compiled
def _cross(carried, needed, turn, friction, period, gap):  # type: ignore[no-untyped-def]
    """Move the side of the gap on by a cycle. gap: side, where it goes, whether it has been in touch.

    Returns whether it was on its way, and by how much it was found to be another one than was thought.
    """
    side, to, found = gap[0], gap[1], 0.0
    if abs(carried) > _TOUCH * friction:
        to = 1.0 if carried > 0.0 else -1.0
        if gap[2] == 0.0:
            side, found, gap[2] = to, side - to, 1.0
    elif abs(needed) > turn:
        to = 1.0 if needed > 0.0 else -1.0
    step = 2.0 * period / (CROSSING if gap[2] == 1.0 else SEARCHING)
    gap[0], gap[1] = side + min(max(to - side, -step), step), to
    return side != to, found
