"""Which controllers there are: those that run a motion, made in the cycle that starts it, and those that are loaded by name.

A controller of the user's own is a file NAME.py in the folder `controllers` of her workspace, with one class in it that derives
from daemon.controllers.base.Controller.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any

from daemon.controllers.base import Controller, Gains, MotionController
from daemon.controllers.cartesian_impedance import CartesianImpedance
from daemon.controllers.compliant_motion import CompliantMotion
from daemon.controllers.gravity_compensation import GravityCompensation
from daemon.controllers.joint_impedance import JointImpedance
from daemon.controllers.joint_stream import JointStream
from daemon.controllers.joint_target import JointTarget
from daemon.controllers.joint_trajectory import JointTrajectory
from daemon.controllers.roster import own_kinds
from daemon.exchange import (
    CartesianMotion,
    MotionCommand,
    PreparedMotion,
    StreamMotion,
    TargetMotion,
    TaskFrameMotion,
    TrajectoryMotion,
)
from handrail import source_module


def _prepared(motion: PreparedMotion, gains: Gains, period: float) -> MotionController:
    controller: MotionController = motion.controller
    controller.renew()
    return controller


MOTIONS: dict[type, Callable[[Any, Gains, float], MotionController]] = {
    TrajectoryMotion: JointTrajectory,
    CartesianMotion: CartesianImpedance,
    TaskFrameMotion: CompliantMotion,
    StreamMotion: JointStream,
    TargetMotion: JointTarget,
    PreparedMotion: _prepared,
}
"""decoded motion (daemon.exchange) → what makes a controller of it, of the robot's gains and of the loop's period in s. That
happens in a cycle, so it takes some 50 µs at most: arrays, no imports, nothing to be compiled."""

KINDS: dict[str, type[Controller]] = {
    "joint_impedance": JointImpedance,
    "gravity_compensation": GravityCompensation,
}
"""what may be loaded by name (handrail controllers load), made by Controller.make beside the loop (daemon.controllers.workshop)"""


def for_motion(motion: MotionCommand, gains: Gains, period: float) -> MotionController:
    """A controller that will run `motion`; `period`: of the loop, s."""
    return MOTIONS[type(motion)](motion, gains, period)


def find_kind(name: str) -> type[Controller]:
    """The class behind a name; a user's file is imported, anew at each call. Raises ValueError, or what the file raises."""
    own = own_kinds()
    if name in own:
        return _the_class_in(own[name])
    if name not in KINDS:
        raise ValueError(f"kind: {name}; expected one of {', '.join(sorted({*KINDS, *own}))}")
    return KINDS[name]


def _the_class_in(file: Path) -> type[Controller]:
    module = source_module.module_of(f"workspace_controllers.{file.stem}", file)
    source_module.run(module)
    classes = [
        found
        for found in vars(module).values()
        if inspect.isclass(found) and issubclass(found, Controller) and found.__module__ == module.__name__
    ]
    whole = [found for found in classes if not inspect.isabstract(found)]
    if len(whole) != 1:
        names = ", ".join(found.__name__ for found in whole) or "none"
        lacking = [f"{c.__name__} lacks {', '.join(sorted(c.__abstractmethods__))}" for c in classes if c not in whole]
        raise ValueError(f"{file}: controllers {'; '.join([names, *lacking])}; expected one class that is a Controller")
    return whole[0]
