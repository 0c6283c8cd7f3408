"""What a controller is to the manager: it claims joints and writes their set-points once a cycle while it is active.

`Controller` commands the robot, or the references of a `ChainableController` as if they were the robot; `MotionController` runs
along a path for an action.
"""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from daemon.controllers.outer_integral import OuterIntegral
from daemon.controllers.references import PathClock
from daemon.exchange import Outcome
from daemon.state.robot_state import RobotState
from hal.joint import COMMANDED, JointCommand, Mode
from handrail.compiled import compiled
from handrail.robot.kinematics import Kinematics

Array = NDArray[np.float64]

_IMPEDANCE = int(Mode.IMPEDANCE)


@dataclass(frozen=True)
class Gains:
    """Joint impedance in the drives, arrays (n,)."""

    stiffness: Array
    """N·m/rad"""
    damping: Array
    """N·m·s/rad"""
    integral: OuterIntegral | None = None
    """on the joint encoders' error, where the robot has one: shared by all controllers"""

    @functools.cached_property
    def table(self) -> Array:
        """(2, n): both, in this order, for the kernel."""
        return np.array([self.stiffness, self.damping], float)


def rows_of(interfaces: Sequence[str]) -> NDArray[np.int64]:
    """Rows of JointCommand.table."""
    return np.array([COMMANDED.index(name) for name in interfaces], np.int64)


@dataclass(frozen=True)
class Setup:
    """What a controller that is loaded by name is made from."""

    joints: NDArray[np.int64]
    """(m,) that it will claim"""
    gains: Gains
    """(n,) of the whole robot"""
    kinematics: Kinematics
    period: float
    """s, of the loop"""
    parameters: Mapping[str, Any]
    """as the user gave them"""


class Ended(NamedTuple):
    """Why a controller was taken out of service."""

    outcome: Outcome
    joint: int = -1
    """row of the joint that it was about; −1: none"""
    value: float = 0.0
    """rad off, or cycles old"""
    detail: str = ""
    """what else there is to say of it"""


class NotStandingError(Exception):
    """A foot that a controller would stand on does not hold: its number in the description's feet."""

    def __init__(self, foot: int, name: str):
        self.foot = foot
        super().__init__(f"{name}: got no hold there; expected the feet that it is to stand on")


class Controller(ABC):
    """Commands the joints that it claims; `joints` are their rows in the description's order.

    Life: made → `activate` → `update` every cycle, until the manager takes its claims away; it may then be activated again. It
    never sees another controller's joints and knows nothing of limits, which come after it. What it raises in `activate` backs
    the switch out; what it raises in `update` gives its joints to its fallback in that cycle.
    """

    name: str = "user"
    """one of daemon.exchange.CONTROLLERS"""
    interfaces: tuple[str, ...] = COMMANDED
    """what it claims of its joints, of hal.joint.COMMANDED; the rest is held"""
    code = -1
    """of a controller that was loaded by name: what stands for it in the snapshot's claims"""
    onto: ChainableController | None = None
    """whose references it writes, instead of the robot's command"""
    fallbacks: tuple[Controller, ...] = ()
    """what takes over when it fails; what they leave over is held"""
    error: Exception | None = None
    """what it raised, after which it is not used any more"""
    ended = Ended(Outcome.NONE)
    """why it was taken out of service last"""

    def __init__(self, joints: NDArray[np.int64], gains: Gains):
        self.joints = joints
        self.gains = gains

    @classmethod
    def make(cls, setup: Setup) -> Self:
        """One that was loaded by name. Runs beside the loop, never in a cycle: whatever takes long belongs here.

        Raises ValueError for parameters that are not right.
        """
        if setup.parameters:
            raise ValueError(f"parameters: {', '.join(setup.parameters)}; expected none")
        return cls(setup.joints, setup.gains)

    @abstractmethod
    def activate(self, robot: RobotState, last: JointCommand) -> None:
        """Start from `last`, the command written in the cycle before (or the references followed in it)."""

    @abstractmethod
    def update(self, robot: RobotState, out: JointCommand) -> None:
        """Write this cycle's set-points into the rows of `out` that are claimed, and no others."""

    def write_impedance(self, robot: RobotState, out: JointCommand, position: Array, velocity: Array) -> None:
        """Joint impedance about `position`, `velocity` (m,), with the model's gravity torque fed forward."""
        _impedance(self.joints, position, velocity, robot.gravity, self.gains.table, out.table, out.mode)

    def write_tracking(self, robot: RobotState, out: JointCommand, position: Array, velocity: Array) -> None:
        """The same, and the encoders shall read `position`: with the robot's outer integral, where it has one.

        Not into another controller's references: those are no drives.
        """
        gains = self.gains
        if gains.integral is None or self.onto is not None:
            _impedance(self.joints, position, velocity, robot.gravity, gains.table, out.table, out.mode)
        else:
            gains.integral.write(
                self.joints, position, velocity, robot.gravity, gains.table, robot.joints.table, out.table, out.mode
            )


