"""What the nodes that are no joints measured, and what is wrong with them, from a snapshot to messages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hal.device import SILENT_AFTER
from hal.drives.lifecycle import State
from handrail.messages import (
    DeviceStates,
    DeviceStatus,
    DeviceValues,
    ForceTorqueState,
    GripperState,
    ImuState,
    PowerState,
)
from handrail.robot.description import Device, RobotDescription

_LOW_CHARGE = 0.15
_OWN_MESSAGES = {"imu", "force_torque", "gripper", "power"}


def device_states(
    snapshot: np.ndarray | np.void, description: RobotDescription, columns: Mapping[str, Sequence[str]]
) -> DeviceStates:
    """Every device's last measurement; ages say how old each is.

    `columns`: family → names of its measured columns, for families that have no message of their own.
    """
    states = DeviceStates(time_ns=int(snapshot["time_ns"]))
    for device, values, age in _rows(snapshot, description):
        common: dict[str, Any] = {"name": device.name, "age": age}
        match device.family:
            case "imu":
                qx, qy, qz, qw, wx, wy, wz, ax, ay, az = values[:10]
                states.imus.append(
                    ImuState(
                        **common,
                        orientation=(qx, qy, qz, qw),
                        angular_velocity=(wx, wy, wz),
                        linear_acceleration=(ax, ay, az),
                    )
                )
            case "force_torque":
                fx, fy, fz, tx, ty, tz = values[:6]
                states.force_torques.append(ForceTorqueState(**common, force=(fx, fy, fz), torque=(tx, ty, tz)))
            case "gripper":
                position, velocity, effort, temperature, _, holding = values[:6]
                states.grippers.append(
                    GripperState(
                        **common,
                        joint=device.joint,
                        position=position,
                        velocity=velocity,
                        effort=effort,
                        temperature=temperature,
                        state=gripper_state(values) if age <= SILENT_AFTER else "unknown",
                        holding=holding > 0.5,
                    )
                )
            case "power":
                voltage, current, charge, temperature, relay = values[:5]
                states.powers.append(
                    PowerState(
                        **common,
                        voltage=voltage,
                        current=current,
                        charge=charge,
                        temperature=temperature,
                        relay=relay > 0.5,
                    )
                )
            case family:
                names = list(columns.get(family, ()))
                states.others.append(DeviceValues(**common, family=family, columns=names, values=values[: len(names)]))
    return states


def device_statuses(snapshot: np.ndarray | None, description: RobotDescription) -> list[DeviceStatus]:
    """What is wrong with each device; None: no loop tells."""
    if snapshot is None:
        return [
            DeviceStatus(name=device.name, family=device.family, problem="unknown") for device in description.devices
        ]
    problems = zip(description.devices, device_problems(snapshot, description), strict=True)
    return [DeviceStatus(name=device.name, family=device.family, problem=problem) for device, problem in problems]


def device_problems(snapshot: np.ndarray, description: RobotDescription) -> list[str]:
    """What is wrong with each device; empty: nothing."""
    return [_problem(device, values, age) for device, values, age in _rows(snapshot, description)]


def other_columns(description: RobotDescription) -> dict[str, tuple[str, ...]]:
    """Family → names of its measured columns, of the robot's families that have no message of their own.

    Raises config.ConfigError for a family that there is not.
    """
    others = {device.family for device in description.devices} - _OWN_MESSAGES
    if not others:
        return {}
    from hal.drives import family  # with its DBC reader and compiled kernels: most robots' servers do without
    from hal.drives.fields import Role

    return {name: family.load(name).columns(Role.DEVICE_STATUS) for name in others}


def _problem(device: Device, values: Sequence[float], age: int) -> str:
    if age > SILENT_AFTER:
        return "does not answer"
    if device.family == "gripper" and gripper_state(values) == "fault":
        return "fault"
    if device.family == "power":
        if values[4] <= 0.5:
            return "its relay is open: the drives have no power"
        if values[2] < _LOW_CHARGE:
            return f"battery low: {values[2]:.0%}"
    return ""


def _rows(snapshot: np.ndarray | np.void, description: RobotDescription) -> list[tuple[Device, list[float], int]]:
    values, ages = snapshot["device_values"].tolist(), snapshot["device_age"].tolist()
    return list(zip(description.devices, values, ages, strict=True))


def gripper_state(values: Sequence[float] | np.ndarray) -> str:
    """A gripper's CiA 402 state in words, by its measured columns."""
    try:
        return State(round(values[4])).name.lower()
    except ValueError:
        return "unknown"
