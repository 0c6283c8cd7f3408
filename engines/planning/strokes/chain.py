"""The serial chain from the fixed base to a tool's tip, as arrays for compiled kernels.

Inverse kinematics evaluates the chain some 10⁵ times a plan; a call into pinocchio from Python costs ten times the arithmetic. The
numbers come from pinocchio's model once, and tests compare both.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from handrail.compiled import compiled
from handrail.robot.description import Arm
from handrail.robot.kinematics import Kinematics

Array = NDArray[np.float64]


class Chain(NamedTuple):
    """m revolute joints in series; a named tuple because numba takes one as it is."""

    rotations: Array
    """(m, 3, 3) each joint's frame in the one before it, at zero"""
    translations: Array
    """(m, 3) m"""
    axes: Array
    """(m, 3) unit axis in the joint's own frame"""
    tip_rotation: Array
    """(3, 3) tip frame in the last joint's frame"""
    tip_translation: Array
    """(3,) m"""


def chain_of(kinematics: Kinematics, arm: Arm) -> Chain:
    """The chain of an arm. Raises ValueError when its joints are not in series from the base, or not revolute."""
    model = kinematics.model
    ids = [model.getJointId(name) for name in arm.joints]
    for row, (joint, name) in enumerate(zip(ids, arm.joints, strict=True)):
        before = ids[row - 1] if row else 0
        if model.parents[joint] != before:
            raise ValueError(
                f"arm {arm.name}: {name} hangs on {model.names[model.parents[joint]]}, not on {model.names[before]}; "
                "its joints must be in series, from the base to the tool"
            )
    tip = model.frames[kinematics.frame_id(arm.tip)]
    if tip.parentJoint != ids[-1]:
        raise ValueError(f"arm {arm.name}: tip {arm.tip} is not on the link of {arm.joints[-1]}")
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    axes = []
    for joint, name in zip(ids, arm.joints, strict=True):
        column = pin.getJointJacobian(model, data, joint, pin.LOCAL)[:, model.idx_vs[joint]]
        if not np.isclose(np.linalg.norm(column[3:]), 1.0):
            raise ValueError(f"arm {arm.name}: {name} is not revolute")
        axes.append(column[3:])
    placements = [model.jointPlacements[joint] for joint in ids]
    return Chain(
        np.ascontiguousarray([placement.rotation for placement in placements]),
        np.ascontiguousarray([placement.translation for placement in placements]),
        np.ascontiguousarray(axes),
        np.ascontiguousarray(tip.placement.rotation),
        np.ascontiguousarray(tip.placement.translation),
    )


@compiled
def tip_of(chain: Chain, q: Array, origins: Array, directions: Array, tip: Array, pointing: Array) -> None:
    """The tip's position `tip` (3,) m and `pointing` direction (3,) in the world at q (m,) rad, written in place.

    Fills the joints' `origins` (m, 3) and axis `directions` (m, 3) in the world, from which the Jacobian follows. Loops, not
    products of small matrices: they run faster and compile in a fifth of the time.
    """
    rotation = np.eye(3)
    before = np.empty((3, 3))
    here = np.zeros(3)
    for i in range(q.shape[0]):
        for a in range(3):
            for b in range(3):
                here[a] += rotation[a, b] * chain.translations[i, b]
                before[a, b] = 0.0
                for c in range(3):
                    before[a, b] += rotation[a, c] * chain.rotations[i, c, b]
        x, y, z = chain.axes[i]
        for a in range(3):
            origins[i, a] = here[a]
            directions[i, a] = before[a, 0] * x + before[a, 1] * y + before[a, 2] * z
        cos, sin = np.cos(q[i]), np.sin(q[i])
        rest = 1.0 - cos
        for a in range(3):  # times Rodrigues' rotation about the axis
            p, r, s = before[a]
            rotation[a, 0] = p * (cos + rest * x * x) + r * (rest * x * y + sin * z) + s * (rest * x * z - sin * y)
            rotation[a, 1] = p * (rest * x * y - sin * z) + r * (cos + rest * y * y) + s * (rest * y * z + sin * x)
            rotation[a, 2] = p * (rest * x * z + sin * y) + r * (rest * y * z - sin * x) + s * (cos + rest * z * z)
    for a in range(3):
        tip[a] = here[a]
        pointing[a] = 0.0
        for b in range(3):
            tip[a] += rotation[a, b] * chain.tip_translation[b]
            pointing[a] -= rotation[a, b] * chain.tip_rotation[b, 2]
