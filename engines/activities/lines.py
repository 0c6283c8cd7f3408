"""Lines from where a hand stands to a waypoint: where they end, and how long they take."""

from __future__ import annotations

import math

import numpy as np

from affordance_templates.binding import BoundWaypoint
from affordance_templates.placement import Array, placed, shortest_turn, to_message, turn_about, turn_between

SPEED = 0.10
"""m/s, where a waypoint names no speed"""
_TURN = 0.8
"""rad/s"""
_LEAST_S = 0.3
BEYOND = 0.03
"""m that a guarded way goes on past its waypoint: the object may stand a little further away"""
_HERE, _TURNED = 0.001, 0.01
"""m, rad: a hand so near is there"""
_EXACT = math.radians(5.0)
"""a tolerance of where a tool points up to which it is no leave to point elsewhere"""


def to(waypoint: BoundWaypoint, here: Array) -> tuple[Array, float] | None:
    """Where a line from a tip `here`, (4, 4) in the world, to a waypoint ends, (4, 4), and s that it takes at least; 0: it is there
    already. None: the way there is no line.
    """
    asked, there = waypoint.waypoint, waypoint.tip_in_world.copy()
    if asked.approach in ("free", "along"):
        return None
    if waypoint.tolerance.rotation[2] >= math.pi:  # turning about where it points is free: no more than it must
        there[:3, :3] = turned(here, there, slack(waypoint))
    way = there[:3, 3] - here[:3, 3]
    length, angle = float(np.linalg.norm(way)), turn_between(here, there)
    if length < _HERE and angle < _TURNED and waypoint.force_in_world is None:
        return there, 0.0
    if asked.until is not None:
        there[:3, 3] += BEYOND * way / max(length, _HERE)
        length += BEYOND
    return there, max(length / (asked.speed or SPEED), angle / _TURN, asked.duration, _LEAST_S)


def slack(waypoint: BoundWaypoint) -> float:
    """rad by which the tool may point elsewhere than the waypoint does; a small tolerance is how well it has to be met."""
    allowed = float(min(waypoint.tolerance.rotation[:2]))
    return allowed if allowed > _EXACT else 0.0


def turned(here: Array, there: Array, lag: float) -> Array:
    """(3, 3): the hand turned from `here` towards where it is to point `there`, (4, 4) each, no further than it must."""
    angle = math.acos(max(-1.0, min(1.0, float(here[:3, 2] @ there[:3, 2]))))
    if angle <= lag:
        return here[:3, :3].copy()
    axis = np.cross(here[:3, 2], there[:3, 2])
    if lag == 0.0 or np.linalg.norm(axis) < 1e-6:
        return np.asarray(shortest_turn(here[:3, 2].tolist(), there[:3, 2]) @ here[:3, :3])
    return np.asarray(turn_about(axis / np.linalg.norm(axis), angle - lag) @ here[:3, :3])


def axes_along(direction: Array | None) -> tuple[float, float, float, float]:
    """Unit quaternion x, y, z, w of axes whose x points along a direction (3,) of the world; the world's own without one."""
    if direction is None:
        return (0.0, 0.0, 0.0, 1.0)
    turned = shortest_turn((1.0, 0.0, 0.0), direction / np.linalg.norm(direction))
    return to_message(placed(np.zeros(3), turned)).orientation
