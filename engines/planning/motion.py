"""A motion that is asked for: goals, key frames, what holds on the way, what stands around."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from affordance_templates.instance import Instance
from engines.planning.along import Follow
from engines.planning.collision.obstacles import Obstacle
from engines.planning.ik.constraints import Constraint

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """What is asked for, as constraints."""

    goals: Sequence[Constraint]
    """hold where it ends"""
    moving: tuple[str, ...]
    """m joints of the robot, in its order"""
    through: Sequence[Sequence[Constraint]] = ()
    """hold one after the other on the way"""
    keep: Sequence[Constraint] = ()
    """hold all the way"""
    obstacles: Sequence[Instance] = ()
    seen: Sequence[Obstacle] = ()
    """what has no name: octrees of what cameras see"""
    clearance: float = 0.01
    """m, from what stands around; of the robot from itself not less than its guard wants"""
    along: Follow | None = None
    """in place of goals"""
    touching: Sequence[tuple[str, str]] = ()
    """pairs of names that may touch"""
    duration: float = 0.0
    """s, at least"""
    label: str = "motion"
    arm: str = ""
    made_from: Mapping[str, int] = field(default_factory=dict)
    """instance → version"""
    stands: Sequence[Constraint] = ()
    """what holds all the way so that the robot stands"""
    closed: bool = False
    """legs move between feet that are held: only a way that was made as a whole keeps them"""
    root_in_world: pin.SE3 = field(default_factory=pin.SE3.Identity)
    """what stands still; everything above is said in its frame"""
    seeds: Sequence[Array] = ()
    """(n,) rad each: postures to look for the goal's from, before any other"""
