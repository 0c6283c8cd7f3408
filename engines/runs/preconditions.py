"""What has to hold so that a state can do, or go on with, what it does: asked before a pause ends, and told by name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from engines.plans.freshness import START_TOLERANCE


@dataclass(frozen=True)
class Precondition:
    """One of them, as it stands now."""

    what: str
    """as it should be: 'the plan starts at the robot's present posture'"""
    met: bool
    value: str = ""
    """as it is: 'arm_left_3_joint is 0.31 rad off'"""
    expected: str = ""
    """'at most 0.02 rad'"""

    def __str__(self) -> str:
        return f"{self.what}: {', '.join(part for part in (self.value, self.expected) if part)}"


def at_posture(
    what: str,
    joints: Sequence[str],
    wanted: NDArray[np.float64],
    here: NDArray[np.float64],
    tolerance: float = START_TOLERANCE,
) -> Precondition:
    """That each joint (m) is where it is wanted, (m,) rad, at most `tolerance` rad off; names the one that is furthest."""
    if not joints:
        return Precondition(what, True)
    off = np.abs(here - wanted)
    worst = int(off.argmax())
    met = bool(off[worst] <= tolerance)  # NaN is not
    return Precondition(what, met, f"{joints[worst]} is {off[worst]:.2f} rad off", f"at most {tolerance:g} rad")
