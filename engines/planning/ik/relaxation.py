"""Which constraints give way, in which order, and the constraints that are left when they have.

"Optionally, the planner could successively relax constraints, such as end-effector pose, until a feasible plan was found" (Fallon
et al. 2015, §4.1).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace

from engines.planning.ik import constraints as kinds
from engines.planning.ik.constraints import Constraint
from engines.planning.ik.report import Measure

_ROOM = 5e-4
"""m, rad beyond what had to be given: at the very edge of its reach an arm has no way to move"""


def stages(constraints: Sequence[Constraint]) -> Iterator[set[int]]:
    """Numbers of the constraints that may give way: first those of the largest priority, then those of the next as well, ..."""
    soft: set[int] = set()
    for priority in sorted({c.priority for c in constraints if c.priority}, reverse=True):
        soft = soft | {number for number, c in enumerate(constraints) if c.priority == priority}
        yield set(soft)


def granted(
    constraints: Sequence[Constraint], soft: Collection[int], measure: Callable[[Constraint], list[Measure]]
) -> list[Constraint]:
    """All constraints, those that may give way with bounds as wide as what they measure now, but no wider than need be."""
    found: list[Constraint] = []
    for number, constraint in enumerate(constraints):
        if number in soft:
            found.extend(_widened(constraint, measure))
        else:
            found.append(constraint)
    return found


def _widened(c: Constraint, measure: Callable[[Constraint], list[Measure]]) -> list[Constraint]:
    match c:
        case kinds.Pose():
            return [wide for half in c.halves for wide in _widened(half, measure)]
        case kinds.Position() | kinds.CentreOfMass():
            lower, upper = list(c.lower), list(c.upper)
            for one in measure(c):
                axis = "xyz".index(one.what)
                lower[axis], upper[axis] = _wide(one)
            return [replace(c, lower=(lower[0], lower[1], lower[2]), upper=(upper[0], upper[1], upper[2]))]
        case kinds.Orientation():
            return [replace(c, angle=min(_wide(measure(c)[0])[1], math.pi))]
        case kinds.Direction() | kinds.Gaze():
            return [replace(c, cone=min(_wide(measure(c)[0])[1], math.pi))]
        case kinds.PointDistance() | kinds.BodyDistance() | kinds.Posture():
            lower_one, upper_one = _wide(measure(c)[0])
            return [replace(c, lower=lower_one, upper=upper_one)]
        case kinds.Balance():
            return [replace(c, margin=_wide(measure(c)[0])[0])]
        case kinds.Clearance():
            worst = measure(c)[0]
            less = worst.lower - _wide(worst)[0]
            return [replace(c, at_least=c.at_least - less, itself=None if c.itself is None else c.itself - less)]
        case kinds.JointLimits():
            short = max((one.by for one in measure(c)), default=0.0)
            return [replace(c, margin=max(c.margin - short - _ROOM, 0.0))]
    raise TypeError(f"got {type(c).__name__}; expected one of engines.planning.ik.constraints")


def _wide(one: Measure) -> tuple[float, float]:
    lower = one.lower if one.value >= one.lower else one.value - _ROOM
    upper = one.upper if one.value <= one.upper else one.value + _ROOM
    return lower, upper
