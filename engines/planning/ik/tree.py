"""A robot's joints as arrays, and where they are, for compiled kernels that solve goal after goal.

A call into pinocchio from Python costs ten times the arithmetic of one arm. The numbers come from pinocchio's model once, and tests
compare both.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from engines.planning.ik.mechanism import Mechanism
from handrail.compiled import compiled

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


class Tree(NamedTuple):
    """The joints that move, m of them, each after the one that carries it; a named tuple because numba takes one as it is."""

    joints: Integers
    """(m,) pinocchio's numbers"""
    parents: Integers
    """(m,) numbers of the joints that carry them; 0: the base"""
    velocities: Integers
    """(m,) where in a velocity each is"""
    order: Integers
    """(m,) where in a row of positions each is"""
    rotations: Array
    """(m, 3, 3) each joint's frame in the one that carries it, at zero"""
    translations: Array
    """(m, 3) m"""
    axes: Array
    """(m, 3) unit axis in the joint's own frame"""
    turns: NDArray[np.bool_]
    """(m,) whether it is revolute; else it is prismatic"""


def tree_of(mechanism: Mechanism, moving: Sequence[str]) -> Tree:
    """The tree of the joints named. Raises ValueError where one hangs on a joint that is not among them."""
    model, data = mechanism.model, mechanism.model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    number = {int(row): joint for joint, row in enumerate(model.idx_vs) if joint}
    order = {number[mechanism.row(name)]: k for k, name in enumerate(moving)}
    joints = sorted(order)  # pinocchio's numbers grow from the base on
    axes = np.empty((len(joints), 3))
    turns = np.empty(len(joints), np.bool_)
    for k, joint in enumerate(joints):
        if (before := model.parents[joint]) and before not in order:
            raise ValueError(
                f"moving: got {model.names[joint]} without {model.names[before]}, on which it hangs; "
                "expected all joints from the base on"
            )
        column = pin.getJointJacobian(model, data, joint, pin.LOCAL)[:, model.idx_vs[joint]]
        turns[k] = column[3:].any()
        axes[k] = column[3:] if turns[k] else column[:3]
    placements = [model.jointPlacements[joint] for joint in joints]
    return Tree(
        np.array(joints, np.int64),
        np.array([model.parents[joint] for joint in joints], np.int64),
        np.array([model.idx_vs[joint] for joint in joints], np.int64),
        np.array([order[joint] for joint in joints], np.int64),
        np.ascontiguousarray([placement.rotation for placement in placements]),
        np.ascontiguousarray([placement.translation for placement in placements]),
        axes,
        turns,
    )


@compiled
def place(tree: Tree, q: Array, placement: Array, jacobian: Array) -> None:
    """Where the joints are at q (m,) rad (m), written in place as pinocchio would.

    `placement` (joints, 12): rotation by columns, translation. `jacobian` (nv, 6): of what is at the world's origin, in world axes;
    linear, angular. Loops, not products of small matrices: they run faster and compile in a fifth of the time.
    """
    base = np.zeros(12)
    base[0], base[4], base[8] = 1.0, 1.0, 1.0
    before = np.empty((3, 3))
    for i in range(tree.joints.shape[0]):
        carrier = placement[tree.parents[i]] if tree.parents[i] > 0 else base
        here = placement[tree.joints[i]]
        x, y, z = tree.axes[i]
        for a in range(3):
            here[9 + a] = carrier[9 + a]
            for b in range(3):
                here[9 + a] += carrier[3 * b + a] * tree.translations[i, b]
                before[a, b] = 0.0
                for c in range(3):
                    before[a, b] += carrier[3 * c + a] * tree.rotations[i, c, b]
        row = jacobian[tree.velocities[i]]
        angle = q[tree.order[i]]
        if tree.turns[i]:
            cos, sin = np.cos(angle), np.sin(angle)
            rest = 1.0 - cos
            for a in range(3):  # times Rodrigues' rotation about the axis
                p, r, s = before[a]
                here[a] = p * (cos + rest * x * x) + r * (rest * x * y + sin * z) + s * (rest * x * z - sin * y)
                here[3 + a] = p * (rest * x * y - sin * z) + r * (cos + rest * y * y) + s * (rest * y * z + sin * x)
                here[6 + a] = p * (rest * x * z + sin * y) + r * (rest * y * z - sin * x) + s * (cos + rest * z * z)
                row[3 + a] = p * x + r * y + s * z
            for a in range(3):
                b, c = (a + 1) % 3, (a + 2) % 3
                row[a] = here[9 + b] * row[3 + c] - here[9 + c] * row[3 + b]
        else:
            for a in range(3):
                row[a] = before[a, 0] * x + before[a, 1] * y + before[a, 2] * z
                row[3 + a] = 0.0
                here[9 + a] += row[a] * angle
                for b in range(3):
                    here[3 * b + a] = before[a, b]
