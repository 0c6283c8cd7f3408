"""Nodes that are no joints, as the loop commands them: grippers live and stop with the robot.

An enabled robot's grippers hold where they are until somebody sends them elsewhere; a disabled or stopped robot's are out of
operation, and hold what they hold by themselves. One that is lost stops nothing else: it is out of operation until it answers, and
then holds where it is. A power supply's relay stays as it is until somebody switches it, whatever the robot does.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daemon.actions.table import Refusal
from daemon.exchange import Answer
from hal.device import GRIPPER_COMMANDED, SILENT_AFTER, DeviceCommand, DeviceState
from hal.hardware import LOST_AFTER
from handrail.robot.description import RobotDescription

_RELAY = 0
_POSITION, _VELOCITY, _EFFORT, _ENABLE = range(len(GRIPPER_COMMANDED))


class Devices:
    """What the robot's devices are told, row by row of `RobotDescription.devices`."""

    def __init__(self, description: RobotDescription, state: DeviceState, command: DeviceCommand):
        self._state, self._command = state, command
        self._limits = {
            row: description.device_limits[device.joint]
            for row, device in enumerate(description.devices)
            if device.family == "gripper"
        }
        self._supplies = {row for row, device in enumerate(description.devices) if device.family == "power"}
        self._enabled = False

    def enable(self) -> None:
        """The robot has come to life: grippers hold where they are."""
        self._enabled = True

    def disable(self) -> None:
        """The robot is out of operation: so are its grippers."""
        self._enabled = False
        for row in self._limits:
            self._command.values[row, _ENABLE] = 0.0

    def update(self) -> None:
        """Once a cycle: follow which devices answer."""
        values = self._command.values
        for row in self._limits:
            if self._state.age[row] > LOST_AFTER:
                values[row, _ENABLE] = 0.0
            elif self._enabled and not values[row, _ENABLE]:
                self._hold(row)

    def refusal(self, row: int, values: NDArray[np.float64]) -> Refusal | None:
        """Why a gripper may not be ordered to follow these columns; None: it may."""
        if row not in self._limits or not np.isfinite(values).all():
            return Refusal(Answer.MALFORMED)
        if not self._enabled:
            return Refusal(Answer.NOT_ENABLED)
        if self._state.age[row] > LOST_AFTER:
            return Refusal(Answer.DEVICE_SILENT, row)
        return None

    def order(self, row: int, values: NDArray[np.float64]) -> Refusal | None:
        """Let a gripper follow its columns from now on; whoever asks has seen to its limits."""
        if (refusal := self.refusal(row, values)) is not None:
            return refusal
        lower, upper, speed, effort = self._limits[row]
        position, velocity, force = values[_POSITION], values[_VELOCITY], values[_EFFORT]
        command = self._command.values[row]
        command[_POSITION] = min(max(position, lower), upper)
        command[_VELOCITY], command[_EFFORT] = min(max(velocity, 0.0), speed), min(max(force, 0.0), effort)
        return None

    def switch(self, row: int, closed: bool) -> Refusal | None:
        """Let a power supply open or close its relay, and keep it so; whoever asks has seen to the robot's life."""
        if row not in self._supplies:
            return Refusal(Answer.MALFORMED)
        if self._state.age[row] > SILENT_AFTER:
            return Refusal(Answer.DEVICE_SILENT, row)
        self._command.values[row, _RELAY], self._command.commanded[row] = float(closed), True
        return None

    def _hold(self, row: int) -> None:
        _, _, speed, effort = self._limits[row]
        self._command.values[row, : len(GRIPPER_COMMANDED)] = self._state.values[row, 0], speed, effort, 1.0
        self._command.commanded[row] = True
