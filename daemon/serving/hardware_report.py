"""Every drive and device as one component, with its life in ros2_control's words.

=============  ======================================================================================================
unknown        no loop runs that could tell
unconfigured   it does not answer
inactive       it answers, and takes no set-points: a drive or gripper outside of operation enabled (CiA 402), faults too
active         a drive or gripper in operation enabled; a sensor or power supply that answers
=============  ======================================================================================================
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from daemon.serving.device_reports import device_statuses, gripper_state
from daemon.serving.drive_reports import drive_statuses
from hal.device import SILENT_AFTER
from handrail.messages import HardwareComponent
from handrail.robot.description import RobotDescription

_HEAT = {"gripper": 3, "power": 3}
"""family → its measured column that is a temperature (hal.device)"""


def components(
    snapshot: np.ndarray | None, description: RobotDescription, bus_states: Mapping[str, str]
) -> Iterator[HardwareComponent]:
    """Drives in the joints' order, then devices; snapshot None: no loop tells. `bus_states`: channel → state, where known."""
    limbs = {joint: limb for limb in description.limbs for joint in limb.joints}
    for row, drive in enumerate(drive_statuses(snapshot, description)):
        limb = limbs[drive.joint]
        made = HardwareComponent(
            name=drive.joint,
            family=limb.family,
            channel=limb.channel,
            bus_state=bus_states.get(limb.channel, ""),
            life="unknown" if snapshot is None else _life(drive.state),
            state=drive.state,
            problem=drive.problem,
        )
        if snapshot is not None:
            made.age = int(snapshot["age"][row])
            made.firmware_version = _version(snapshot["firmware_version"][row])
            made.protocol_version = _version(snapshot["protocol_version"][row])
            if made.life != "unconfigured":
                made.error, made.temperature = drive.error, drive.temperature
        yield made
    for row, (device, status) in enumerate(
        zip(description.devices, device_statuses(snapshot, description), strict=True)
    ):
        made = HardwareComponent(
            name=device.name,
            family=device.family,
            channel=device.channel,
            bus_state=bus_states.get(device.channel, ""),
            life="unknown",
            problem=status.problem,
        )
        if snapshot is not None:
            made.age, values = int(snapshot["device_age"][row]), snapshot["device_values"][row]
            made.life = "active" if made.age <= SILENT_AFTER else "unconfigured"
            if made.life == "active":
                if device.family == "gripper":
                    made.state = gripper_state(values)
                    made.life = _life(made.state)
                if (column := _HEAT.get(device.family)) is not None:
                    made.temperature = float(values[column])
        yield made


def _life(state: str) -> str:
    """Of a drive, by its CiA 402 state in words."""
    return {"unknown": "unconfigured", "operation_enabled": "active"}.get(state, "inactive")


def _version(told: float) -> int | None:
    return None if np.isnan(told) else round(told)
