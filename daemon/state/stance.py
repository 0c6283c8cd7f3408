"""What standing asks of a robot's joints, and how far it is from falling: by its centre of mass over the feet that hold."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from daemon.state.base_state import BaseSource, BaseState
from daemon.state.invariant_filter import GRAVITY
from handrail.compiled import compiled
from handrail.robot.kinematics import Kinematics
from handrail.robot.model_memory import placements

Array = NDArray[np.float64]

_BEARING_HZ = 5.0
"""of the share of its weight that the robot's feet bear"""
_DIRECTIONS = 24
"""along which the capture point's distance from the feet's hull is looked at: it is 1 % too little at most"""
_LEAST_HEIGHT = 0.1
"""m, of the centre of mass over the feet"""


class Stance:
    """The feet of one robot, cycle by cycle.

    The capture point is c + ċ / ω with the centre of mass c over the feet, ω = √(g / height): where a robot that moves like a
    linear inverted pendulum has to put its centre of pressure to come to a stand (Pratt et al. 2006; Hof et al. 2005, as the
    extrapolated centre of mass). Beyond the hull of the feet that hold it falls, unless it steps or swings its arms.
    """

    def __init__(self, kinematics: Kinematics, base: BaseState, period: float):
        """`base`: as its estimator writes it; `period`: of the loop, s."""
        model, feet = kinematics.model, kinematics.description.feet
        self._model, self._base, self._rows = model, base, kinematics.index_v
        self._data = model.createData()
        self._placement = placements(self._data.oMi)
        frames = [model.frames[kinematics.frame_id(foot.link)] for foot in feet]
        chains = [[j for i in model.supports[frame.parentJoint] if i for j in (model.idx_vs[i],)] for frame in frames]
        self._chains = np.full((len(feet), 1 + max(map(len, chains))), -1, np.int64)
        self._feet = np.zeros((len(feet), 14))
        """of each: its frame on its joint (rotation by rows, m), half its length and width, m"""
        for row, (frame, chain, foot) in enumerate(zip(frames, chains, feet, strict=True)):
            self._chains[row, : 1 + len(chain)] = frame.parentJoint, *chain
            half = 0.5 * np.array(foot.size)
            self._feet[row] = np.concatenate((frame.placement.rotation.ravel(), frame.placement.translation, half))
        weight = GRAVITY * float(pin.computeTotalMass(model))
        self._memory = np.array([0.0, -math.inf, 1.0 - math.exp(-2.0 * math.pi * _BEARING_HZ * period), weight])
        self._torque = np.zeros(model.nv)

    @property
    def bearing(self) -> float:
        """Share of its weight that its feet bear, behind a low-pass."""
        return float(self._memory[0])

    @property
    def outside(self) -> float:
        """m by which the capture point is outside the hull of the feet that hold, inside: negative; infinite where none holds."""
        return float(self._memory[1])

    def update(self, q: Array, v: Array) -> None:
        """Once a cycle; q, v: the model's (nq,), (nv,), as measured."""
        base, data = self._base, self._data
        pin.centerOfMass(self._model, data, q, v)
        _stand(
            base.source[0] == BaseSource.FEET,
            base.memory,
            self._feet,
            self._chains,
            data.com[0],
            data.vcom[0],
            self._placement,
            pin.computeJointJacobians(self._model, data),
            self._memory,
            self._torque,
        )

    def relieve(self, gravity: Array) -> None:
        """Take from the joints' gravity torques (n,) N·m what the feet's forces do for them: vertical ones, in balance with the
        weight where the centre of mass is."""
        gravity -= self._torque[self._rows]


