"""Where an arm's tip is, and which posture would bring it elsewhere: enough to show where a finger drags it, and to nudge it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tablet_client.models.posture import AtPose, Bounds, Chain, missed, solve
from tablet_client.models.view import Array


@dataclass(frozen=True)
class Solution:
    """A posture, and how far what was dragged is from where it should be."""

    position: Array
    """(n,) rad or m, all of the robot's joints in the chain's order"""
    off: float
    """m"""
    turned: float
    """rad"""
    lost: str = ""
    """what does not hold there of that which is to be kept (`whole_body.KEPT`)"""

    @property
    def reached(self) -> bool:
        """Within half a millimetre and a fifth of a degree, and all holds that is to be kept."""
        return close(self.off, self.turned) and not self.lost


def close(off: float, turned: float) -> bool:
    """Whether m and rad count as nothing."""
    return off < 5e-4 and turned < 3.5e-3


class Limb:
    """An arm's own joints and its tip."""

    def __init__(self, chain: Chain, tip: str, joints: Sequence[str], lower: Array, upper: Array):
        """`joints`: those that may move; `lower`, `upper` (n,) rad or m: of all joints in the chain's order."""
        self._chain, self._frame = chain, chain.frames[tip]
        self.link = tip
        self.joints = tuple(joints)
        self.rows = np.array([chain.joints.index(joint) for joint in joints], int)
        self._bounds = Bounds(self.rows, lower[self.rows], upper[self.rows])

    def tip(self, position: Array) -> Array:
        """(..., 4, 4) in the robot's base, of postures (..., n)."""
        return np.asarray(self._chain.poses(position)[..., self._frame.body, :, :] @ self._frame.pose_in_body)

    def solve(self, position: Array, goal: Array, *, turn: str = "all") -> Solution:
        """The posture near `position` (n,) whose tip is nearest to `goal` (4, 4), in the robot's base; joints stay within limits.

        `turn`: what of its orientation counts (`AtPose`).
        """
        wish = AtPose(self.link, goal, turn)
        found = solve(self._chain, self._bounds, [wish], position)
        return Solution(found, *missed(self._chain, wish, found))
