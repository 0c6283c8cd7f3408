"""Why some goals can't be reached by anything: a point that is asked for, and lies inside an obstacle."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from engines.planning.collision.obstacles import placement_of
from engines.planning.ik import constraints as kinds
from engines.planning.ik.constraints import WORLD, Constraint
from engines.planning.ik.report import Measure


def goals_inside(constraints: Sequence[Constraint]) -> Iterator[Measure]:
    """Goals in the world, met exactly, that lie inside an obstacle which the robot must keep clear of: how deep."""
    obstacles = [o for c in constraints if isinstance(c, kinds.Clearance) for o in c.scene.obstacles]
    for constraint in constraints:
        position = constraint.halves[0] if isinstance(constraint, kinds.Pose) else constraint
        if not isinstance(position, kinds.Position) or position.in_frame != WORLD or position.lower != position.upper:
            continue
        goal = placement_of(position.box) * np.array(position.lower)
        for obstacle in obstacles:
            depth = _distance(goal, obstacle.geometry, obstacle.placement)
            if depth < 0.0:
                yield Measure(
                    constraint.label, f"goal from {obstacle.label}, inside of which it is", depth, 0.0, np.inf, "m"
                )


def _distance(point: NDArray[np.float64], geometry: coal.ShapeBase, placement: pin.SE3) -> float:
    result = coal.DistanceResult()
    here = coal.Transform3s(np.eye(3), point)
    there = coal.Transform3s(placement.rotation, placement.translation)
    coal.distance(coal.Sphere(1e-9), here, geometry, there, coal.DistanceRequest(), result)
    return float(result.min_distance)
