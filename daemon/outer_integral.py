"""The integral on the joint encoders' error, around the loops that close in the drives.

A drive whose own loop closes on an angle measured at its motor holds that angle, and backlash, the calibration of its sensor and
friction keep the joint elsewhere. After Fallon et al., "An Architecture for Online Affordance-based Perception and Whole-body
Planning" (J. Field Robotics 2015), §6, eq. 2 and 3: the drive follows q_ref = q_des + z with ż = K_i (q_des − q_enc).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hal.joint import Mode
from handrail.compiled import compiled
from handrail.robot.description import IntegralGains

Array = NDArray[np.float64]

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
        self.table = np.array([gains.rate * period, gains.limit, gains.push, gains.band, zero])
        """(5, n): rate a cycle, limit rad, push N·m, band rad, z rad: in this order, for the kernel"""
        self.offset = self.table[4]
        """z, rad (n,)"""

    def forget(self, joints: NDArray[np.bool_]) -> None:
        """Begin anew with these joints (n,): what was learned may have been a contact's."""
        self.offset[joints] = 0.0

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
        """Joint impedance about `position`, `velocity` (m,) with gravity (n,) and K z, z moved on by a cycle.

        `gains` (2, n): stiffness, damping; `measured`, `out`, `mode`: JointState's table, JointCommand's table and mode.
        """
        _follow(rows, position, velocity, gravity, gains, measured, self.table, out, mode)


@compiled
def _follow(rows, position, velocity, gravity, gains, measured, integral, out, mode):  # type: ignore[no-untyped-def]
    for i in range(rows.shape[0]):
        j = rows[i]
        error, carried = position[i] - measured[0, j], measured[2, j] - gravity[j]
        limit, push, band, z = integral[1, j], integral[2, j], integral[3, j], integral[4, j]
        if (error > band and carried < push) or (error < -band and carried > -push):
            beyond = error - band if error > 0.0 else error + band
            z = min(max(z + integral[0, j] * beyond, -limit), limit)
            integral[4, j] = z
        out[0, j], out[1, j], out[2, j], out[3, j], out[4, j], mode[j] = (
            position[i], velocity[i], gravity[j] + gains[0, j] * z, gains[0, j], gains[1, j], _IMPEDANCE,
        )  # fmt: skip
