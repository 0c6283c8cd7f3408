"""Joints that turn without end: the same place is there once a turn, and the nearest of them is meant."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from engines.planning.ik.constraints import Constraint, Posture
from engines.planning.ik.mechanism import Mechanism

if TYPE_CHECKING:
    from engines.planning.motion import Motion

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

_TURN = 2.0 * np.pi


def endless_of(mechanism: Mechanism, joints: Iterable[str]) -> Integers:
    """Where in q those of the joints are that turn without end."""
    rows = [mechanism.row(joint) for joint in joints]
    found = [row for row in rows if mechanism.unit_of(row) == "rad" and not np.isfinite(mechanism.upper[row])]
    return np.array(mechanism.coordinate[found], np.int64)


def nearest_turn(q: Array, to: Array, columns: Integers) -> Array:
    """q (nq,) with those coordinates by as many whole turns elsewhere as brings them nearest to `to` (nq,)."""
    near = q.copy()
    near[columns] -= _TURN * np.round((q[columns] - to[columns]) / _TURN)
    return near


def told_by(constraint: Constraint) -> tuple[str, ...]:
    """The joints that a constraint puts somewhere, be it at their limits."""
    return tuple(constraint.coefficients) if isinstance(constraint, Posture) else ()


def unwound(motion: Motion, mechanism: Mechanism, start: Array) -> Motion:
    """The motion with goals of single joints that turn without end said in the turn that is the shortest way round: from `start`
    (nq,) to the first key frame that has one, and from there on.
    """
    columns = set(endless_of(mechanism, motion.moving).tolist())
    here = start.copy()

    def nearest(goals: Sequence[Constraint]) -> list[Constraint]:
        return [_nearest(goal, mechanism, here, columns) for goal in goals]

    if not columns:
        return motion
    keep, through = nearest(motion.keep), [nearest(goals) for goals in motion.through]
    return replace(motion, keep=keep, through=through, goals=nearest(motion.goals))


def _nearest(goal: Constraint, mechanism: Mechanism, here: Array, columns: set[int]) -> Constraint:
    """`here` is then where the goal has its joint."""
    if not isinstance(goal, Posture) or len(goal.coefficients) != 1:
        return goal
    ((joint, factor),) = goal.coefficients.items()
    column = int(mechanism.coordinate[mechanism.row(joint)])
    middle = (goal.lower + goal.upper) / 2.0 / factor
    if column not in columns or not np.isfinite(middle):
        return goal
    off = _TURN * float(np.round((here[column] - middle) / _TURN))
    here[column] = middle + off
    return replace(goal, lower=goal.lower + factor * off, upper=goal.upper + factor * off)
