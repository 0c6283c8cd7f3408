"""MIT mini cheetah mode (Damiao DM-J4340 ranges). Typed messages of the family `mit`, made from its description by
`handrail drives types mit`; do not edit."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import can

from hal.drives import lifecycle
from hal.drives.typed import TypedMessage, decode_any


class Error(IntEnum):
    DISABLED = 0
    ENABLED = 1
    OVERVOLTAGE = 8
    UNDERVOLTAGE = 9
    OVERCURRENT = 10
    MOSFET_OVERTEMPERATURE = 11
    ROTOR_OVERTEMPERATURE = 12
    COMMUNICATION_LOST = 13
    OVERLOAD = 14


@dataclass(kw_only=True)
class Control(TypedMessage, family="mit", message="Control"):
    """Set-point of a motor: torque = Kp (position - q) + Kd (velocity - dq) + torque. The same identifier carries the
    fixed frames that enable, disable and reset it. Host → drives: where their lives shall go."""

    limb: int = 0
    """0 to 7"""
    axis: int = 0
    """0 to 6"""
    command: lifecycle.Command = lifecycle.Command.DISABLE_VOLTAGE
    """which of the fixed frames"""


@dataclass(kw_only=True)
class Command(TypedMessage, family="mit", message="Command"):
    """Set-point of a motor: torque = Kp (position - q) + Kd (velocity - dq) + torque. The same identifier carries the
    fixed frames that enable, disable and reset it. Host → drives: set-points."""

    limb: int = 0
    """0 to 7"""
    axis: int = 0
    """0 to 6"""
    position: float = 0.0
    """rad, -12.5 to 12.5, in steps of 0.000381476"""
    velocity: float = 0.0
    """rad/s, -45 to 45, in steps of 0.021978"""
    kp: float = 0.0
    """N·m/rad, 0 to 500, in steps of 0.1221"""
    kd: float = 0.0
    """N·m·s/rad, 0 to 5, in steps of 0.001221"""
    torque: float = 0.0
    """N·m, -54 to 54, in steps of 0.0263736"""


@dataclass(kw_only=True)
class Feedback(TypedMessage, family="mit", message="Feedback"):
    """Answer of a motor to every frame to it. Drive → host: answer of one drive."""

    limb: int = 0
    """0 to 7"""
    axis: int = 0
    """0 to 6"""
    error: Error | int = Error.DISABLED
    position: float = 0.0
    """rad, -12.5 to 12.5, in steps of 0.000381476"""
    velocity: float = 0.0
    """rad/s, -45 to 45, in steps of 0.021978"""
    torque: float = 0.0
    """N·m, -54 to 54, in steps of 0.0263736"""
    temperature_mosfet: float = 0.0
    """°C, 0 to 255, in steps of 1"""
    temperature_rotor: float = 0.0
    """°C, 0 to 255, in steps of 1"""


AnyMessage = Control | Command | Feedback
MESSAGES = (Control, Command, Feedback)


def decode(message: can.Message) -> AnyMessage | None:
    """What a frame says; None: its identifier is none of this family's. Raises FrameError for a damaged one."""
    return decode_any(MESSAGES, message)
