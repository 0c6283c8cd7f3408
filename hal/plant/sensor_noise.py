"""What real inertial and force-torque sensors add to the truth: white noise by its density, and an offset that stays.

Defaults are of usual sensors' classes. Inertial: Xsens MTi-1, 0.007 °/s/√Hz and 10 °/h, 120 µg/√Hz and 0.03 mg (its
characteristics as in doi:10.2478/tar-2023-0022). Force-torque: no device's measured noise, but a guess for the class of strain
gauges for 300 N and 10 N·m (such as ATI's Mini45): steps of 1/8 N and 1/376 N·m, a quarter of one as the noise of a sample at
500 Hz, a whole one as the offset. `noise` of a device in robot.yaml says otherwise, as what was measured of a real one should.
Orientation is the truth's: what a filter makes of noise is slow, and mostly a matter of mounting.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from hal.device import MEASURED
from handrail.robot.description import Device, RobotDescription, SensorNoise

_G = 9.81
_HALF_RATE = math.sqrt(250.0)
DEFAULTS = {
    "imu": SensorNoise(
        angular_velocity=math.radians(0.007),
        angular_velocity_bias=math.radians(10.0 / 3600.0),
        linear_acceleration=120e-6 * _G,
        linear_acceleration_bias=0.03e-3 * _G,
    ),
    "force_torque": SensorNoise(
        force=0.125 / 4 / _HALF_RATE, force_bias=0.125, torque=1 / 376 / 4 / _HALF_RATE, torque_bias=1 / 376
    ),
}
_COLUMNS = {
    "imu": {"angular_velocity": range(4, 7), "linear_acceleration": range(7, 10)},
    "force_torque": {"force": range(0, 3), "torque": range(3, 6)},
}
"""family → quantity → hal.device's columns"""
_SEED = 20_130_628
_BLOCK = 256


def without_noise(description: RobotDescription) -> RobotDescription:
    """The same robot with sensors that tell the truth: to compare it with a model."""
    exact = SensorNoise(**dict.fromkeys(SensorNoise.__struct_fields__, 0.0))
    return dataclasses.replace(
        description, devices=tuple(dataclasses.replace(device, noise=exact) for device in description.devices)
    )


class Noise:
    """The noise of all sensors of a robot. The same robot gets the same numbers in every run."""

    def __init__(self, devices: Sequence[Device], period_s: float):
        """period_s: between two measurements; a density d gives samples of d √(1 / 2 period_s)."""
        rows, columns, sigma, spread = [], [], [], []
        for row, device in enumerate(devices):
            for quantity, places in _COLUMNS.get(device.family, {}).items():
                for column in places:
                    rows.append(row)
                    columns.append(column)
                    sigma.append(self._of(device, quantity) * math.sqrt(0.5 / period_s))
                    spread.append(self._of(device, f"{quantity}_bias"))
        self._places = np.array(rows, np.int64), np.array(columns, np.int64)
        self._sigma = np.array(sigma)
        self._draw = np.random.default_rng(_SEED)
        self._bias = np.array(spread) * self._draw.standard_normal(len(spread))
        # With the zeros of what has no noise in between, adding is one operation a measurement, and not a gathering of columns.
        self._block = np.zeros((_BLOCK, len(devices), MEASURED))
        self._next = _BLOCK

    @staticmethod
    def _of(device: Device, field: str) -> float:
        given = getattr(device.noise, field)
        return float(getattr(DEFAULTS[device.family], field) if given is None else given)

    def draw(self) -> npt.NDArray[np.float64]:
        """This measurement's noise, to be added to hal.device's values (devices, columns)."""
        if self._next == _BLOCK:
            drawn = self._draw.standard_normal((_BLOCK, len(self._sigma)))
            self._block[:, *self._places] = drawn * self._sigma + self._bias
            self._next = 0
        self._next += 1
        return self._block[self._next - 1]
