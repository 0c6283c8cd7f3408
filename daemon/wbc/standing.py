"""A compound task that stands on the robot's feet: which ones, and where its references begin."""

from __future__ import annotations

import math

import numpy as np

from daemon.wbc.composition import CompoundTask
from daemon.wbc.constraints import FlatContact, PointContact
from daemon.wbc.memory import Array
from handrail.robot.description import RobotDescription


def standing_on(compound: CompoundTask, description: RobotDescription) -> tuple[int, ...]:
    """Numbers of the description's feet at whose frames the compound has contacts: where there are any, the base is free."""
    contacts = {c.frame for c in compound.constraints if isinstance(c, FlatContact | PointContact)}
    return tuple(number for number, foot in enumerate(description.feet) if foot.link in contacts)


def upright(pose: Array) -> Array:
    """(7,) x y z, quaternion x y z w: a base's pose without its tilt, about its own origin, with the same heading."""
    x, y, z, w = pose[3:]
    half = 0.5 * math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return np.array([*pose[:3], 0.0, 0.0, math.sin(half), math.cos(half)])
