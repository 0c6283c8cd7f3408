"""A plan's figures for the operator: what it keeps at its worst, on the way to which waypoint, and how that stands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from handrail.messages import PlanPreview, PlanWaypoint, PlanWorst
from tablet_client.models.quantities import in_unit

_MET = 0.0005
"""m: a residual that is shown as none"""


@dataclass(frozen=True)
class Measure:
    """One measure that a plan's waypoints have."""

    code: str
    """its field in PlanWaypoint, and its word in qml/Words.qml"""
    unit: str
    warning: float
    """from here on it is coloured: worth a look"""
    danger: float
    """from here on it is red: hardly any room"""

    @property
    def least_is_worst(self) -> bool:
        return self.danger < self.warning

    def level(self, value: float) -> str:
        """good, warning or danger: names of the theme's colours."""
        sign = 1.0 if self.least_is_worst else -1.0
        for level, bound in (("danger", self.danger), ("warning", self.warning)):
            if sign * value <= sign * bound:
                return level
        return "good"

    def text(self, value: float) -> str:
        return f"{100 * value:.0f} %" if self.unit == "share" else in_unit(self.unit, value)


CLEARANCE = Measure("clearance", "m", 0.03, 0.015)
MEASURES = (
    CLEARANCE,
    Measure("residual", "m", 0.003, 0.006),
    Measure("limit_margin", "rad", 0.06, 0.03),
    Measure("torque_share", "share", 0.7, 0.85),
)


@dataclass(frozen=True)
class Figure:
    """The worst of one measure over a plan."""

    code: str
    text: str
    level: str
    where: str
    """waypoint; empty: not known which"""
    about: str
    """the joint or the two bodies"""
    at: float
    """s into the plan; -1: not known"""

    @property
    def decides(self) -> bool:
        """Whether a decision hangs on it: torque is only told where it is high."""
        return self.code != "torque_share" or self.level != "good"


def figures(plan: PlanPreview) -> list[Figure]:
    """One a measure that was taken, in the order in which people read them."""
    found = []
    for measure in MEASURES:
        taken = [(value, waypoint) for waypoint in plan.waypoints if (value := _value(waypoint, measure)) is not None]
        if taken:
            pick: Callable[..., tuple[float, PlanWaypoint]] = min if measure.least_is_worst else max
            value, waypoint = pick(taken, key=lambda pair: pair[0])
            worst = getattr(waypoint, measure.code)
            at, about = (worst.time, worst.about) if isinstance(worst, PlanWorst) else (waypoint.time, "")
            if measure.code == "residual" and value < _MET:  # all goals are met: no waypoint is worse than others
                waypoint_name, at = "", -1.0
            else:
                waypoint_name = waypoint.name
            found.append(Figure(measure.code, measure.text(value), measure.level(value), waypoint_name, about, at))
        elif (whole := getattr(plan, measure.code, None)) is not None:  # a plan that says no more of itself
            found.append(Figure(measure.code, measure.text(whole), measure.level(whole), "", "", -1.0))
    pressing = [waypoint for waypoint in plan.waypoints if waypoint.force_limit is not None]
    if pressing:
        most = max(pressing, key=lambda waypoint: waypoint.force_limit or 0.0)
        text = in_unit("n", most.force_limit or 0.0)
        found.append(Figure("force_limit", text, "good", most.name, "", most.time))
    return found


def level_of(plan: PlanPreview, segment: str) -> str:
    """How a segment stands in the measure in which it stands worst; good where nothing was measured."""
    levels = [
        measure.level(value)
        for waypoint in plan.waypoints
        if waypoint.name == segment
        for measure in MEASURES
        if (value := _value(waypoint, measure)) is not None
    ]
    return max(levels, key=("good", "warning", "danger").index, default="good")


def _value(waypoint: PlanWaypoint, measure: Measure) -> float | None:
    found = getattr(waypoint, measure.code)
    return found.value if isinstance(found, PlanWorst) else found
