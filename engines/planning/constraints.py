"""What a way of the arm must keep, how much is wanted beyond it, and which constraint is worst."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from engines.planning.plan import Infeasible
from handrail.robot.guarding import Guarding


@dataclass(frozen=True)
class Constraint:
    """A bound on a measure of a way. `scale`: so much beyond the bound counts as one, which makes different units comparable."""

    name: str
    unit: str
    bound: float
    scale: float
    at_least: bool
    """True: the measure must not fall below the bound; False: must not exceed it"""

    def slack(self, value: float) -> float:
        """By how much the bound is kept; negative when it is missed. Unit of the measure."""
        return value - self.bound if self.at_least else self.bound - value


REACH = Constraint("reach of the tool's tip", "m", 0.003, 0.003, at_least=False)
TILT = Constraint("tilt of the tool against its wanted axis", "rad", 0.15, 0.15, at_least=False)
LIMIT_MARGIN = Constraint("margin to the joint limits", "rad", 0.015, 0.15, at_least=True)
JOINT_STEP = Constraint("joint motion between neighbouring poses", "rad", 0.5, 0.45, at_least=False)
MANIPULABILITY = Constraint("manipulability", "m/rad", 0.04, 0.12, at_least=True)
"""smallest singular value of the tip's position Jacobian over the arm's own joints"""
TORQUE = Constraint("joint torque under gravity and the contact force", "of the limit", 0.85, 0.5, at_least=False)
CLEARANCE = Constraint("clearance from the template's object", "m", 0.02, 0.04, at_least=True)
SELF_CLEARANCE = Constraint("clearance of the robot from itself", "m", Guarding().planned, 0.04, at_least=True)
"""what the loop's guard wants where a robot's file says nothing of it, and some more, so that it stops nothing which was planned"""


def self_clearance(guard: Guarding) -> Constraint:
    """The same for a robot whose file may say otherwise: the daemon's guard goes by that file, too."""
    return replace(SELF_CLEARANCE, bound=guard.planned)


Measures = Mapping[Constraint, float]


def merit(measures: Measures) -> float:
    """The least scaled slack: at least 0 when every constraint is kept, more when all are kept with room."""
    return min(constraint.slack(value) / constraint.scale for constraint, value in measures.items())


def worst(measures: Measures, where: str = "", detail: Mapping[Constraint, str] | None = None) -> Infeasible | None:
    """The constraint that is missed most (in its scale), or None when all are kept. `detail` adds words to its name."""
    constraint = min(measures, key=lambda one: one.slack(measures[one]) / one.scale)
    slack = constraint.slack(measures[constraint])
    if slack >= 0.0:
        return None
    between = f"({detail[constraint]}) " if detail and constraint in detail else ""
    relation = "at least" if constraint.at_least else "at most"
    found = f"{between}is {measures[constraint]:.3g} {constraint.unit}, {relation} {constraint.bound:g} allowed"
    return Infeasible(constraint.name, -slack, constraint.unit, where, found)
