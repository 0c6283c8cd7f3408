"""The emulated drives' object dictionary: what each of hal.drives.parameters' entries does to a drive of the plant."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from hal.drives.lifecycle import DriveError, State
from hal.drives.parameters import DICTIONARY, PROTOCOL_VERSION, Parameter, ParameterResult

if TYPE_CHECKING:
    from hal.plant.drive_node import DriveNodes

FIRMWARE_VERSION = 1001
"""major · 1000 + minor"""
_SERIAL_BITS = 24
_TUNING = {
    Parameter.TORQUE_KP: ("torque_kp", 200.0),
    Parameter.TORQUE_KD: ("torque_kd", 0.5),
    Parameter.OBSERVER_HZ: ("observer_hz", 150.0),
}
_POSITION_GAINS = {
    Parameter.POSITION_KP: "position_kp",
    Parameter.POSITION_KD: "position_kd",
    Parameter.POSITION_KI: "position_ki",
}
# Limits may be made narrower than the robot's description has them, not wider.
_LIMITS = {
    Parameter.CURRENT_LIMIT: "current_limit",
    Parameter.TORQUE_LIMIT: "torque_limit",
    Parameter.VELOCITY_LIMIT: "velocity_limit",
    Parameter.POSITION_LOWER: "lower",
    Parameter.POSITION_UPPER: "upper",
}
# An end on the wrong side of the joint moves the set-point, and the joint with it.
_ENDS = (Parameter.POSITION_LOWER, Parameter.POSITION_UPPER)
_OFFSETS = {Parameter.ENCODER_OFFSET: "encoder_offset", Parameter.TORQUE_OFFSET: "torque_offset"}
_HOTTEST = 150.0  # °C


class DriveParameters:
    """Reads and writes single values of the drives. `row` is a joint's row in the description's order."""

    def __init__(self, drives: DriveNodes, joints: tuple[str, ...]):
        self._drives = drives
        self._serials = [zlib.crc32(joint.encode()) >> (32 - _SERIAL_BITS) for joint in joints]
        actuators = drives.actuators
        self._widest = {index: getattr(actuators, name).copy() for index, name in _LIMITS.items()}

    def read(self, row: int, index: int) -> tuple[ParameterResult, float]:
        """The value of one drive's parameter; 0 with any result but OK. Raises IndexError for a row that is not there."""
        if index not in DICTIONARY or not DICTIONARY[Parameter(index)].readable:
            return ParameterResult.UNKNOWN, 0.0
        return ParameterResult.OK, self._value(row, Parameter(index))

    def _value(self, row: int, parameter: Parameter) -> float:
        drives, actuators = self._drives, self._drives.actuators
        fixed: dict[Parameter, Callable[[], float]] = {
            Parameter.PROTOCOL_VERSION: lambda: PROTOCOL_VERSION,
            Parameter.FIRMWARE_VERSION: lambda: FIRMWARE_VERSION,
            Parameter.SERIAL: lambda: self._serials[row],
            Parameter.TEMPERATURE_WARNING: lambda: drives.temperature_warning[row],
            Parameter.TEMPERATURE_LIMIT: lambda: drives.temperature_limit[row],
            Parameter.BUS_VOLTAGE: lambda: drives.bus_voltage[row],
            Parameter.MOTOR_TEMPERATURE: lambda: drives.temperature[row],
            Parameter.MOTOR_CURRENT: lambda: actuators.current[row],
        }
        if parameter in fixed:
            return float(fixed[parameter]())
        name = (_POSITION_GAINS | _LIMITS | _OFFSETS).get(parameter) or _TUNING[parameter][0]
        return float(getattr(actuators, name)[row])

    def write(self, row: int, index: int, value: float) -> ParameterResult:
        """Change one value. Nothing changes unless the result is OK. Raises IndexError for a row that is not there."""
        if index not in DICTIONARY:
            return ParameterResult.UNKNOWN
        parameter = Parameter(index)
        if not DICTIONARY[parameter].writable:
            return ParameterResult.READ_ONLY
        if not math.isfinite(value):
            return ParameterResult.OUT_OF_RANGE
        if parameter is Parameter.INJECT_ERROR:
            return self._fail(row, value)
        if parameter in _TUNING:
            return self._tune(row, parameter, value)
        if parameter in _POSITION_GAINS:
            if value < 0.0:
                return ParameterResult.OUT_OF_RANGE
            if self._in_operation(row):
                return ParameterResult.WRONG_STATE
            getattr(self._drives.actuators, _POSITION_GAINS[parameter])[row] = value
            return ParameterResult.OK
        if parameter in _LIMITS:
            return self._limit(row, parameter, value)
        if parameter in (Parameter.TEMPERATURE_WARNING, Parameter.TEMPERATURE_LIMIT):
            return self._temperature(row, parameter, value)
        return self._calibrate(row, parameter, value)

    def _in_operation(self, row: int) -> bool:
        return self._drives.state[row] in (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE)

    def _fail(self, row: int, value: float) -> ParameterResult:
        if value not in [int(error) for error in DriveError if error is not DriveError.NONE]:
            return ParameterResult.OUT_OF_RANGE
        self._drives.fail(row, DriveError(int(value)))
        return ParameterResult.OK

    def _tune(self, row: int, parameter: Parameter, value: float) -> ParameterResult:
        name, most = _TUNING[parameter]
        if not 0.0 <= value <= most:
            return ParameterResult.OUT_OF_RANGE
        if self._in_operation(row):
            return ParameterResult.WRONG_STATE
        getattr(self._drives.actuators, name)[row] = value
        self._drives.actuators.tune()
        return ParameterResult.OK

    def _limit(self, row: int, parameter: Parameter, value: float) -> ParameterResult:
        actuators, widest = self._drives.actuators, self._widest[parameter][row]
        # What comes over the bus is float32: the widest value itself must fit.
        slack = 1e-6 * max(abs(widest), 1.0)
        if parameter is Parameter.POSITION_LOWER:
            fits = widest - slack <= value < actuators.upper[row]
        elif parameter is Parameter.POSITION_UPPER:
            fits = actuators.lower[row] < value <= widest + slack
        else:
            fits = 0.0 < value <= widest + slack
        if not fits:
            return ParameterResult.OUT_OF_RANGE
        if parameter in _ENDS and self._in_operation(row):
            return ParameterResult.WRONG_STATE
        getattr(actuators, _LIMITS[parameter])[row] = value
        return ParameterResult.OK

    def _temperature(self, row: int, parameter: Parameter, value: float) -> ParameterResult:
        drives = self._drives
        if parameter is Parameter.TEMPERATURE_WARNING:
            fits, values = 0.0 < value < drives.temperature_limit[row], drives.temperature_warning
        else:
            fits, values = drives.temperature_warning[row] < value <= _HOTTEST, drives.temperature_limit
        if not fits:
            return ParameterResult.OUT_OF_RANGE
        values[row] = value
        return ParameterResult.OK

    def _calibrate(self, row: int, parameter: Parameter, value: float) -> ParameterResult:
        actuators = self._drives.actuators
        torque = parameter is Parameter.TORQUE_OFFSET
        if abs(value) > (actuators.model.torque_limit[row] if torque else 2.0 * np.pi):
            return ParameterResult.OUT_OF_RANGE
        if self._in_operation(row):
            return ParameterResult.WRONG_STATE
        if torque:
            actuators.torque_offset[row] = value
            return ParameterResult.OK
        if parameter is Parameter.CALIBRATE:
            value += actuators.encoder_offset[row] - actuators.measured_position[row]
        actuators.move_encoder(row, value)
        return ParameterResult.OK
