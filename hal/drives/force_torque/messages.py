"""Force-torque sensor. Typed messages of the family `force_torque`, made from its description by `handrail drives types
force_torque`; do not edit."""

from __future__ import annotations

from dataclasses import dataclass

import can

from hal.drives.typed import NEXT, NOW, TypedMessage, decode_any


@dataclass(kw_only=True)
class ForceTorqueStatus(TypedMessage, family="force_torque", message="ForceTorqueStatus"):
    """Wrench on the sensor, in its link's frame. Device → host."""

    device: int = 0
    """0 to 7"""
    force_x: float = 0.0
    """N, -8388.608 to 8388.607, in steps of 0.001"""
    force_y: float = 0.0
    """N, -8388.608 to 8388.607, in steps of 0.001"""
    force_z: float = 0.0
    """N, -8388.608 to 8388.607, in steps of 0.001"""
    torque_x: float = 0.0
    """N·m, -838.8608 to 838.8607, in steps of 0.0001"""
    torque_y: float = 0.0
    """N·m, -838.8608 to 838.8607, in steps of 0.0001"""
    torque_z: float = 0.0
    """N·m, -838.8608 to 838.8607, in steps of 0.0001"""
    sequence: int = NEXT
    """0 to 255; of this sensor's own frames"""
    time: int = NOW
    """µs, 0 to 65535; of the sensor's clock, when this was measured"""


AnyMessage = ForceTorqueStatus
MESSAGES = (ForceTorqueStatus,)


def decode(message: can.Message) -> AnyMessage | None:
    """What a frame says; None: its identifier is none of this family's. Raises FrameError for a damaged one."""
    return decode_any(MESSAGES, message)
