"""What nodes that are no joints are to everything above the bus: one row of numbers a device, SI units, whatever carries them.

Which columns a row has is the family's business: its description (hal/drives/FAMILY/family.yaml) names them, with units.
Handrail's own families:

============= ===================================================================== =========================================
family        measured                                                              commanded
============= ===================================================================== =========================================
imu           orientation_x … _w, angular_velocity_x … _z rad/s,                    nothing
              linear_acceleration_x … _z m/s² (with gravity, as REP 145 says)
force_torque  force_x … _z N, torque_x … _z N·m, in the device's link's frame       nothing
gripper       position (rad or m), velocity, effort (N·m or N), temperature °C      position, velocity, effort (all ≥ 0 but
              state (CiA 402 number), holding (1: stopped by something)              position), enable (0 or 1)
power         voltage V, current A, charge 0..1, temperature °C, relay (1: closed)  relay
============= ===================================================================== =========================================
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

MEASURED, COMMANDED = 16, 8
"""Columns that a device's rows have room for."""

SILENT_AFTER = 250
"""cycles without a frame after which a device counts as silent: five times the longest period (power: 50 cycles)"""

GRIPPER_COMMANDED = ("position", "velocity", "effort", "enable")
"""The gripper family's commanded columns, by number."""


class DeviceState:
    """What was last measured; one row a device, in the description's order."""

    def __init__(self, n: int):
        self.memory = np.zeros((MEASURED + 2) * n, np.int64)
        """everything below, in one piece for kernels"""
        self.values = self.memory[: MEASURED * n].view(np.float64).reshape(n, MEASURED)
        """the family's measured columns, in its order; the rest 0"""
        self.age, self.measured_ns = self.memory[MEASURED * n :].reshape(2, n)
        """cycles since the last valid frame; when it was measured, on the clock of whoever runs the bus, but for the shortest time
        that such a frame takes on its way. Views of `memory`: never rebind them"""
        self.age[:] = 1 << 30

    def __len__(self) -> int:
        return len(self.age)


class DeviceCommand:
    """What is about to be written; one row a device, in the description's order."""

    def __init__(self, n: int, memory: npt.NDArray[np.int64] | None = None):
        """memory: where it lies, in a piece (`words` of n,) of zeros that holds more; left out, in one of its own."""
        self.memory = np.zeros(self.words(n), np.int64) if memory is None else memory
        """everything below, in one piece for kernels"""
        self.values = self.memory[: COMMANDED * n].view(np.float64).reshape(n, COMMANDED)
        """the family's commanded columns, in its order"""
        self.commanded = self.memory[COMMANDED * n :].view(np.bool_)[:n]
        """devices that somebody commands: the others are not written to"""

    @staticmethod
    def words(n: int) -> int:
        """How long its memory is."""
        return COMMANDED * n + (n + 7) // 8

    def __len__(self) -> int:
        return len(self.commanded)
