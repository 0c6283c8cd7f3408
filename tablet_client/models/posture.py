"""Which posture of a robot meets several wishes at once: frames at poses, its centre of mass at a place, a camera
that looks somewhere.

The robot's own planner decides what is executed; this only has to be quick, beside a window that draws.
"""

from __future__ import annotations

import math
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
    bodies: tuple[str, ...]
    frames: Any

    def poses(self, positions: Array) -> Array: ...
    def centre_of_mass(self, poses: Array) -> Array: ...
    def leading(self, link: str) -> tuple[str, ...]: ...


class Wish(Protocol):
    """What a posture is to have."""

    def errors(self, chain: Chain, poses: Array) -> tuple[Array, Array]:
        """(k, a) m and (k, b) rad, how far off it is in each of k postures, whose bodies are at `poses` (k, bodies, 4, 4)."""


@dataclass(frozen=True)
class AtPose:
    """A link is at a pose."""

    link: str
    goal: Array
    """(4, 4)"""
    turn: str = "all"
    """what of its orientation counts: `all`, `none`, or `x`, `y`, `z`: that this axis of the link points as the goal's"""
    place: bool = True
    """whether its place counts"""

    def errors(self, chain: Chain, poses: Array) -> tuple[Array, Array]:
        frame = chain.frames[self.link]
        found = poses[:, frame.body] @ frame.pose_in_body
        away = found[:, :3, 3] - self.goal[:3, 3]
        return away if self.place else away[:, :0], _turned(found, self.goal, self.turn)


@dataclass(frozen=True)
class MassAt:
    """The centre of mass is at a place, along these axes."""

    goal: Array
    """(3,) m"""
    axes: tuple[int, ...] = (0, 1, 2)

    def errors(self, chain: Chain, poses: Array) -> tuple[Array, Array]:
        rows = list(self.axes)
        away = chain.centre_of_mass(poses)[:, rows] - self.goal[rows]
        return away, away[:, :0]


@dataclass(frozen=True)
class LooksAt:
    """An axis of a link points at a place."""

    link: str
    axis: Array
    """(3,) in the link"""
    goal: Array
    """(3,) m"""

    def errors(self, chain: Chain, poses: Array) -> tuple[Array, Array]:
        frame = chain.frames[self.link]
        eyes = poses[:, frame.body] @ frame.pose_in_body
        sight = self.goal - eyes[:, :3, 3]
        sight /= np.maximum(np.linalg.norm(sight, axis=1, keepdims=True), 1e-9)
        return sight[:, :0], _between(eyes[:, :3, :3] @ self.axis, sight)


@dataclass(frozen=True)
class Bounds:
    """The joints that may move, and how far."""

    rows: Array
    """(m,) of all joints"""
    lower: Array
    """(m,) rad or m"""
    upper: Array


def solve(chain: Chain, bounds: Bounds, wishes: Sequence[Wish], position: Array, *, root: str = "") -> Array:
    """(n,): the posture near `position` (n,) that is nearest to all wishes.

    Poses and places are seen from the robot's base, or from `root`, a link that stands still while the base moves.
    Damped least squares (Wampler 1986) with steps of at most 0.25 rad; joints that stand at a limit are left out.
    """
    found, rows = np.array(position, float), bounds.rows
    for _ in range(_STEPS):
        probes = np.repeat(found[None], len(rows) + 1, 0)
        probes[np.arange(len(rows)) + 1, rows] += _DIFFERENCE
        poses = seen(chain, probes, root)
        parts = [wish.errors(chain, poses) for wish in wishes]
        if all(_there(away[0], turned[0]) for away, turned in parts):
            break
        errors = np.concatenate([part for both in parts for part in both], 1)
        error = errors[0]
        jacobian = (errors[1:] - error).T / _DIFFERENCE
        at = found[rows]
        free, step = np.ones(len(at), bool), np.zeros(len(at))
        for _ in range(2):
            some = jacobian[:, free]
            step[:] = 0.0
            step[free] = -some.T @ np.linalg.solve(some @ some.T + _DAMPING**2 * np.eye(len(error)), error)
            stuck = free & (((at >= bounds.upper) & (step > 0)) | ((at <= bounds.lower) & (step < 0)))
            if not stuck.any():
                break
            free &= ~stuck
        step *= min(1.0, _LEAP / max(float(np.abs(step).max()), 1e-9))
        found[rows] = np.clip(at + step, bounds.lower, bounds.upper)
    return found


def missed(chain: Chain, wish: Wish, position: Array, *, root: str = "") -> tuple[float, float]:
    """m, rad: how far off a wish is in a posture (n,)."""
    away, turned = wish.errors(chain, seen(chain, position[None], root))
    return float(np.linalg.norm(away[0])), float(np.linalg.norm(turned[0]))


def seen(chain: Chain, positions: Array, root: str) -> Array:
    """(k, bodies, 4, 4): poses in postures (k, n), seen from the base, or from a link."""
    poses = chain.poses(positions)
    if not root:
        return poses
    frame = chain.frames[root]
    return np.asarray(np.linalg.inv(poses[:, frame.body] @ frame.pose_in_body)[:, None] @ poses)


def _there(away: Array, turned: Array) -> bool:
    return bool(np.linalg.norm(away) < _CLOSE and np.linalg.norm(turned) < _TURNED)


def _turned(found: Array, goal: Array, turn: str) -> Array:
    """(k, 0 or 3) rad, how far poses (k, 4, 4) are turned from the goal."""
    if turn == "none":
        return found[:, :0, 3]
    if turn in "xyz":
        axis = "xyz".index(turn)
        return _between(found[:, :3, axis], np.broadcast_to(goal[:3, axis], (len(found), 3)))
    between = found[:, :3, :3] @ goal[:3, :3].T
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
    turned = np.asarray(vector / 2 * np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 1.0))
    for row in np.flatnonzero(
        (sine < 1e-9) & (cosine < 0)
    ):  # turned over: the sines are 0, the axis is where R + I leads
        axes = between[row] + np.eye(3)
        axis = axes[:, int(np.argmax(np.diag(axes)))]
        turned[row] = math.pi * axis / np.linalg.norm(axis)
    return turned


def _between(axes: Array, wanted: Array) -> Array:
    """(k, 3): from directions (k, 3) to wanted ones; its length is the angle's sine, and goes on growing beyond 90°."""
    across = np.cross(wanted, axes)
    behind = np.einsum("ij,ij->i", axes, wanted) < 0
    lengths = np.linalg.norm(across, axis=1, keepdims=True)
    return np.where(behind[:, None], across / np.maximum(lengths, 1e-9) * (2 - lengths), across)
