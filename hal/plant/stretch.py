"""Several milliseconds of drives and bodies in one compiled call, while nobody looks at the world in between."""

from __future__ import annotations

import numpy as np

from hal.plant.drive_kernels import STEP_NS
from hal.plant.drive_kernels import step as live
from hal.plant.drive_node import DriveNodes
from hal.plant.joint_port import JointPort, feel_joint, sensors_of, submit, wait
from handrail.compiled import compiled


def stretch(drives: DriveNodes, joints: JointPort, steps: int, firmware_cycles: int, felt: np.ndarray) -> int:
    """Go on by `steps` ms; returns how many, fewer where a brake has to move. Only for a `joints.native` port.

    felt: PyBullet's joints whose forces are worked out in the last of the steps, until somebody says otherwise. With fewer steps
    `drives.brakes_moved`: drives and firmware are a step ahead of the bodies, which still want `actuators.spring_torque`.
    """
    actuators = drives.actuators
    done = _go_on(
        steps, firmware_cycles, drives.now_ns, drives.memory, actuators.memory, actuators.spring_torque, felt, *joints.parts
    )  # fmt: skip
    drives.now_ns += min(done + 1, steps) * STEP_NS
    drives.brakes_moved = done < steps
    return int(done)


@compiled
def _go_on(steps, cycles, now, drives, actuators, torque, felt, client, body, places, memory, pointers):  # type: ignore[no-untyped-def]
    """Whole steps made, the brakes as they are. client ... pointers: JointPort's parts."""
    n = len(torque)
    for k in range(steps):
        if k == steps - 1 and len(felt):
            command = sensors_of(client, np.int32(body))
            for joint in felt:
                feel_joint(command, np.int32(joint), np.int32(1))
            wait(client, command)
        if live(now + k * STEP_NS, cycles, memory[:n], memory[n : 2 * n], drives, actuators):
            return k
        submit(client, body, torque, places, memory, pointers)
    return steps