@compiled
def _impedance(rows, position, velocity, gravity, gains, out, mode):  # type: ignore[no-untyped-def]
    for i in range(rows.shape[0]):
        j = rows[i]
        out[0, j], out[1, j], out[2, j], out[3, j], out[4, j], mode[j] = (
            position[i], velocity[i], gravity[j], gains[0, j], gains[1, j], _IMPEDANCE,
        )  # fmt: skip


class ChainableController(Controller):
    """A controller that others may command: they write into `reference` as if it were the robot's command.

    Where nobody does, its references stand still. `reference` (n,) has the robot's rows; only those of `joints` count.
    """

    references: tuple[str, ...] = ("position", "velocity")
    """rows of `reference` that it follows, of hal.joint.COMMANDED: what others may claim of it"""

    def __init__(self, joints: NDArray[np.int64], gains: Gains):
        super().__init__(joints, gains)
        self.reference = JointCommand(len(gains.stiffness))
        self._followed = self.reference.memory.copy()

    def activate(self, robot: RobotState, last: JointCommand) -> None:
        """Start from `last`; an override calls this first."""
        self.reference.copy_from(last)
        self.stand(self.joints)

    def update(self, robot: RobotState, out: JointCommand) -> None:
        self.follow(robot, out)
        self._followed[...] = self.reference.memory

    @abstractmethod
    def follow(self, robot: RobotState, out: JointCommand) -> None:
        """As `Controller.update`, towards `reference` as it is in this cycle."""

    def stand(self, joints: NDArray[np.int64]) -> None:
        """Nobody writes the references of these rows any more: they stay where they are."""
        self.reference.velocity[joints] = 0.0
        self._followed[...] = self.reference.memory

    def recall(self, joints: NDArray[np.int64]) -> None:
        """Who wrote the references of these rows failed on the way: they stand where they were followed last."""
        self.reference.memory[...] = self._followed
        self.stand(joints)


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
    def failure(self) -> str:
        """Why it can't go on; "": it can."""
        return ""

    @property
    def remark(self) -> str:
        """What there is to say of how it was done; "": nothing."""
        return ""

    @property
    def path_force(self) -> float:
        """N, what a path-force integrator adds now."""
        return 0.0

    def renew(self) -> None:
        """It was made beforehand, and will start: from its path's beginning, though it may have run before."""

    def receive(self, task: str, position: Array | None, orientation: Array | None, velocity: Array) -> bool:
        """A streamed reference (exchange.StreamedReference). False: nothing is streamed here under this name."""
        return False

    def sample(self, sequence: int, position: Array, velocity: Array) -> bool:
        """A sample of where its joints are to be, (m,) rad and rad/s, finite. False: no such thing is streamed here."""
        return False

    def stood(self, robot: RobotState, last: JointCommand) -> None:
        """It has come to a stand on its path, where `last` was written."""

    def come_back(self, robot: RobotState, last: JointCommand) -> None:
        """It will go on: from where its joints are, where they were pushed off."""

    @property
    def waiting(self) -> str:
        """Why its clock stands though nobody paused it; "": it does not."""
        return ""

    @property
    def silence(self) -> float:
        """s since something was streamed to it, where that is too long; 0: all is well"""
        return 0.0

    def lag(self, robot: RobotState, frame: str) -> Array:
        """(3,) m, world axes: where a frame is commanded to be minus where it is measured."""
        return robot.lag(frame)
