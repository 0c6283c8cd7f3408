"""The nodes of the robot that are no joints, as the bus sees them: sensors, grippers, power; rows as `description.devices`.

A device of a family that the plant does not know measures zeros and follows nothing: whoever brings a family of his own
brings its firmware as a process on the bus.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from hal.device import DeviceState
from hal.drives.lifecycle import DriveError, State
from hal.plant.hands import Gripper
from hal.plant.joint_port import JointPort
from hal.plant.power import Battery
from hal.plant.robot_body import BASE, RobotBody
from hal.plant.sensor_noise import Noise
from hal.plant.sensors import FORCE_TORQUE, IMU, MEMORY, ForceTorque, Imu, feel

if TYPE_CHECKING:
    from hal.plant.drive_node import DriveNodes


class DevicePlant:
    """All devices of one robot in a world. `state` is what was last measured, in hal.device's columns."""

    def __init__(self, body: RobotBody, drives: DriveNodes, clock: Callable[[], int]):
        """`clock`: the world's time, ns.

        Raises ValueError for a force-torque sensor on a link that can't have one.
        """
        self.devices = body.description.devices
        self.state = DeviceState(len(self.devices))
        self.grippers: dict[int, Gripper] = {}
        """row → gripper"""
        self.batteries: dict[int, Battery] = {}
        """row → battery. A drive has power while all of them give it"""
        self._noise = Noise(self.devices, body.description.period_ns * 1e-9)
        self._imus: dict[int, Imu] = {}
        self._wrists: dict[int, ForceTorque] = {}
        self._drives = drives
        self._clock = clock
        self._powered = self._had_power = self._sensing = True
        self._body = body
        for row, device in enumerate(self.devices):
            match device.family:
                case "imu":
                    self._imus[row] = Imu(body, device.link)
                case "force_torque":
                    self._wrists[row] = ForceTorque(body, device.link)
                case "gripper":
                    self.grippers[row] = Gripper(body, device.joint)
                case "power":
                    self.batteries[row] = Battery()

        self.felt = np.array([wrist.carrier for wrist in self._wrists.values() if wrist.simple], np.int64)
        """PyBullet's joints that `sense` is about"""
        joints = {row: wrist.carrier for row, wrist in self._wrists.items()}
        joints |= {row: body.joints[gripper.joint] for row, gripper in self.grippers.items()}
        self._at = {row: place for place, row in enumerate(joints)}
        self.joints = tuple(joints.values())
        """PyBullet's joints whose states the devices want to know"""
        links = {imu.carrier for imu in self._imus.values()} - {BASE}
        self.links = tuple(sorted(links.union(*(wrist.links for wrist in self._wrists.values()))))
        """PyBullet's links whose motion they want to know"""

    def attach(self, joints: JointPort) -> None:
        """Read joints and links there from now on; it has to watch `joints` and `links`."""
        self._port = joints
        self._moved = dict(zip(self.links, joints.moved, strict=True))
        plan = [
            (IMU, row, self.links.index(imu.carrier)) for row, imu in self._imus.items() if imu.carrier in self.links
        ]
        plan += [(FORCE_TORQUE, row, self._at[row]) for row, wrist in self._wrists.items() if wrist.simple]
        self._plan = np.array(plan, np.int64).reshape(-1, 3)
        memories = [(self._imus if kind == IMU else self._wrists)[row].memory for kind, row, _ in plan]
        self._memories = np.array(memories).reshape(-1, MEMORY)
        # What no compiled code measures.
        self._on_base = {row: imu for row, imu in self._imus.items() if imu.carrier not in self.links}
        self._mechanisms = {row: wrist for row, wrist in self._wrists.items() if not wrist.simple}

    @property
    def powered(self) -> bool:
        """The drives have power."""
        return self._powered

    def _look_at_power(self) -> None:
        self._powered = all(battery.powered for battery in self.batteries.values())
        for battery in self.batteries.values():
            self._drives.bus_voltage[:] = battery.voltage if self._powered else 0.0

    def sense(self, on: bool) -> None:
        """Let the joints' forces be worked out in the steps to come, or not: nobody measures after those."""
        if on != self._sensing:
            self._sensing = on
            for wrist in self._wrists.values():
                wrist.sense(on)

    def note_felt(self, on: bool) -> None:
        """Say that somebody else has let the forces of the joints `felt` be worked out from now on, or has not."""
        if on:
            self._sensing = True

    def measure(self, due: npt.NDArray[np.bool_] | None = None) -> DeviceState:
        """Measure everything, as the world stands now; batteries only where `due` (d,), if given. Returns `state`."""
        state, time_ns = self.state, self._clock()
        values, port = state.values, self._port
        port.look_at_links()
        for row, imu in self._on_base.items():
            imu.measure(np.concatenate(self._body.base_motion()), time_ns, values[row])
        for row, wrist in self._mechanisms.items():
            wrist.measure(self._moved, time_ns, values[row])
        for row, gripper in self.grippers.items():
            gripper.measure(port.felt[self._at[row]], time_ns, values[row])
        actuators = self._drives.actuators
        for row, battery in self.batteries.items():
            if due is not None and not due[row]:
                continue  # its charge falls over hours: what passed since it was last asked is enough
            battery.draw(time_ns, float(actuators.spring_torque @ port.velocity), actuators.current)
            battery.measure(values[row])
            self._look_at_power()
        feel(self._plan, self._memories, port.moved, port.felt, self._noise.draw(), state.memory, float(time_ns))
        return state

    def command(self, row: int, values: npt.NDArray[np.float64]) -> None:
        """Let one device follow hal.device's commanded columns."""
        if row in self.grippers:
            self.grippers[row].command(values, self.powered)
        elif row in self.batteries:
            self.batteries[row].relay = bool(values[0] >= 0.5)
            self._look_at_power()

    def work_power(self) -> None:
        """Once a step: drives without power fault, and go on doing so until it is back."""
        powered, drives = self._powered, self._drives
        if powered and self._had_power:
            return
        if not powered:
            for row in np.flatnonzero((drives.error != DriveError.UNDERVOLTAGE) | (drives.state != State.FAULT)):
                drives.fail(int(row), DriveError.UNDERVOLTAGE)
        if powered != self._had_power:
            self._had_power = powered
            for gripper in self.grippers.values():
                gripper.regain_power() if powered else gripper.lose_power()
