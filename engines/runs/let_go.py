"""A motion that was let go in a pause, for the operator to move its joints by hand: what is left of it once he has moved them back.

Only what can be gone on with from where it stands is: the rest of a trajectory's path, at a pace of its own, or a motion whose goal
says all. What counts from its beginning (a behaviour's chain, a travel, a time) can't be.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from engines.runs import retrace
from handrail.messages import (
    CartesianImpedance,
    CompliantMotion,
    JointTarget,
    JointTrajectory,
    Motion,
    StartAction,
    StartBehaviour,
    TimeEnd,
    TravelEnd,
)


class Joints(Protocol):
    """What is asked of `handrail.robot.description.RobotDescription`."""

    @property
    def joints(self) -> tuple[str, ...]: ...
    @property
    def velocity_limit(self) -> NDArray[np.float64]: ...


def goes_on(message: StartAction | StartBehaviour) -> bool:
    """Whether it can be gone on with once its joints are back where it was let go."""
    if isinstance(message, StartBehaviour) or any(isinstance(end, TimeEnd | TravelEnd) for end in message.ends):
        return False
    motion = message.motion
    if isinstance(motion, CompliantMotion):
        return motion.goal_in_world is not None and not motion.compliance and not motion.dither
    return isinstance(motion, JointTrajectory | JointTarget | CartesianImpedance)


def rest(motion: Motion, command: NDArray[np.float64], robot: Joints) -> Motion | None:
    """What is left of a motion that `goes_on`, from the robot's command (n,) rad; None: nothing."""
    if not isinstance(motion, JointTrajectory):
        return motion
    rows = [robot.joints.index(joint) for joint in motion.joints]
    times, positions, velocities = (np.array(each) for each in (motion.times, motion.positions, motion.velocities))
    path = retrace.way(times, positions, velocities, command[rows], back=False)
    left = retrace.timed(tuple(motion.joints), path, robot.velocity_limit[rows])
    if left is not None:
        left.path_force = motion.path_force
    return left
