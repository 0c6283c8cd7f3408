"""Inertial measurement unit. Typed messages of the family `imu`, made from its description by `handrail drives types
imu`; do not edit."""

from __future__ import annotations

from dataclasses import dataclass

import can

from hal.drives.typed import NEXT, NOW, TypedMessage, decode_any


@dataclass(kw_only=True)
class ImuStatus(TypedMessage, family="imu", message="ImuStatus"):
    """Orientation of the sensor in the world as a quaternion, angular velocity and specific force in the sensor's frame
    (REP 145). Device → host."""

    device: int = 0
    """0 to 7"""
    orientation_x: float = 0.0
    """-1.048576 to 1.048575875, in steps of 1.25e-07"""
    orientation_y: float = 0.0
    """-1.048576 to 1.048575875, in steps of 1.25e-07"""
    orientation_z: float = 0.0
    """-1.048576 to 1.048575875, in steps of 1.25e-07"""
    orientation_w: float = 0.0
    """-1.048576 to 1.048575875, in steps of 1.25e-07"""
    angular_velocity_x: float = 0.0
    """rad/s, -83.88608 to 83.88607, in steps of 1e-05"""
    angular_velocity_y: float = 0.0
    """rad/s, -83.88608 to 83.88607, in steps of 1e-05"""
    angular_velocity_z: float = 0.0
    """rad/s, -83.88608 to 83.88607, in steps of 1e-05"""
    linear_acceleration_x: float = 0.0
    """m/s^2, -163.84 to 163.835, in steps of 0.005; with gravity: at rest it points up"""
    linear_acceleration_y: float = 0.0
    """m/s^2, -163.84 to 163.835, in steps of 0.005"""
    linear_acceleration_z: float = 0.0
    """m/s^2, -163.84 to 163.835, in steps of 0.005"""
    sequence: int = NEXT
    """0 to 255; of this sensor's own frames"""
    time: int = NOW
    """µs, 0 to 65535; of the sensor's clock, when this was measured"""


AnyMessage = ImuStatus
MESSAGES = (ImuStatus,)


def decode(message: can.Message) -> AnyMessage | None:
    """What a frame says; None: its identifier is none of this family's. Raises FrameError for a damaged one."""
    return decode_any(MESSAGES, message)
