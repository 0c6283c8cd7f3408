"""Which controllers there are: the one that runs each kind of motion, made in the cycle that starts it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from daemon.controllers.base import Gains, MotionController
from daemon.controllers.cartesian_impedance import CartesianImpedance
from daemon.controllers.joint_trajectory import JointTrajectory
from daemon.exchange import CartesianMotion, TrajectoryMotion

MOTIONS: dict[type, Callable[[Any, Gains, float], MotionController]] = {
    TrajectoryMotion: JointTrajectory,
    CartesianMotion: CartesianImpedance,
}
"""decoded motion (daemon.exchange) → what makes a controller of it, of the robot's gains and of the loop's period in s. That
happens in a cycle, so it takes some 50 µs at most: arrays, no imports, nothing to be compiled."""


def for_motion(motion: TrajectoryMotion | CartesianMotion, gains: Gains, period: float) -> MotionController:
    """A controller that will run `motion`; `period`: of the loop, s."""
    return MOTIONS[type(motion)](motion, gains, period)
