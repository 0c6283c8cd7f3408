"""Under-actuated grippers: one drive moves one joint, and its linkage moves all others in a fixed relation (URDF's <mimic>).

The drive's firmware is a position loop with a speed and an effort that the host commands. It doesn't let itself be driven
backwards: switched off, or without power, it holds what it holds, as a gripper with a worm gear does.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from hal.drives.lifecycle import State
from hal.plant.bullet import pybullet as p
from hal.plant.robot_body import RobotBody

AMBIENT = 25.0
"""°C"""
_STIFF = 1e4
"""N or N·m that a linkage takes before it gives"""
_LINKAGE_GAIN, _POSITION_GAIN = 0.5, 0.05
"""share of an error that is put right in a step, of the linkage and of the drive"""
_SELF_LOCKING = 5.0
"""the effort that a gripper without power withstands over its rated one"""
_PRELOADED = 0.1
"""the effort, over the rated one, from which on a gripper presses something"""
_RATED_RISE, _THERMAL_TIME_CONSTANT_S = 30.0, 120.0  # K at rated effort for ever
# Held: no longer moving, short of the target, and pressing with most of what it may.
_STILL, _SHORT, _PRESSING = 0.02, 0.01, 0.8


class Gripper:
    """A gripper's drive, its linkage and its fingers. Positions are those of the driven joint, rad or m."""

    def __init__(self, body: RobotBody, joint: str):
        description = body.description
        self._body, self.joint = body, joint
        self._row = body.joints[joint]
        self.lower, self.upper, self._speed_limit, self._effort_limit = description.device_limits[joint]
        self.state = State.SWITCH_ON_DISABLED
        self.temperature = AMBIENT
        self._target = self.rest = min(max(0.0, self.lower), self.upper)
        """where it is at first"""
        self._speed, self._effort = self._speed_limit, self._effort_limit
        self._measured_ns = 0
        self.followers = {name: mimic for name, mimic in description.mimics.items() if mimic.joint == joint}
        body.place(joint, self.rest)
        for name, mimic in self.followers.items():
            body.place(name, mimic.multiplier * self.rest + mimic.offset)
            self._couple(body.joints[name], mimic.multiplier, mimic.offset)
        self._hold()

    def _couple(self, follower: int, multiplier: float, offset: float) -> None:
        body = self._body
        p.setJointMotorControl2(body.number, follower, p.VELOCITY_CONTROL, force=0, physicsClientId=body.client)
        # PyBullet's gear keeps: follower + gearRatio · driven joint = relativePositionTarget.
        gear = p.createConstraint(
            body.number, follower, body.number, self._row, p.JOINT_GEAR, (1, 0, 0), (0, 0, 0), (0, 0, 0),
            physicsClientId=body.client,
        )  # fmt: skip
        p.changeConstraint(
            gear, gearRatio=-multiplier, relativePositionTarget=offset, erp=_LINKAGE_GAIN, maxForce=_STIFF,
            physicsClientId=body.client,
        )  # fmt: skip

    def command(self, values: npt.NDArray[np.float64], powered: bool) -> None:
        """Follow hal.device's gripper columns (within the drive's own limits). Without power nothing is followed."""
        position, speed, effort, enable = (float(value) for value in values[:4])
        if not powered or not enable:
            if self.state is State.OPERATION_ENABLED:
                self.state = State.SWITCH_ON_DISABLED
                self._hold()
            return
        self.state = State.OPERATION_ENABLED
        self._target = min(max(position, self.lower), self.upper)
        self._speed, self._effort = min(speed, self._speed_limit), min(effort, self._effort_limit)
        self._drive(self._target, self._speed, self._effort)

    def lose_power(self) -> None:
        """Stop where it is; it faults until power is back and it is enabled anew."""
        if self.state is not State.FAULT:
            self.state = State.FAULT
            self._hold()

    def regain_power(self) -> None:
        """Wait to be enabled."""
        if self.state is State.FAULT:
            self.state = State.SWITCH_ON_DISABLED

    def place(self, position: float) -> None:
        """Put the fingers somewhere, at rest (for pictures and tests)."""
        self._body.place(self.joint, position)
        for name, mimic in self.followers.items():
            self._body.place(name, mimic.multiplier * position + mimic.offset)
        self._drive(position, self._speed_limit, _SELF_LOCKING * self._effort_limit)

    def _hold(self) -> None:
        """Stay where it is; the gear's preload goes on pressing what it pressed."""
        position, _, _, effort = p.getJointState(self._body.number, self._row, physicsClientId=self._body.client)
        if abs(effort) > _PRELOADED * self._effort_limit:
            self._drive(self._target, self._speed_limit, abs(effort))
        else:
            self._drive(position, self._speed_limit, _SELF_LOCKING * self._effort_limit)

    def _drive(self, target: float, speed: float, effort: float) -> None:
        # A speed of 0 means standing still here, and no limit at all to PyBullet.
        p.setJointMotorControl2(
            self._body.number, self._row, p.POSITION_CONTROL, targetPosition=target, positionGain=_POSITION_GAIN,
            velocityGain=1.0, force=effort, maxVelocity=max(speed, 1e-6), physicsClientId=self._body.client,
        )  # fmt: skip

    def measure(self, joint: npt.NDArray[np.float64], time_ns: int, values: npt.NDArray[np.float64]) -> None:
        """Write hal.device's gripper columns, for the driven joint's row of JointPort.felt."""
        position, velocity, *_, effort = joint.tolist()
        enabled = self.state is State.OPERATION_ENABLED
        effort = effort if enabled else 0.0
        passed, self._measured_ns = (time_ns - self._measured_ns) * 1e-9, time_ns
        warm = AMBIENT + _RATED_RISE * (effort / self._effort_limit) ** 2
        self.temperature += (warm - self.temperature) * -np.expm1(-passed / _THERMAL_TIME_CONSTANT_S)
        travel = self.upper - self.lower
        holding = (
            enabled
            and abs(velocity) < _STILL * self._speed_limit
            and abs(self._target - position) > _SHORT * travel
            and abs(effort) > _PRESSING * self._effort > 0.0
        )
        values[0:6] = position, velocity, effort, self.temperature, self.state, holding
