"""What a controller is to the manager: it claims joints and writes their set-points once a cycle while it is active."""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daemon.references import PathClock
from daemon.robot_state import RobotState
from hal.joint import JointCommand, Mode
from handrail.compiled import compiled

Array = NDArray[np.float64]

_IMPEDANCE = int(Mode.IMPEDANCE)


@dataclass(frozen=True)
class Gains:
    """Joint impedance in the drives, arrays (n,)."""

    stiffness: Array
    """N·m/rad"""
    damping: Array
    """N·m·s/rad"""

    @functools.cached_property
    def table(self) -> Array:
        """(2, n): both, in this order, for the kernel."""
        return np.array([self.stiffness, self.damping], float)


class Controller(ABC):
    """Commands the joints that it claims; `joints` are their rows in the description's order.

    Life: made (unconfigured) → `activate` → `update` every cycle, until the manager takes its claims away. A controller is used
    once. It never sees another controller's joints and knows nothing of limits, which come after it.
    """

    name: str = "user"
    """one of daemon.exchange.CONTROLLERS"""

    def __init__(self, joints: NDArray[np.int64], gains: Gains):
        self.joints = joints
        self.gains = gains

    @abstractmethod
    def activate(self, robot: RobotState, last: JointCommand) -> None:
        """Start from `last`, the command written in the cycle before."""

    @abstractmethod
    def update(self, robot: RobotState, out: JointCommand) -> None:
        """Write this cycle's set-points into the rows of `out` that are claimed, and no others."""

    def write_impedance(self, robot: RobotState, out: JointCommand, position: Array, velocity: Array) -> None:
        """Joint impedance about `position`, `velocity` (m,), with the model's gravity torque fed forward."""
        _impedance(self.joints, position, velocity, robot.gravity, self.gains.table, out.table, out.mode)


@compiled
def _impedance(rows, position, velocity, gravity, gains, out, mode):  # type: ignore[no-untyped-def]
    for i in range(rows.shape[0]):
        j = rows[i]
        out[0, j], out[1, j], out[2, j], out[3, j], out[4, j], mode[j] = (
            position[i], velocity[i], gravity[j], gains[0, j], gains[1, j], _IMPEDANCE,
        )  # fmt: skip


class MotionController(Controller):
    """A controller that runs along a path, and can be slowed down on it."""

    clock: PathClock
    force_frame: str = ""
    """frame at which the external force is estimated while this runs; "": none"""

    @property
    def done(self) -> bool:
        """The path has been commanded to its end."""
        return self.clock.at_end

    @property
    def path_force(self) -> float:
        """N, what a path-force integrator adds now."""
        return 0.0
