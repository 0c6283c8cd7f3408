"""What a stroke's goals may give way by, on request: first one, then the others as well, each no further than it must."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from engines.planning.constraints import REACH, TILT, Constraint
from engines.planning.plan import Infeasible, Plan
from engines.planning.strokes.tip_solver import Reach
from handrail.messages import PlanGave

_MOST = {"tilt": 1.2, "reach": 0.10}
"""rad, m: what may be missed where a part gives way as far as it can"""
_HALVINGS = 5
"""of what gives last, in proportion: to a fifteenth of it"""
_GIVES = 0.1
"""weight of the tool's axis against its tip where the axis gives way; the other way round where the tip does"""


@dataclass(frozen=True)
class Leeway:
    """Bounds of a stroke's goals."""

    reach: Constraint = REACH
    tilt: Constraint = TILT
    pointing: float = 1.0
    """what the tool's axis counts for against its tip, as a factor"""

    @classmethod
    def of(cls, parts: Sequence[str], share: float) -> Leeway:
        """All but the last of these parts give way as far as they can, the last by that share of it (0 to 1, in proportion)."""
        bounds = {"reach": REACH, "tilt": TILT}
        for part in parts:
            bound, how_far = bounds[part].bound, share if part == parts[-1] else 1.0
            bounds[part] = replace(bounds[part], bound=bound * (_MOST[part] / bound) ** how_far)
        return cls(**bounds, pointing=_GIVES if parts[0] == "tilt" else 1.0 / _GIVES)


def check_relax(relax: Sequence[str]) -> None:
    """Raises ValueError naming the entry and what was expected."""
    for number, entry in enumerate(relax):
        if entry not in _MOST or entry in relax[:number]:
            raise ValueError(f"relax[{number}]: got {entry!r}; expected {' or '.join(_MOST)}, each once")


def relaxed(plan: Callable[[Leeway], Plan], relax: Sequence[str]) -> Plan:
    """The plan; where there is none the one whose parts, in the order of `relax`, give least. Raises Infeasible as `plan` did."""
    try:
        return plan(Leeway())
    except Infeasible as problem:
        first = problem
    for count in range(1, len(relax) + 1):
        try:
            found = plan(Leeway.of(relax[:count], 1.0))
        except Infeasible:
            continue
        none, enough = 0.0, 1.0
        for _ in range(_HALVINGS):
            middle = (none + enough) / 2
            try:
                found, enough = plan(Leeway.of(relax[:count], middle)), middle
            except Infeasible:
                none = middle
        return found
    raise first


def gave(ways: Sequence[tuple[str, Reach]]) -> tuple[PlanGave, ...]:
    """What ways, each to a waypoint, miss beyond what a stroke may without being asked, where it is most."""
    found = []
    for constraint, what in ((TILT, "angle"), (REACH, "distance")):
        missed = [float((reach.tilt if what == "angle" else reach.residual).max()) for _, reach in ways]
        most = max(missed)
        if most > constraint.bound:
            goal = f"{constraint.name} on the way to {ways[missed.index(most)][0]}"
            found.append(
                PlanGave(
                    goal=goal, what=what, by=round(most - constraint.bound, 5), unit="rad" if what == "angle" else "m"
                )
            )
    return tuple(found)
