"""A drive's parameters: what of it can be read and written one value at a time, outside the cyclic frames.

Every value is a float32 in SI units. Drives keep what is written until they lose power. Families whose drives know this
dictionary say `parameters: standard` in their description.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass

PROTOCOL_VERSION = 2
"""of the limb FD protocol: what PROTOCOL_VERSION reads as on drives that speak as this package does"""


class Parameter(enum.IntEnum):
    """Index of each parameter; `name.lower()` is what people read and write."""

    PROTOCOL_VERSION = 0x01
    FIRMWARE_VERSION = 0x02
    SERIAL = 0x03
    TORQUE_KP = 0x10
    TORQUE_KD = 0x11
    OBSERVER_HZ = 0x12
    POSITION_KP = 0x13
    POSITION_KD = 0x14
    POSITION_KI = 0x15
    CURRENT_LIMIT = 0x20
    TORQUE_LIMIT = 0x21
    VELOCITY_LIMIT = 0x22
    POSITION_LOWER = 0x23
    POSITION_UPPER = 0x24
    TEMPERATURE_WARNING = 0x25
    TEMPERATURE_LIMIT = 0x26
    ENCODER_OFFSET = 0x30
    TORQUE_OFFSET = 0x31
    CALIBRATE = 0x32
    BUS_VOLTAGE = 0x40
    MOTOR_TEMPERATURE = 0x41
    MOTOR_CURRENT = 0x42
    INJECT_ERROR = 0x7E


class ParameterResult(enum.IntEnum):
    """What became of a request; the reply's result byte."""

    OK = 0
    UNKNOWN = 1
    """the drive has no such parameter"""
    READ_ONLY = 2
    OUT_OF_RANGE = 3
    WRONG_STATE = 4
    """not while the drive is in the state of CiA 402 that it is in"""


@dataclass(frozen=True)
class Entry:
    """One line of the dictionary."""

    unit: str
    writable: bool
    readable: bool
    text: str


def _entry(unit: str, access: str, text: str) -> Entry:
    return Entry(unit, "w" in access, "r" in access, text)


DICTIONARY: dict[Parameter, Entry] = {
    Parameter.PROTOCOL_VERSION: _entry("", "r", "version of the frames that the drive speaks"),
    Parameter.FIRMWARE_VERSION: _entry("", "r", "major · 1000 + minor"),
    Parameter.SERIAL: _entry("", "r", "serial number, below 2^24"),
    Parameter.TORQUE_KP: _entry(
        "", "rw", "proportional gain of the torque loop on the spring, seed 003 eq. 2; not while in operation"
    ),
    Parameter.TORQUE_KD: _entry("s", "rw", "derivative gain of the torque loop on the spring; not while in operation"),
    Parameter.OBSERVER_HZ: _entry(
        "Hz", "rw", "bandwidth of the disturbance observer's filter; 0: no observer; not while in operation"
    ),
    Parameter.POSITION_KP: _entry("N·m/rad", "rw", "the drive's own position loop; not while in operation"),
    Parameter.POSITION_KD: _entry("N·m·s/rad", "rw", "the drive's own position loop; not while in operation"),
    Parameter.POSITION_KI: _entry("N·m/(rad·s)", "rw", "the drive's own position loop; not while in operation"),
    Parameter.CURRENT_LIMIT: _entry("A", "rw", "of the motor"),
    Parameter.TORQUE_LIMIT: _entry("N·m", "rw", "of the set-point, at the joint"),
    Parameter.VELOCITY_LIMIT: _entry("rad/s", "rw", "of the joint"),
    Parameter.POSITION_LOWER: _entry("rad", "rw", "the joint's lower end; not while in operation"),
    Parameter.POSITION_UPPER: _entry("rad", "rw", "the joint's upper end; not while in operation"),
    Parameter.TEMPERATURE_WARNING: _entry(
        "°C", "rw", "of the motor, above which the statusword warns and torque is derated"
    ),
    Parameter.TEMPERATURE_LIMIT: _entry("°C", "rw", "of the motor, above which the drive faults"),
    Parameter.ENCODER_OFFSET: _entry("rad", "rw", "added to the joint encoder's angle; not while in operation"),
    Parameter.TORQUE_OFFSET: _entry("N·m", "rw", "added to the spring sensor's torque; not while in operation"),
    Parameter.CALIBRATE: _entry(
        "rad", "w", "the joint is at this position now: sets encoder_offset; not while in operation"
    ),
    Parameter.BUS_VOLTAGE: _entry("V", "r", "at the drive"),
    Parameter.MOTOR_TEMPERATURE: _entry("°C", "r", "of the motor's winding"),
    Parameter.MOTOR_CURRENT: _entry("A", "r", "of the motor"),
    Parameter.INJECT_ERROR: _entry(
        "", "w", "fault with this error (hal.drives.lifecycle.DriveError); emulated drives only"
    ),
}
"""What there is, by index."""


def find(name: str) -> Parameter:
    """The parameter of this name (any case, `-` as `_`) or index (`0x20`). Raises ValueError saying what there is."""
    text = name.strip().upper().replace("-", "_")
    if text in Parameter.__members__:
        return Parameter[text]
    try:
        return Parameter(int(text, 0))
    except ValueError:
        names = ", ".join(parameter.name.lower() for parameter in Parameter)
        raise ValueError(f"parameter {name}: unknown; expected an index or one of {names}") from None
