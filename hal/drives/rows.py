"""What joints and devices keep in one piece of memory (hal.joint, hal.device), as the kernels see it."""

from __future__ import annotations

import numpy as np

from hal.device import MEASURED
from hal.drives.borrowing import borrowed
from handrail.compiled import compiled


@compiled
def joint_state(memory, n):
    """table (4, n), age and measured_ns (2, n), status (n,), error and sequence (2, n) of a JointState's memory"""
    memory = borrowed(memory)
    octets = memory[6 * n :].view(np.uint8)
    return (
        memory[: 4 * n].view(np.float64).reshape(4, n),
        memory[4 * n : 6 * n].reshape(2, n),
        octets[: 2 * n].view(np.uint16),
        octets[2 * n : 4 * n].reshape(2, n),
    )


@compiled
def joint_command(memory, n):
    """table (5, n), mode (n,) of a JointCommand's memory"""
    memory = borrowed(memory)
    return memory[: 5 * n].view(np.float64).reshape(5, n), memory[5 * n :].view(np.uint8)[:n]


@compiled
def device_state(memory, d):
    """values (d, MEASURED), age and measured_ns (2, d) of a DeviceState's memory"""
    memory = borrowed(memory)
    return memory[: MEASURED * d].view(np.float64).reshape(d, MEASURED), memory[MEASURED * d :].reshape(2, d)
