"""What a joint is to everything above the bus: arrays with one row a joint, SI units, whatever carries them."""

from __future__ import annotations

import enum

import numpy as np
import numpy.typing as npt

MEASURED = ("position", "velocity", "torque", "temperature")
"""Rows of `JointState.table`."""
COMMANDED = ("position", "velocity", "torque", "stiffness", "damping")
"""Rows of `JointCommand.table`."""


class Mode(enum.IntEnum):
    """What a drive does with its set-point; two bits of a command frame."""

    DAMPING = 0
    """torque = −damping · velocity"""
    TORQUE = 1
    """spring torque follows `torque`"""
    IMPEDANCE = 2
    """torque + stiffness (position − q) + damping (velocity − q̇)"""
    POSITION = 3
    """the drive's own position loop"""


class JointState:
    """What was last measured. All arrays have shape (n,), but for `memory` and `table`, whose views they are: never rebind them."""

    def __init__(self, n: int):
        self.memory = np.zeros(6 * n + (n + 1) // 2, np.int64)
        """everything below, in one piece for kernels: 4n float64, 2n int64, n uint16, 2n uint8"""
        octets = self.memory[6 * n :].view(np.uint8)
        self.table = self.memory[: 4 * n].view(np.float64).reshape(len(MEASURED), n)
        """the rows `MEASURED`, so that all of them can be copied at once; the four arrays below are views of them"""
        self.position, self.velocity, self.torque, self.temperature = self.table
        """rad, at the joint; rad/s; N·m, of the drive's spring; °C"""
        self.status = octets[: 2 * n].view(np.uint16)
        """CiA 402 statusword (hal.drives.lifecycle)"""
        self.error, self.sequence = octets[2 * n : 4 * n].reshape(2, n)
        """drive family's error code, 0: none; sequence number of the command that this answers"""
        self.age, self.measured_ns = self.memory[4 * n : 6 * n].reshape(2, n)
        """cycles since the command was sent that the last valid reply answers; when it was measured, on the clock of whoever runs
        the bus, but for the shortest time that such a reply takes on its way"""
        self.age[:] = 1 << 30

    def __len__(self) -> int:
        return len(self.position)


class JointCommand:
    """What is about to be written. All arrays have shape (n,), but for `memory` and `table`, whose views they are, as above."""

    def __init__(self, n: int, memory: npt.NDArray[np.int64] | None = None):
        """memory: where it lies, in a piece (`words` of n,) of zeros that holds more; left out, in one of its own."""
        self.memory = np.zeros(self.words(n), np.int64) if memory is None else memory
        """everything below, in one piece: 5n float64, n uint8"""
        self.table = self.memory[: 5 * n].view(np.float64).reshape(len(COMMANDED), n)
        """the rows `COMMANDED`, for what looks at all of them at once; the five arrays below are views of them"""
        self.position, self.velocity, self.torque, self.stiffness, self.damping = self.table
        """rad; rad/s; N·m, feed-forward; N·m/rad; N·m·s/rad"""
        self.mode = self.memory[5 * n :].view(np.uint8)[:n]
        """Mode"""

    @staticmethod
    def words(n: int) -> int:
        """How long its memory is."""
        return len(COMMANDED) * n + (n + 7) // 8

    def __len__(self) -> int:
        return len(self.position)

    def copy_from(self, other: JointCommand) -> None:
        """Take over all of another command's set-points, in place."""
        self.memory[...] = other.memory

    def follow(self, state: JointState) -> None:
        """Become the command of a robot that nobody commands: where it is, with no torque and no gains."""
        self.table[...] = 0.0
        self.position[...] = state.position
        self.mode[...] = Mode.DAMPING
