"""Which of a robot's drives answer and are in operation, as their host sees it: looked at after every batch of frames."""

from __future__ import annotations

import numpy as np

from hal.drives.borrowing import piece
from hal.drives.lifecycle import STATE_OF_STATUSWORD, State
from hal.drives.rows import device_state, joint_state
from handrail.compiled import compiled

LOST_AFTER = 50
"""cycles without an answer after which a drive counts as lost. More than the drives' own watchdog (20 cycles): where the host is
not heard, they have stopped by themselves by then; where only it does not hear, they go on following it meanwhile"""

_NEVER = 1 << 30
"""cycles; the age of a reply that never came grows no further"""
_OPERATION_ENABLED = int(State.OPERATION_ENABLED)


class DriveWatch:
    """What the host makes of n drives' ages and statuswords. Rows are −1 where there is none."""

    def __init__(self, n: int):
        self.memory = np.zeros((2 * n + 7) // 8, np.int64)
        """the arrays below, in one piece for kernels"""
        self.state, isolated = self.memory.view(np.uint8)[: 2 * n].reshape(2, n)
        """(n,) hal.drives.lifecycle.State"""
        self.isolated = isolated.view(np.bool_)
        """(n,) joints of limbs that are out of the robot: nobody waits for these to be in operation"""
        self.late = 0
        """drives whose reply is late, but that are not lost"""
        self.heard_ns = 0
        """when the first of the records that were heard last came, 0: there were none"""
        self.lost = self.silent = -1
        """first drive that does not answer, or is not in operation enabled, those of isolated limbs aside; first that does not
        answer"""


@compiled
def grow_older(joints, n, devices, d, cycles):  # type: ignore[no-untyped-def]
    """What was read last of n joints and d devices (memories as hal.joint and hal.device have them) is so many cycles older."""
    _, times, _, _ = joint_state(joints, n)
    times[0, :] += cycles
    _, device_times = device_state(devices, d)
    device_times[0, :] += cycles


@compiled
def survey(joints, n, watch):  # type: ignore[no-untyped-def]
    """Fill a DriveWatch's states; (late, lost, silent). watch: its memory."""
    marks = piece(watch, 0, (2 * n,), np.uint8)
    stale, lost, silent = 0, -1, -1
    _, times, status, _ = joint_state(joints, n)
    age = times[0]
    for j in range(n):
        marks[j] = STATE_OF_STATUSWORD[status[j] & 0x7F]
        age[j] = min(age[j], _NEVER)
        if age[j] > LOST_AFTER:
            silent = j if silent < 0 else silent
        elif age[j] > 0:
            stale += 1
        if lost < 0 and not marks[n + j] and (age[j] > LOST_AFTER or marks[j] != _OPERATION_ENABLED):
            lost = j
    return stale, lost, silent
