"""What a template costs while it is dragged: ``handrail bench templates``. Its reachability:
`benchmarks.template_reach`; what it costs the link: `benchmarks.template_traffic`.

Expanded while a parameter of it is: every expression, joint, shape, feature and waypoint anew, with values that change each time;
CPU time of one core, the median.
"""

from __future__ import annotations

import math
import statistics
import time

from affordance_templates import catalogue
from affordance_templates.template_file import Template
from benchmarks import template_reach, template_traffic
from benchmarks.rows import Row

_ROUNDS = 100
_MOST_MS = 5.0


def rows() -> list[Row]:
    """One a template of the library, how often reachability is told, and what placed templates cost the link."""
    return [*expansions(), *template_reach.rows(), *template_traffic.rows()]


def expansions() -> list[Row]:
    """One a template of the library."""
    return [_row(name, catalogue.load(name)) for name in sorted(catalogue.files())]


def _row(name: str, template: Template) -> Row:
    dragged = next(
        each for each, parameter in template.parameters.items()
        if parameter.unit == "m" and math.isfinite(parameter.max - parameter.min)
    )  # fmt: skip
    bounds = template.parameters[dragged]
    taken = []
    for number in range(_ROUNDS):
        # About the default, where what depends on it has a value.
        value = bounds.default * (1 + 0.05 * math.sin(number))
        start = time.process_time_ns()
        resolved = template.resolve({dragged: min(max(value, bounds.min), bounds.max)})
        taken.append((time.process_time_ns() - start) * 1e-6)
    waypoints = sum(len(trajectory.waypoints) for trajectory in resolved.trajectories.values())
    median = statistics.median(taken)
    return Row(
        name=f"{name}: {len(resolved.shapes)} shapes, {waypoints} waypoints, {dragged} dragged",
        value=round(median, 3),
        unit="ms",
        goal=f"≤ {_MOST_MS:g} ms",
        holds=median <= _MOST_MS,
    )
