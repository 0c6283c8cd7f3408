"""A force-torque sensor forgets its offset: what it tells beyond its tool's weight while the robot stands and nothing touches it.

Whether something does, the joints say (the momentum observer of daemon.state.observer), which know nothing of the sensor. What
they can't feel is taken for the offset, too. The loop keeps it as long as it runs.
"""

from __future__ import annotations

import numpy as np

from daemon.actions.table import Refusal
from daemon.exchange import Answer
from daemon.state.robot_state import RobotState

SETTLE, LISTEN = 100, 100
"""cycles in which the observer comes to rest, and over which the sensor's mean is taken"""
FORGET = 5000
"""cycles for which an answer that nobody has fetched is kept"""
STILL, FREE_N, FREE_NM = 0.05, 5.0, 1.0
"""rad/s of every joint; N and N·m on what the sensor carries, as the joints feel it"""


class Taring:
    """One sensor at a time."""

    def __init__(self, robot: RobotState):
        self._robot = robot
        self._row = -1
        self._cycles = 0
        self._sum = np.zeros(6)
        self._told: Refusal | None = None
        self._frame = ""
        """where the joints are asked, while it goes on"""

    def ask(self, row: int) -> Refusal:
        """Begin with the sensor of a row of RobotDescription.devices, or say how it went; TARING: it goes on, ask again.

        ACCEPTED has the size of the offset, N.
        """
        sensors = self._robot.sensors
        if row not in sensors:
            return Refusal(Answer.MALFORMED)
        if self._frame and row != self._row:
            return Refusal(Answer.TOO_MANY)
        if row != self._row:
            self._row, self._cycles, self._told = row, 0, None
            self._sum[:] = 0.0
            self._frame = self._robot.kinematics.description.devices[row].link
        if self._told is None:
            return Refusal(Answer.TARING, row)
        told, self._row = self._told, -1
        return told

    def with_its_frame(self, frames: tuple[str, ...]) -> tuple[str, ...]:
        """Where forces have to be estimated: where others want them, and where it does."""
        return tuple(dict.fromkeys((*frames, self._frame))) if self._frame else frames

    def update(self, *, enabled: bool) -> None:
        """Once a cycle, after the forces have been estimated."""
        if self._row < 0:
            return
        self._cycles += 1
        if not self._frame:
            if self._cycles > FORGET:
                self._row = -1
            return
        if (told := self._hindered(enabled)) is None:
            if self._cycles > SETTLE:
                self._sum += self._robot.sensors[self._row].excess(self._robot.moved)
            if self._cycles < SETTLE + LISTEN:
                return
            offset = self._sum / LISTEN
            if np.isfinite(offset).all():
                self._robot.sensors[self._row].offset[:] = offset
                told = Refusal(Answer.ACCEPTED, value=float(np.linalg.norm(offset[:3])))
            else:  # it told what is no number
                told = Refusal(Answer.DEVICE_SILENT, self._row)
        self._told, self._frame = told, ""

    def _hindered(self, enabled: bool) -> Refusal | None:
        robot = self._robot
        if not enabled:
            return Refusal(Answer.NOT_ENABLED)
        if not robot.sensors[self._row].fresh:
            return Refusal(Answer.DEVICE_SILENT, self._row)
        fastest = int(np.argmax(np.abs(robot.joints.velocity)))
        if not (speed := abs(float(robot.joints.velocity[fastest]))) <= STILL:
            return Refusal(Answer.MOVING, fastest, speed)
        if self._cycles < SETTLE:
            return None
        felt = robot.felt_by_joints(self._frame)
        force, moment = float(np.linalg.norm(felt[:3])), float(np.linalg.norm(felt[3:]))
        if not force <= FREE_N:
            return Refusal(Answer.TOUCHED, self._row, force)
        return None if moment <= FREE_NM else Refusal(Answer.TWISTED, self._row, moment)
