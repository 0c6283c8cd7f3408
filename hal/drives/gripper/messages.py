"""Gripper. Typed messages of the family `gripper`, made from its description by `handrail drives types gripper`; do not
edit."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import can

from hal.drives.lifecycle import DriveError, State
from hal.drives.typed import NEXT, NOW, TypedMessage, decode_any


class Enable(IntEnum):
    DISABLE = 0
    ENABLE = 1


@dataclass(kw_only=True)
class GripperCommand(TypedMessage, family="gripper", message="GripperCommand"):
    """Close or open to a position with no more than this velocity and effort. Host → device."""

    device: int = 0
    """0 to 7"""
    position: float = 0.0
    """rad or m, -8.388608 to 8.388607, in steps of 1e-06"""
    velocity: float = 0.0
    """rad/s or m/s, 0 to 65.535, in steps of 0.001"""
    effort: float = 0.0
    """N*m or N, 0 to 1310.7, in steps of 0.02"""
    enable: Enable | int = Enable.DISABLE
    """a gripper that is not enabled has no torque and keeps its brake closed"""
    sequence: int = NEXT
    """0 to 255; a command whose number does not go on from the last one's counts for nothing"""
    watchdog: int = 0
    """0 to 255; host cycles without a valid command after which the gripper is disabled; 0: it never is"""


@dataclass(kw_only=True)
class GripperStatus(TypedMessage, family="gripper", message="GripperStatus"):
    """State of a gripper's one drive. Device → host."""

    device: int = 0
    """0 to 7"""
    position: float = 0.0
    """rad or m, -8.388608 to 8.388607, in steps of 1e-06"""
    velocity: float = 0.0
    """rad/s or m/s, -32.768 to 32.767, in steps of 0.001"""
    effort: float = 0.0
    """N*m or N, -655.36 to 655.34, in steps of 0.02"""
    temperature: float = 0.0
    """°C, 0 to 255, in steps of 1"""
    state: State = State.NOT_READY_TO_SWITCH_ON
    """CiA 402"""
    holding: bool = False
    """1: something stopped it before its goal"""
    error: DriveError | int = DriveError.NONE
    sequence: int = NEXT
    """0 to 255; of this gripper's own frames"""
    time: int = NOW
    """µs, 0 to 65535; of the gripper's clock, when this was measured"""


AnyMessage = GripperCommand | GripperStatus
MESSAGES = (GripperCommand, GripperStatus)


def decode(message: can.Message) -> AnyMessage | None:
    """What a frame says; None: its identifier is none of this family's. Raises FrameError for a damaged one."""
    return decode_any(MESSAGES, message)
