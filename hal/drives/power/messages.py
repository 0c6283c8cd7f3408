"""Power supply. Typed messages of the family `power`, made from its description by `handrail drives types power`; do
not edit."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import can

from hal.drives.typed import NEXT, NOW, TypedMessage, decode_any


class Relay(IntEnum):
    OPEN = 0
    CLOSED = 1


@dataclass(kw_only=True)
class PowerCommand(TypedMessage, family="power", message="PowerCommand"):
    """Open or close the relay of the motors' supply. Host → device."""

    device: int = 0
    """0 to 7"""
    relay: Relay = Relay.OPEN
    sequence: int = NEXT
    """0 to 255; a command whose number does not go on from the last one's counts for nothing"""


@dataclass(kw_only=True)
class PowerStatus(TypedMessage, family="power", message="PowerStatus"):
    """Supply of the motors. Device → host."""

    device: int = 0
    """0 to 7"""
    voltage: float = 0.0
    """V, 0 to 655.35, in steps of 0.01"""
    current: float = 0.0
    """A, -327.68 to 327.67, in steps of 0.01"""
    charge: float = 0.0
    """0 to 1.275, in steps of 0.005; of the battery, 0 to 1"""
    temperature: float = 0.0
    """°C, 0 to 255, in steps of 1; of the battery"""
    relay: Relay = Relay.OPEN
    sequence: int = NEXT
    """0 to 255; of this node's own frames"""
    time: int = NOW
    """µs, 0 to 65535; of the node's clock, when this was measured"""


AnyMessage = PowerCommand | PowerStatus
MESSAGES = (PowerCommand, PowerStatus)


def decode(message: can.Message) -> AnyMessage | None:
    """What a frame says; None: its identifier is none of this family's. Raises FrameError for a damaged one."""
    return decode_any(MESSAGES, message)
