"""The whole robot, enabled: plant, bus and daemon as one, with the motions that tests start with."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from hal.hil.bus import Bus
from hal.hil.daemon import Daemon
from hal.hil.names import joints_of
from hal.hil.plant import Plant
from handrail import messages as m
from handrail.robot.description import RobotDescription

_KNOTS = 20


class Robot:
    """A robot under the daemon, and what happens to it by bus and plant."""

    def __init__(self, description: RobotDescription, bus: Bus, plant: Plant, daemon: Daemon):
        self.description, self.bus, self.plant, self.daemon = description, bus, plant, daemon

    def joints(self, names: str | Iterable[str]) -> list[str]:
        """Joints by name, glob, limb or group."""
        return joints_of(self.description, names)

    def position(self, joint: str) -> float:
        """rad, by the plant's ground truth."""
        return self.plant.truth().joints[joint]

    def enable(self) -> None:
        """Enable, and wait until the robot holds and its brakes are open."""
        self.daemon.enable()
        self.plant.wait(0.15)

    def begin(self, joint: str, by: float, duration: float = 1.0) -> str:
        """Start a minimum-jerk motion of one joint by so many rad; the action's id."""
        (joint,) = joints_of(self.description, joint)
        here = self.position(joint)
        u = np.linspace(0.0, 1.0, _KNOTS)
        share = u**3 * (10 - 15 * u + 6 * u * u)
        slope = 30 * u * u * (1 - u) ** 2 / duration
        motion = m.JointTrajectory(
            joints=[joint],
            times=(u * duration).tolist(),
            positions=(here + by * share)[:, None].tolist(),
            velocities=(by * slope)[:, None].tolist(),
        )
        return self.daemon.start(motion)

    def move(self, joint: str, by: float, duration: float = 1.0) -> str:
        """The same to its end; the outcome, `done` where it came there."""
        return self.daemon.wait_end(self.begin(joint, by, duration)).outcome

    def assert_quick_stops(
        self, joints: str | Iterable[str], *, within_cycles: int = 20, since_ns: int | None = None
    ) -> None:
        """Within so many cycles of the last set-point that was on the bus (or of `since_ns`), every drive quick-stopped."""
        if since_ns is None:
            since_ns = self.bus.traffic().last_command(joints)
        self.plant.assert_quick_stops(joints, since_ns=since_ns, within_cycles=within_cycles)
