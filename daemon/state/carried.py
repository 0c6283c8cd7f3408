"""One frame, along the joints that carry it: where it is commanded to be and how fast, and where it is measured to be.

Twice the whole robot's forward kinematics for one frame of one arm costs more than anything else that a cycle does with a motion;
here it is one call, over the frame's own chain.
"""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from daemon.wbc import dynamics
from daemon.wbc.dynamics import AXIS, ON_P, ON_R, TURNS, turned
from daemon.wbc.memory import Array, Integers
from daemon.wbc.vectors import FAST, add, cross, dot, minus, nine, product, put, rotate, three, times
from handrail.compiled import compiled

STANDING = 1e-6
"""m/s: slower than this, a path has no direction of its own"""
_ROW, _WIDTH = 16, 17
"""Columns of a link in the chain: as a body's of daemon.wbc.dynamics up to here, then which of the robot's joints it hangs at."""
_LAG, _SPEED, _HERE, _JOINTS = 0, 3, 6, 9
"""Places in what is known: m by which the frame lags, m/s as commanded, m where it is, then axis and origin of each joint."""


class CarriedFrame:
    """Of one robot; frames are seen from the model's root, in its axes."""

    def __init__(self, model: pin.Model, rows: Integers, frame: int):
        """`rows` (n,): which velocity each of the robot's joints has; `frame`: its number in the model."""
        carried, bodies = model.frames[frame], dynamics.bodies(model)
        chain = [joint for joint in model.supports[carried.parentJoint] if joint]
        self._links = np.zeros((len(chain) + 1, _WIDTH))
        """(k + 1, _WIDTH): the joints from the root on, then the frame itself"""
        for link, joint in zip(self._links, chain, strict=False):
            link[:_ROW] = bodies[joint, :_ROW]
            place = np.flatnonzero(rows == model.idx_vs[joint])
            link[_ROW] = place[0] if len(place) else -1
        self._links[-1, ON_R : ON_R + 9] = carried.placement.rotation.ravel()
        self._links[-1, ON_P : ON_P + 3] = carried.placement.translation
        self._known = np.zeros(_JOINTS + 6 * len(chain))
        self.lag, self.velocity, self.translation = self._known[:_JOINTS].reshape(3, 3)
        """m, commanded minus measured; m/s as commanded; m as measured: (3,) each, the next `follow` overwrites them"""

    def follow(self, commanded: Array, measured: Array) -> None:
        """`commanded`, `measured`: JointCommand.table, JointState.table."""
        _follow(self._links, commanded, measured, self._known)

    def pull(
        self, tangent: Array, force: float, gain: float, limit: float, claimed: NDArray[np.bool_], torque: Array
    ) -> float:
        """Push the frame along its path: `torque` (n,) ← Jᵀ F t̂, N·m, of joints that are `claimed` (n,), and 0 of others.

        Returns F, N, moved on by `gain` · t̂·lag within 0..limit. `tangent` (3,), t̂, becomes the direction of the commanded
        velocity, unless there is none (`STANDING`).
        """
        known = self._known
        return _pull(self._links, known, tangent, force, gain, limit, claimed, torque)  # type: ignore[no-any-return]


@compiled(fastmath=FAST, error_model="numpy")
def _follow(links, commanded, measured, known):  # type: ignore[no-untyped-def]
    """First as commanded, then as measured: of each joint its axis and its origin, at last the frame's own."""
    last = links.shape[0] - 1
    aim, velocity, here = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for look in range(2):
        told = commanded if look == 0 else measured
        r, p = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
        for k in range(last):
            link, row = links[k], int(links[k, _ROW])
            p = add(p, rotate(r, three(link, ON_P)))
            r = product(r, nine(link, ON_R))
            axis, angle = three(link, AXIS), told[0, row] if row >= 0 else 0.0
            along = rotate(r, axis)
            put(known, _JOINTS + 6 * k, along)
            put(known, _JOINTS + 6 * k + 3, p)
            if link[TURNS] > 0.0:
                r = product(r, turned(axis, angle))
            else:
                p = add(p, times(angle, along))
        here = add(p, rotate(r, three(links[last], ON_P)))
        if look == 0:
            aim = here
            for k in range(last):
                row, axis = int(links[k, _ROW]), three(known, _JOINTS + 6 * k)
                if row >= 0:
                    arm = minus(here, three(known, _JOINTS + 6 * k + 3))
                    way = cross(axis, arm) if links[k, TURNS] > 0.0 else axis
                    velocity = add(velocity, times(commanded[1, row], way))
    put(known, _LAG, minus(aim, here))
    put(known, _SPEED, velocity)
    put(known, _HERE, here)


@compiled(fastmath=FAST, error_model="numpy")
def _pull(links, known, tangent, force, gain, limit, claimed, torque):  # type: ignore[no-untyped-def]
    velocity, here = three(known, _SPEED), three(known, _HERE)
    speed = math.sqrt(dot(velocity, velocity))
    if speed > STANDING:
        put(tangent, 0, times(1.0 / speed, velocity))
    along = three(tangent, 0)
    force = min(max(force + gain * dot(along, three(known, _LAG)), 0.0), limit)
    for j in range(torque.shape[0]):
        torque[j] = 0.0
    for k in range(links.shape[0] - 1):
        row, axis = int(links[k, _ROW]), three(known, _JOINTS + 6 * k)
        if row >= 0 and claimed[row]:
            arm = minus(here, three(known, _JOINTS + 6 * k + 3))
            torque[row] = force * dot(cross(axis, arm) if links[k, TURNS] > 0.0 else axis, along)
    return force
