"""Goals with room in them, narrowed to places somewhere in it: nothing may lead to the place that is nearest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from engines.planning.ik.constraints import Constraint, Direction, Orientation, Pose, Position, Posture

_PART = 0.1
"""of its room, that a goal is narrowed to"""
_TURN = math.pi / 6
"""rad about an axis that a frame is free to turn about, to either side of a place"""


def sampled(goals: Sequence[Constraint], generator: np.random.Generator) -> list[Constraint]:
    """Goals that say no less than these, each that has room narrowed to a tenth of it; empty where none has."""
    found = [part for goal in goals for part in _narrowed(goal, generator)]
    return found if any(one not in goals for one in found) else []


def _narrowed(goal: Constraint, generator: np.random.Generator) -> list[Constraint]:
    match goal:
        case Pose() if _has_room(goal.lower, goal.upper) or goal.angle > 0.0:
            return [part for half in goal.halves for part in _narrowed(half, generator)]
        case Position() if _has_room(goal.lower, goal.upper):
            sides = [_part(*bounds, generator) for bounds in zip(goal.lower, goal.upper, strict=True)]
            (x, a), (y, b), (z, c) = sides
            return [replace(goal, lower=(x, y, z), upper=(a, b, c))]
        case Posture() if _has_room((goal.lower,), (goal.upper,)):
            lower, upper = _part(goal.lower, goal.upper, generator)
            return [replace(goal, lower=lower, upper=upper)]
        case Orientation() if 0.0 < goal.angle < math.pi:
            x, y, z, w = goal.target
            way = (1.0 - _PART) * goal.angle * generator.uniform() ** (1 / 3)
            turned = pin.Quaternion(w, x, y, z).matrix() @ pin.exp3(way * _somewhere(generator))
            return [replace(goal, target=_quaternion(turned), angle=_PART * goal.angle)]
        case Direction() if goal.cone < math.pi:
            return _pointed(goal, generator)
    return [goal]


def _pointed(goal: Direction, generator: np.random.Generator) -> list[Constraint]:
    """An axis within its cone, and what is free to turn about it near some angle."""
    direction = np.array(goal.direction) / np.linalg.norm(goal.direction)
    across = np.cross(direction, _somewhere(generator))
    lean = (1.0 - _PART) * goal.cone * math.sqrt(generator.uniform()) / max(float(np.linalg.norm(across)), 1e-9)
    direction = pin.exp3(lean * across) @ direction
    upright = pin.Quaternion.FromTwoVectors(np.array(goal.axis), direction).matrix()
    turned = pin.exp3(generator.uniform(-math.pi, math.pi) * direction) @ upright
    x, y, z = direction.tolist()
    narrow = replace(goal, direction=(x, y, z), cone=_PART * goal.cone)
    turn = Orientation(
        frame=goal.frame, in_frame=goal.in_frame, target=_quaternion(turned), angle=_TURN + _PART * goal.cone,
        name=goal.label, window=goal.window,
    )  # fmt: skip
    return [narrow, turn]


def _has_room(lower: Sequence[float], upper: Sequence[float]) -> bool:
    return any(a < b and math.isfinite(b - a) for a, b in zip(lower, upper, strict=True))


def _part(lower: float, upper: float, generator: np.random.Generator) -> tuple[float, float]:
    """Bounds within bounds; the same where there is no room, or no end to it."""
    if not (lower < upper and math.isfinite(upper - lower)):
        return lower, upper
    begin = generator.uniform(lower, upper - _PART * (upper - lower))
    return begin, begin + _PART * (upper - lower)


def _somewhere(generator: np.random.Generator) -> np.ndarray:
    """A unit vector, all ways alike."""
    found: np.ndarray = generator.normal(size=3)
    return found / np.linalg.norm(found)


def _quaternion(rotation: np.ndarray) -> tuple[float, float, float, float]:
    x, y, z, w = pin.Quaternion(rotation).coeffs().tolist()
    return x, y, z, w
