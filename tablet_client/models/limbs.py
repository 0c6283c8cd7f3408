"""Where an arm's tip is, and which posture would bring it elsewhere: enough to show where a finger drags it, and to nudge it.

The robot's own planner decides what is executed; this only has to be quick, beside a window that draws.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from tablet_client.models.view import Array

_STEPS = 40
_DAMPING = 1e-3  # of the least squares: m, rad
_LEAP = 0.25  # rad, that a joint goes in a step at most
_CLOSE, _TURNED = 5e-5, 5e-4  # m, rad: there
_DIFFERENCE = 1e-6  # rad


class Chain(Protocol):
    """Forward kinematics (scene/kinematics.py)."""

    joints: tuple[str, ...]
    frames: Any

    def poses(self, positions: Array) -> Array: ...


@dataclass(frozen=True)
class Solution:
    """A posture, and how far its tip is from where it should be."""

    position: Array
    """(n,) rad or m, all of the robot's joints in the chain's order"""
    off: float
    """m"""
    turned: float
    """rad"""

    @property
    def reached(self) -> bool:
        """Within half a millimetre and a fifth of a degree."""
        return self.off < 5e-4 and self.turned < 3.5e-3


class Limb:
    """An arm's own joints and its tip."""

    def __init__(self, chain: Chain, tip: str, joints: Sequence[str], lower: Array, upper: Array):
        """`joints`: those that may move; `lower`, `upper` (n,) rad or m: of all joints in the chain's order."""
        self._chain, self._frame = chain, chain.frames[tip]
        self.joints = tuple(joints)
        self.rows = np.array([chain.joints.index(joint) for joint in joints], int)
        self._lower, self._upper = lower[self.rows], upper[self.rows]

    def tip(self, position: Array) -> Array:
        """(..., 4, 4) in the robot's base, of postures (..., n)."""
        return np.asarray(self._chain.poses(position)[..., self._frame.body, :, :] @ self._frame.pose_in_body)

    def solve(self, position: Array, goal: Array, *, turn: str = "all") -> Solution:
        """The posture near `position` (n,) whose tip is nearest to `goal` (4, 4), in the robot's base; joints stay within limits.

        `turn`: what of its orientation counts: `all`, `none`, or `x`, `y`, `z`: that this axis of the tip points as the goal's.
        Damped least squares (Wampler 1986) with steps of at most 0.25 rad.
        """
        found = np.array(position, float)
        for _ in range(_STEPS):
            probes = np.repeat(found[None], len(self.rows) + 1, 0)
            probes[np.arange(len(self.rows)) + 1, self.rows] += _DIFFERENCE
            errors = _errors(self.tip(probes), goal, turn)
            error = errors[0]
            if np.linalg.norm(error[:3]) < _CLOSE and np.linalg.norm(error[3:]) < _TURNED:
                break
            jacobian = (errors[1:] - error).T / _DIFFERENCE
            # A joint that stands at its limit and would be sent beyond is left out.
            at = found[self.rows]
            free = np.ones(len(at), bool)
            step = np.zeros(len(at))
            for _ in range(2):
                some = jacobian[:, free]
                step[:] = 0.0
                step[free] = -some.T @ np.linalg.solve(some @ some.T + _DAMPING**2 * np.eye(len(error)), error)
                stuck = free & (((at >= self._upper) & (step > 0)) | ((at <= self._lower) & (step < 0)))
                if not stuck.any():
                    break
                free &= ~stuck
            step *= min(1.0, _LEAP / max(float(np.abs(step).max()), 1e-9))
            found[self.rows] = np.clip(at + step, self._lower, self._upper)
        last = _errors(self.tip(found)[None], goal, turn)[0]
        return Solution(found, float(np.linalg.norm(last[:3])), float(np.linalg.norm(last[3:])))


def _errors(tips: Array, goal: Array, turn: str) -> Array:
    """(k, 3 or 6): how far tips (k, 4, 4) are from the goal, m, and turned from it, rad, as sines of half angles say it."""
    away = tips[:, :3, 3] - goal[:3, 3]
    if turn == "none":
        return away
    if turn in "xyz":
        axis = "xyz".index(turn)
        across = np.cross(np.broadcast_to(goal[:3, axis], (len(tips), 3)), tips[:, :3, axis])
        behind = tips[:, :3, axis] @ goal[:3, axis] < 0  # turned by more than 90°: the sine falls again
        lengths = np.linalg.norm(across, axis=1, keepdims=True)
        across = np.where(behind[:, None], across / np.maximum(lengths, 1e-9) * (2 - lengths), across)
        return np.concatenate([away, across], 1)
    between = tips[:, :3, :3] @ goal[:3, :3].T
    vector = np.stack(
        [
            between[:, 2, 1] - between[:, 1, 2],
            between[:, 0, 2] - between[:, 2, 0],
            between[:, 1, 0] - between[:, 0, 1],
        ],
        1,
    )
    sine = np.linalg.norm(vector, axis=1, keepdims=True) / 2
    cosine = (np.trace(between, axis1=1, axis2=2)[:, None] - 1) / 2
    angle = np.arctan2(sine, cosine)
    return np.concatenate([away, vector / 2 * np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 1.0)], 1)
