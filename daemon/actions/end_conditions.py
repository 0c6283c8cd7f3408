"""End conditions, checked in the loop's cycle: what was measured against what the action allows.

Each is a pure function from measurements to the value that tripped it, or None; those about motion know where it began.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from daemon.safety.rules import Followed
from daemon.state.robot_state import RobotState
from hal.hardware import LOST_AFTER
from handrail.messages import (
    ContactEnd,
    DivergenceEnd,
    EndCondition,
    ForceEnd,
    GripperAtEnd,
    GripperHoldsEnd,
    JointLimitEnd,
    PoseErrorEnd,
    StallEnd,
    TimeEnd,
    TorqueLimitEnd,
    TravelEnd,
)

Array = NDArray[np.float64]

ORDER_S = 0.05
"""for which a gripper has had an order that came with the motion, before it counts that it holds something: what it told of an
order before is over then"""


class Trip(NamedTuple):
    """An end condition that is met."""

    condition: int
    """its index among the action's"""
    value: float
    """what was measured: s, m, N, rad, or a share"""
    joint: int
    """row of the joint that it was about; −1: none"""


class Place(NamedTuple):
    """Where a frame was, and when."""

    translation: Array
    """(3,) m, world"""
    since: float
    """s of the action's running time"""


def first_met(
    ends: tuple[EndCondition, ...],
    running: float,
    joints: NDArray[np.int64],
    seen: Followed,
    robot: RobotState,
    places: dict[int, Place],
    lag: Callable[[RobotState, str], Array] = RobotState.lag,
) -> Trip | None:
    """The first of `ends` that is met in this cycle, in their order.

    `running`: s that the action has run; `joints`: rows that it claims; `seen`: how they follow. Force conditions
    read `robot.wrenches`, which the caller keeps estimated at `force_frames(ends)`. `places`: the action's memory, empty at first;
    `lag`: how far a frame is behind its command.
    """
    for number, end in enumerate(ends):
        value: float | None = None
        joint = -1
        match end:
            case TimeEnd():
                value = running if running >= end.after else None
            case PoseErrorEnd():
                value = beyond(distance(lag(robot, end.frame), end.axis), end.position)
            case ForceEnd():
                value = beyond(distance(robot.wrenches[end.frame][:3], end.axis), end.limit)
            case ContactEnd():
                value = beyond(distance(robot.wrenches[end.frame][:3], None), end.threshold)
            case JointLimitEnd():
                description = robot.kinematics.description
                room = room_to_limits(
                    robot.joints.position[joints], description.lower[joints], description.upper[joints]
                )
                closest = int(np.argmin(room))
                if room[closest] < end.margin:
                    value, joint = float(room[closest]), int(joints[closest])
            case DivergenceEnd():
                if seen.off > end.error:
                    joint, value = seen.farthest, seen.off
            case TorqueLimitEnd():
                most = robot.kinematics.description.torque_limit[joints]
                shares = np.abs(robot.joints.torque[joints]) / most
                highest = int(np.argmax(shares))
                if shares[highest] > end.share:
                    value, joint = float(shares[highest]), int(joints[highest])
            case TravelEnd():
                here = robot.carried(end.frame).translation
                start = places.setdefault(number, Place(here.copy(), running))
                value = beyond(distance(here - start.translation, end.axis), end.distance)
            case StallEnd():
                here = robot.carried(end.frame).translation
                last = places.setdefault(number, Place(here.copy(), running))
                moved = distance(here - last.translation, None)
                if moved >= end.distance:
                    places[number] = Place(here.copy(), running)
                elif running - last.since >= end.within:
                    value = moved
            case GripperHoldsEnd():
                hand = robot.hand(end.gripper)
                if hand is not None and hand.holds and running - hand.age * robot.period >= ORDER_S:
                    value = hand.position
            case GripperAtEnd():
                hand = robot.hand(end.gripper)
                if hand is not None and hand.age <= LOST_AFTER and abs(hand.position - end.position) <= end.tolerance:
                    value = hand.position
        if value is not None:
            return Trip(number, value, joint)
    return None


def force_frames(ends: tuple[EndCondition, ...]) -> tuple[str, ...]:
    """The frames at which the external force has to be known."""
    return tuple(end.frame for end in ends if isinstance(end, ForceEnd | ContactEnd))


def beyond(value: float, limit: float) -> float | None:
    """`value` where it exceeds `limit`."""
    return value if value > limit else None


def distance(vector: Array, axis: tuple[float, float, float] | None) -> float:
    """Length of a vector (3,), or of its part along `axis` (any length but zero)."""
    if axis is None:
        x, y, z = vector.tolist()
        return math.sqrt(x * x + y * y + z * z)
    along = np.asarray(axis, float)
    return float(abs(vector @ along) / np.sqrt(along @ along))


def room_to_limits(position: Array, lower: Array, upper: Array) -> Array:
    """rad to the nearer position limit, negative beyond it."""
    return np.minimum(position - lower, upper - position)
