"""What each foot bears of what the ground must give, and whether the ground can give that: friction and centre of pressure.

The least forces of all that do (minimum-norm; Righetti et al. 2013, Optimal Distribution of Contact Forces with Inverse-dynamics
Control), moments over the soles' half lengths counted as forces. Where those slip or tip a foot, the least that do not: a
quadratic program with a contact's wrench cone (Caron, Pham and Nakamura 2015, without the coupling of shear and torsion), as
whole-body control has it. A robot falls only where there are none.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import daqp
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from engines.planning.ik.report import Measure
from handrail.robot.description import Foot

Array = NDArray[np.float64]

FRICTION = 0.5
"""of the ground, that is relied on: as the compound tasks of robots on their feet do"""
EDGE = 0.01
"""m within the sole's edges that the centre of pressure stays, likewise"""
TORSION = 0.02
"""m: friction's moment about a sole's normal over the normal force, likewise"""
_LIGHT = 1.0
"""N that a foot bears at least for a centre of pressure to speak of"""
_SENSE = {"inequality": 0, "equality": 5}
"""daqp's kinds of rows"""


def ease(foot: Foot) -> Array:
    """(6,) how willingly a foot bears forces, and moments (m²: those over its sole's half lengths are forces)."""
    length, width = foot.size
    return np.array([1.0, 1.0, 1.0, (width / 2) ** 2, (length / 2) ** 2, (length / 2) ** 2])


def least(feet: Sequence[Foot], soles: Sequence[pin.SE3], whole: pin.Force) -> list[pin.Force]:
    """What each foot bears of `whole`, on its own axes, whatever the ground can give: the least squares."""
    spread, sizes = _spread(feet, soles)
    found = sizes * np.linalg.lstsq(spread, whole.vector, rcond=None)[0]
    return [pin.Force(each) for each in found.reshape(-1, 6)]


def borne(feet: Sequence[Foot], soles: Sequence[pin.SE3], whole: pin.Force) -> list[pin.Force]:
    """The same of forces that the ground can give; where there are none, the least all the same: `figures` tell what they miss."""
    found = least(feet, soles, whole)
    if not any(figure.by for figure in figures(feet, found)):
        return found
    spread, sizes = _spread(feet, soles)
    rows = np.zeros((10 * len(feet), 6 * len(feet)))
    for number, foot in enumerate(feet):
        rows[10 * number : 10 * number + 10, 6 * number : 6 * number + 6] = _cone(foot)
    matrix = np.vstack([spread, rows * sizes])
    above = np.concatenate([whole.vector, np.zeros(len(rows))])
    below = np.concatenate([whole.vector, np.full(len(rows), -np.inf)])
    kinds = np.array([_SENSE["equality"]] * 6 + [_SENSE["inequality"]] * len(rows), np.int32)
    n = len(sizes)
    x, _, flag, _ = daqp.solve(np.eye(n), np.zeros(n), np.ascontiguousarray(matrix), above, below, kinds)
    if flag < 1:
        return found
    return [pin.Force(each) for each in (sizes * np.asarray(x)).reshape(-1, 6)]


def figures(feet: Sequence[Foot], forces: Sequence[pin.Force]) -> Iterator[Measure]:
    """How near each foot is to lifting, slipping and tipping under its force, on its own axes."""
    for foot, force in zip(feet, forces, strict=True):
        name, (x, y, z), (roll, pitch, yaw) = f"{foot.name} foot", force.linear.tolist(), force.angular.tolist()
        yield Measure("load of the feet", name, z, 0.0, math.inf, "N")
        if z < _LIGHT:  # who bears next to nothing neither slips nor tips, if it takes nothing sideways either
            yield Measure("force of a foot without load", name, math.hypot(x, y, roll, pitch, yaw), 0.0, _LIGHT, "N")
            continue
        length, width = foot.size
        yield Measure("friction cone", name, math.hypot(x, y) / z, 0.0, FRICTION, "N/N")
        for axis, off, half in (("x", -pitch / z, length / 2 - EDGE), ("y", roll / z, width / 2 - EDGE)):
            yield Measure("centre of pressure", f"{name}, {axis}", off, -half, half, "m")
        yield Measure("friction about the normal", name, yaw / z, -TORSION, TORSION, "m")


def _spread(feet: Sequence[Foot], soles: Sequence[pin.SE3]) -> tuple[Array, Array]:
    """(6, 6k): of what feet bear, over their sizes, the whole in the world; (6k,) the sizes."""
    sizes = np.concatenate([np.sqrt(ease(foot)) for foot in feet])
    return np.hstack([sole.toActionMatrixInverse().T for sole in soles]) * sizes, sizes


def _cone(foot: Foot) -> Array:
    """(10, 6), whose product with a foot's force is nowhere above 0 where the ground can give it: a pyramid within the cone."""
    length, width = foot.size
    shares = [FRICTION / math.sqrt(2.0)] * 2 + [width / 2 - EDGE, length / 2 - EDGE, TORSION]
    rows = np.zeros((10, 6))
    for number, (column, share) in enumerate(zip((0, 1, 3, 4, 5), shares, strict=True)):
        for side, sign in enumerate((1.0, -1.0)):
            rows[2 * number + side, column] = sign
            rows[2 * number + side, 2] = -share
    return rows