@compiled(error_model="numpy")
def _stand(known, base, feet, chains, com, speed, placement, jacobian, memory, torque):  # type: ignore[no-untyped-def]
    """memory (bearing, outside, gain, weight) and torque (nv,) ← the stance; base: BaseState.memory."""
    n = feet.shape[0]
    told, contact = base[: 15 + 3 * n].view(np.float64), base[18 + 3 * n :]
    torque[:] = 0.0
    borne, holding = 0.0, 0
    for foot in range(n):
        if known and contact[foot]:
            borne, holding = borne + told[15 + 3 * foot + 2] / memory[3], holding + 1
    memory[0] += memory[2] * (min(max(borne, 0.0), 1.0) - memory[0])
    if not holding:
        memory[1] = math.inf
        return
    x, y, z, w = told[3], told[4], told[5], told[6]
    turn, place, lowest = np.empty((3, 3)), np.empty((n, 3)), math.inf
    turn[0, 0], turn[0, 1], turn[0, 2] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
    turn[1, 0], turn[1, 1], turn[1, 2] = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
    turn[2, 0], turn[2, 1], turn[2, 2] = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
    sides, inside = np.empty((n, 2, 2)), np.empty((n, 3))
    """soles' x and y axes, along the world's x and y; soles in the base, m"""
    for foot in range(n):
        joint, frame = placement[chains[foot, 0]], feet[foot]
        for i in range(3):
            inside[foot, i] = joint[9 + i]
            for j in range(3):
                inside[foot, i] += joint[3 * j + i] * frame[9 + j]
        for i in range(3):
            place[foot, i] = 0.0
            for j in range(3):
                place[foot, i] += turn[i, j] * inside[foot, j]
        for axis in range(2):
            for i in range(2):
                side = 0.0
                for j in range(3):
                    for k in range(3):
                        side += turn[i, j] * joint[3 * k + j] * frame[3 * k + axis]
                sides[foot, axis, i] = side
        if contact[foot]:
            lowest = min(lowest, place[foot, 2])
    moving, c, v = np.empty(3), np.zeros(3), np.zeros(3)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        moving[i] = told[7 + i] + told[10 + j] * com[k] - told[10 + k] * com[j] + speed[i]
    for i in range(3):
        for j in range(3):
            c[i] += turn[i, j] * com[j]
            v[i] += turn[i, j] * moving[j]
    falls = math.sqrt(max(c[2] - lowest, _LEAST_HEIGHT) / GRAVITY)
    most = -math.inf
    for k in range(_DIRECTIONS):
        angle = 2.0 * math.pi * k / _DIRECTIONS
        nx, ny, reach = math.cos(angle), math.sin(angle), -math.inf
        for foot in range(n):
            if contact[foot]:
                far = nx * place[foot, 0] + ny * place[foot, 1]
                for axis in range(2):
                    far += feet[foot, 12 + axis] * abs(nx * sides[foot, axis, 0] + ny * sides[foot, axis, 1])
                reach = max(reach, far)
        most = max(most, nx * (c[0] + falls * v[0]) + ny * (c[1] + falls * v[1]) - reach)
    memory[1] = most

    # Two feet share the weight as a beam's ends do; the pressure's centre lies under the centre of mass.
    share = np.full(n, 1.0 / holding)
    if holding == 2 and n == 2:
        ax, ay = place[1, 0] - place[0, 0], place[1, 1] - place[0, 1]
        along = (c[0] - place[0, 0]) * ax + (c[1] - place[0, 1]) * ay
        share[1] = min(max(along / max(ax * ax + ay * ay, 1e-6), 0.0), 1.0)
        share[0] = 1.0 - share[1]
    offx, offy = c[0], c[1]
    for foot in range(n):
        if contact[foot]:
            offx, offy = offx - share[foot] * place[foot, 0], offy - share[foot] * place[foot, 1]
    f, p = np.empty(3), np.empty(3)
    for foot in range(n):
        if not contact[foot]:
            continue
        for i in range(3):
            f[i] = turn[2, i] * share[foot] * memory[3] * memory[0]
            p[i] = inside[foot, i] + turn[0, i] * offx + turn[1, i] * offy
        for k in range(1, chains.shape[1]):
            j = chains[foot, k]
            if j < 0:
                break
            for i in range(3):
                a, b = (i + 1) % 3, (i + 2) % 3
                torque[j] += jacobian[i, j] * f[i] + jacobian[3 + i, j] * (p[a] * f[b] - p[b] * f[a])
