"""What joints and devices keep in one piece of memory (hal.joint, hal.device), as the kernels see it.

All raise ValueError where the memory is too short for so many: it is another robot's.
"""

from __future__ import annotations

import numpy as np

from hal.device import COMMANDED, MEASURED
from hal.drives.borrowing import piece
from handrail.compiled import compiled


@compiled
def joint_state(memory, n):
    """table (4, n), age and measured_ns (2, n), status (n,), error and sequence (2, n) of a JointState's memory"""
    if memory.shape[0] < 6 * n + (n + 1) // 2:
        raise ValueError("JointState: fewer joints than the robot has")
    octets = piece(memory, 6 * n, (4 * n,), np.uint8)
    return (
        piece(memory, 0, (4, n), np.float64),
        piece(memory, 4 * n, (2, n), np.int64),
        piece(memory, 6 * n, (n,), np.uint16),
        piece(octets, 2 * n, (2, n), np.uint8),
    )


@compiled
def joint_command(memory, n, first=0):
    """table (5, n), mode (n,) of a JointCommand's memory, or of one that begins at item `first`"""
    if memory.shape[0] < first + 5 * n + (n + 7) // 8:
        raise ValueError("JointCommand: fewer joints than the robot has")
    return piece(memory, first, (5, n), np.float64), piece(memory, first + 5 * n, (n,), np.uint8)


@compiled
def device_state(memory, d):
    """values (d, MEASURED), age and measured_ns (2, d) of a DeviceState's memory"""
    if memory.shape[0] < (MEASURED + 2) * d:
        raise ValueError("DeviceState: fewer devices than the robot has")
    return piece(memory, 0, (d, MEASURED), np.float64), piece(memory, MEASURED * d, (2, d), np.int64)


@compiled
def device_command(memory, d, first=0):
    """values (d, COMMANDED), commanded (d,) of a DeviceCommand's memory, or of one that begins at item `first`"""
    if memory.shape[0] < first + COMMANDED * d + (d + 7) // 8:
        raise ValueError("DeviceCommand: fewer devices than the robot has")
    return piece(memory, first, (d, COMMANDED), np.float64), piece(memory, first + COMMANDED * d, (d,), np.uint8)
