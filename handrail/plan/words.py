"""A plan's figures in words for people: millimetres, degrees, per cent."""

from __future__ import annotations

import math
from collections.abc import Callable

from handrail.messages import PlanOrigin, PlanPreview, PlanWaypoint, PlanWorst

_MET = 1e-4
"""m and rad"""
WORST_COLOUR = "#d64545"
_FORMS: dict[str, tuple[float, str, str]] = {
    "clearance": (1000.0, ".0f", " mm"),
    "residual": (1000.0, ".2f", " mm"),
    "tilt": (180.0 / math.pi, ".1f", "°"),
    "limit_margin": (180.0 / math.pi, ".1f", "°"),
    "torque_share": (100.0, ".0f", " %"),
}
"""measure → factor, format, unit shown"""


def figure_of(measure: str, value: float | None) -> str:
    """('clearance', 0.024) → '24 mm'; a dash for None."""
    if value is None:
        return "–"
    factor, form, unit = _FORMS[measure]
    return f"{factor * value:{form}}{unit}"


def value_of(waypoint: PlanWaypoint, measure: str) -> float | None:
    """A waypoint's figure of a measure; None where it was not measured."""
    found = getattr(waypoint, measure)
    return found.value if isinstance(found, PlanWorst) else found


def worst_of(plan: PlanPreview, measure: str) -> PlanWaypoint | None:
    """The waypoint that is worst in a measure; None where it was not measured, or where every goal is met as well as can be."""
    if measure in {"residual", "tilt"} and all((value_of(each, measure) or 0.0) < _MET for each in plan.waypoints):
        return None
    measured = [(value, each) for each in plan.waypoints if (value := value_of(each, measure)) is not None]
    least_is_worst = measure in {"clearance", "limit_margin"}
    pick: Callable[..., tuple[float, PlanWaypoint]] = min if least_is_worst else max
    return pick(measured, key=lambda pair: pair[0])[1] if measured else None


def asked_for(origin: PlanOrigin) -> str:
    """What a plan was asked for: 'instance wheel_1, trajectory turn, arc 0.7854'."""
    return ", ".join(
        f"{name} {value:.4g}" if isinstance(value, float) else f"{name} {value}" for name, value in origin.asked.items()
    )


def short(text: str, length: int) -> str:
    """A text cut to a length."""
    return text if len(text) <= length else f"{text[: length - 1]}…"
