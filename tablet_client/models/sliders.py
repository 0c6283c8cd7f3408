"""An instance's parameters and joints as numbers within bounds, with the words and units of its template."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

from affordance_templates import catalogue
from affordance_templates.template import ResolvedJoint
from affordance_templates.template_schema import Parameter
from handrail.config import ConfigError


@dataclass(frozen=True)
class Slider:
    """A number that can be changed within bounds."""

    name: str
    title: str
    unit: str
    value: float
    low: float
    high: float
    step: float


@lru_cache(maxsize=32)
def schema(template: str) -> Mapping[str, Parameter]:
    with contextlib.suppress(ConfigError):
        return catalogue.load(template).parameters
    return {}


def of_parameter(name: str, value: float, parameter: Parameter | None) -> Slider:
    title = name.replace("_", " ")
    if parameter is None:
        return Slider(name, title, "", value, value, value, 0.0)
    low, high = parameter.min, parameter.max
    if not math.isfinite(low):
        low = min(0.0, 2 * value, 2 * parameter.default) - (0 if value >= 0 else 1)
    if not math.isfinite(high):
        high = max(1.0, 2 * abs(value), 2 * abs(parameter.default))
    step = 1.0 if parameter.integer else parameter.step or 0.0
    return Slider(name, parameter.title or title, parameter.unit, value, low, high, step)


def of_joint(name: str, value: float, joint: ResolvedJoint) -> Slider:
    turns = joint.kind != "prismatic"
    low = joint.lower if math.isfinite(joint.lower) else (-math.pi if turns else -0.5)
    high = joint.upper if math.isfinite(joint.upper) else (math.pi if turns else 0.5)
    return Slider(name, name.replace("_", " "), "rad" if turns else "m", value, min(low, value), max(high, value), 0.0)
