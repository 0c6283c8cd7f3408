"""From accelerations and torques to what a drive with an impedance takes: τ, q, q̇, K, D (Radford et al. 2015, §5.2.4)."""

from __future__ import annotations

import numpy as np

from daemon.wbc import moving
from daemon.wbc.memory import Array, Integers, Memory


class Easing:
    """Keeps what is told from jumping where the solution does: where bounds become active, or a level singular, its answer to
    the next state may be another one altogether.

    While the solver's damping is up, a step of more than `rate` · T of a joint's rated torque in one cycle is not told: the
    difference is, and it shrinks by as much in a cycle. So torques change by at most 2 · `rate` · T, but for what joints' bounds
    of acceleration ask for, which hold in every cycle; and where nothing jumps, what is told is the solution itself.
    """

    def __init__(self, torques: Array, solver: Memory, period: float, rate: float = 5.0):
        """`torques` (m,) N·m, rated; `rate` times rated per s."""
        self._eased = np.zeros((4, len(solver["mass"])))
        self.arguments = torques, solver["settings"][0], rate * period, solver["bound"], solver["mass"], self._eased

    def start(self) -> None:
        """The next solution is told as it is."""
        self._eased[:] = np.nan


class ImpedanceOutput:
    """Desired joint positions and velocities that go with the torques: q̈ integrated, and drawn back to what is measured.

    q̇_d += T (q̈ + λ (q̇ − q̇_d)),  q_d += T (q̇_d + λ (q − q_d)): without the leak λ, 1/s, every error of the model would
    pile up in q_d; with it, a constant one stands at q̈_error / λ² beside the robot, and stiffness K about q_d then helps
    instead of pulling away. The torque that leaves the drive, τ + K (q_d − q) + D (q̇_d − q̇), differs from the solver's τ by
    what the last two say; `within` bounds q_d − q, so that they never say more than it times K.
    """

    def __init__(
        self, joints: int, period: float, *, leak: float = 20.0, within: float = 0.05, rows: Integers | None = None
    ):
        """`period` s of the loop; `within` rad; `rows` (joints,): where the joints are among the solver's accelerations
        (none: just so). Raises ValueError for a leak that the period is too long for."""
        if not 0.0 <= leak * period < 1.0:
            raise ValueError(f"leak: got {leak:g} 1/s at a period of {period:g} s; expected their product from 0 to 1")
        self._rows: Integers = np.arange(joints) if rows is None else rows
        self.settings = period, leak, within
        self.desired = np.zeros((2, joints))
        self.position, self.velocity = self.desired
        """rad, rad/s (n,): desired"""

    def start(self, position: Array, velocity: Array) -> None:
        """From a command: no jump."""
        self.position[:], self.velocity[:] = position, velocity

    def advance(self, acceleration: Array, position: Array, velocity: Array) -> None:
        """One period on: q̈ of the solver, the measured position and velocity (n,). What is not finite changes nothing."""
        moving.lead(self.desired, acceleration, self._rows, position, velocity, *self.settings)
