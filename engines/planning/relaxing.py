"""Which goals of a motion may give way, as a call says it, and what gave, as a plan tells it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from engines.planning.ik.constraints import CentreOfMass, Constraint, Direction, Gaze, Orientation, Pose, Position
from engines.planning.ik.report import Measure
from handrail.messages import PlanGave

_GOAL = re.compile(r"(goals\[\d+\])(?:\.(position|angle))?")


def prioritised(goals: Sequence[Constraint], relax: Sequence[str]) -> list[Constraint]:
    """Goals with priorities for the inverse kinematics: what `relax` names first gives way first.

    An entry is `goals[0]`, or its `.position` or `.angle` alone. Raises ValueError naming the entry and what was expected.
    """
    found = (
        [half for goal in goals for half in (goal.halves if isinstance(goal, Pose) else (goal,))] if relax else goals
    )
    names = list(dict.fromkeys(_goal_of(one) for one in found))
    for number, entry in enumerate(relax):
        read = _GOAL.fullmatch(entry)
        if read is None or read[1] not in names:
            known = ", ".join(names) or "none: goals[0] is the first of `goals`"
            raise ValueError(
                f"relax[{number}]: got {entry!r}; expected one of {known}, or its `.position` or `.angle` alone"
            )
        meant = [_goal_of(one) == read[1] and _is(one, read[2]) for one in found]
        if not any(meant):
            raise ValueError(f"relax[{number}]: got {entry!r}; expected {read[1]}, which has no {read[2]}")
        priority = len(relax) - number
        found = [
            replace(one, priority=one.priority or priority) if gives else one
            for one, gives in zip(found, meant, strict=True)
        ]
    return list(found)


def told(given: Sequence[Measure]) -> list[PlanGave]:
    """What gave, for clients."""
    return [
        PlanGave(goal=m.constraint, what=m.what, by=round(m.by, 5), unit="rad" if m.unit == "rad" else "m")
        for m in given
    ]


def _goal_of(one: Constraint) -> str:
    """goals[0], of a constraint that the goal's reader has named after its place."""
    return one.label.partition(" ")[0]


def _is(one: Constraint, part: str | None) -> bool:
    if part is None:
        return True
    return isinstance(one, (Position, CentreOfMass) if part == "position" else (Orientation, Direction, Gaze))
