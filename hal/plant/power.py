"""The robot's battery and its power relay.

The battery pays for what the motors do and for the heat in their windings; its voltage falls as it empties and as it is loaded.
Open, the relay takes the power from every drive: they fault (undervoltage) and their brakes close.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

CAPACITY = 15.0 * 3600.0
"""A·s"""
FULL, EMPTY = 58.0, 46.0
"""V, open circuit, of a 14-cell lithium battery"""
RESISTANCE = 0.05
"""Ω, inner"""
IDLE_POWER = 60.0
"""W, of computers and electronics, which the relay does not switch"""
WINDING_RESISTANCE = 0.4
"""Ω, of a motor: PyBullet's world knows no windings, so all are alike"""
AMBIENT = 25.0
"""°C"""
_RISE, _THERMAL_TIME_CONSTANT_S = 0.004, 900.0  # K per A² for ever


class Battery:
    """State of one battery; `relay` is what it was told, closed at the start."""

    def __init__(self) -> None:
        self.relay = True
        self.charge = 1.0
        """0..1"""
        self.current = IDLE_POWER / FULL
        """A, drawn from it"""
        self.temperature = AMBIENT
        self._time_ns = 0

    @property
    def open_circuit(self) -> float:
        """V without load."""
        return EMPTY + (FULL - EMPTY) * self.charge

    @property
    def voltage(self) -> float:
        """V, at the load that it carries."""
        return self.open_circuit - RESISTANCE * self.current

    @property
    def powered(self) -> bool:
        """The drives have power."""
        return self.relay and self.charge > 0.0

    def draw(self, time_ns: int, mechanical: float, motor_currents: npt.NDArray[np.float64]) -> None:
        """Let time pass until `time_ns` with motors that do `mechanical` W and carry `motor_currents` A (n,).

        A robot that lowers its arm feeds nothing back: brake choppers burn it.
        """
        passed, self._time_ns = (time_ns - self._time_ns) * 1e-9, time_ns
        power = IDLE_POWER
        if self.powered:
            power += max(mechanical, 0.0) + WINDING_RESISTANCE * float(motor_currents @ motor_currents)
        # V I = P with V = V0 − R I, on the branch that a battery works on; beyond what it can give it gives its most.
        v0 = self.open_circuit
        self.current = (v0 - np.sqrt(max(v0 * v0 - 4.0 * RESISTANCE * power, 0.0))) / (2.0 * RESISTANCE)
        self.charge = max(self.charge - self.current * passed / CAPACITY, 0.0)
        warm = AMBIENT + _RISE * self.current**2
        self.temperature += (warm - self.temperature) * -np.expm1(-passed / _THERMAL_TIME_CONSTANT_S)

    def measure(self, values: npt.NDArray[np.float64]) -> None:
        """Write hal.device's power columns."""
        values[0:5] = self.voltage, self.current, self.charge, self.temperature, self.relay
