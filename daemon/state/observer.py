"""What something outside exerts on the robot: felt by its joints (a momentum observer), or by a force-torque sensor.

Sources: De Luca, Mattone: Sensorless robot collision detection and hybrid force/motion control, ICRA 2005; Haddadin, De Luca,
Albu-Schäffer: Robot collisions, a survey on detection, isolation, and identification, T-RO 33(6), 2017, §III-D.
"""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from daemon.state import observer_kernels as kernels
from daemon.wbc import dynamics
from daemon.wbc.memory import Memory
from hal.device import DeviceState
from hal.joint import JointState
from handrail.compiled import compiled
from handrail.robot.kinematics import Kinematics

Array = NDArray[np.float64]

OBSERVER_HZ, SENSOR_HZ = 15.0, 30.0
"""of the observer's two poles (the second takes away what the first leaves of the velocities' noise), and of what a sensor tells"""
SENSOR_AGE = 10
"""cycles since its last frame after which a sensor is not asked any more, and the joints are"""
_TORQUE_NOISE, _LARGEST_FORCE, _LARGEST_MOMENT = 0.005, 100.0, 10.0
"""What the damping weighs against each other: errors of torques, as a share of each joint's limit; N, N·m to be expected"""


class MomentumObserver:
    """Torques that something outside exerts on the joints: N·m, `residual`, in the order of the model's velocities.

    With p = M(q) q̇ the observer is r = K (p(t) − p(0) − ∫ (τ_spring + Cᵀ q̇ − g + r) ds), so that r follows τ_ext as a first-order
    low-pass of rate K: acceleration needs not be known, nor M inverted. Here in increments, exact for r over a cycle of length h:
    Δr = (1 − e^(−K h)) (M Δq̇ / h + C q̇ + g − τ̄ − r), since Δp = M Δq̇ + Ṁ q̇ h and Ṁ q̇ = C q̇ + Cᵀ q̇; so one pass of inverse
    dynamics does it. τ̄ is the mean of the torques at the cycle's ends. The momentum is as noisy as the velocities, and so is r:
    `residual` is r behind a second low-pass of the same rate.
    """

    def __init__(self, kinematics: Kinematics, joints: JointState, period: float):
        self.data = kinematics.model.createData()
        self.memory = kernels.memory_of(kinematics.model, self.data)
        """after `update`: velocities and accelerations (gravity's included) of the robot as it moves; of the kernels"""
        self.tree = dynamics.tree(kinematics.model, kinematics.index_v)
        self._kept = self.memory["kept"]
        self.residual = self._kept[kernels.RESIDUAL]
        self._rows, self._joints, self._period = kinematics.index_v, joints, period
        self._gain = 1.0 - math.exp(-2.0 * math.pi * OBSERVER_HZ * period)
        self._running = False

    def stop(self) -> None:
        """Forget what was: the next `update` is a first one."""
        self._running = False

    def update(self, q: Array, velocity: Array) -> None:
        """Once a cycle, at the model's configuration and velocity: the first time as if all were still."""
        gain, torque = self._gain, self._joints.torque
        if not self._running:
            self._running, gain = True, 1.0
            self._kept[kernels.LAST_VELOCITY], self._kept[kernels.LAST_TORQUE, self._rows] = velocity, torque
        kernels.observe(q, velocity, torque, gain, self._period, self.memory.table, self.tree)


class WristSensor:
    """A force-torque sensor, freed of the weight and inertia of what is mounted on it."""

    def __init__(self, kinematics: Kinematics, link: str, row: int, devices: DeviceState, offsets: Array | None = None):
        """`offsets` (devices, 6): where its own offset lies; None: anywhere."""
        model = kinematics.model
        self._told, self._age, self._row = devices.values[row, :6], devices.age, row
        self.offset = np.zeros(6) if offsets is None else offsets[row]
        """N, N·m that it tells when nothing is there, in its own axes: see daemon.state.taring"""
        frame = model.frames[kinematics.frame_id(link)]
        self._joint, self._placement = frame.parentJoint, frame.placement
        # Of what is beyond: the links that are fixed to it, and moving ones (a gripper's fingers) where they are at the start.
        data = model.createData()
        pin.framesForwardKinematics(model, data, kinematics.configuration(kinematics.description.home_position()))
        into_joint = data.oMi[self._joint].inverse()
        carried = {frame.parentFrame}
        self.inertia = self._of(model, frame.parentFrame, into_joint, data)
        """of all that it carries, in the frame of the joint that carries it"""
        for number, other in enumerate(model.frames):
            if other.parentFrame in carried and number not in carried:
                carried.add(number)
                if model.frames[frame.parentFrame].type != pin.JOINT or other.parentJoint != self._joint:
                    self.inertia += self._of(model, number, into_joint, data)
        self.frames = frozenset(model.frames[number].name for number in carried)
        """that the sensor carries, its own link included"""
        self._known = kernels.sensor_of(self._placement, self.inertia, self._joint)

    def _of(self, model: pin.Model, number: int, into_joint: pin.SE3, data: pin.Data) -> pin.Inertia:
        """What begins at a frame of the model, in the carrying joint's frame: a moving joint's with all that is fixed to it."""
        frame = model.frames[number]
        if frame.type == pin.JOINT:
            return (into_joint * data.oMi[frame.parentJoint]).act(model.inertias[frame.parentJoint])
        if frame.parentJoint != self._joint:
            return pin.Inertia.Zero()  # its moving joint has it
        return (into_joint * data.oMf[number]).act(frame.inertia)

    @property
    def fresh(self) -> bool:
        """It has told something lately."""
        return bool(self._age[self._row] <= SENSOR_AGE)

    def excess(self, moved: Memory) -> Array:
        """(6,) N, N·m, its own axes: what it tells beyond weight and inertia of what it carries.

        `moved`: with each joint's velocity and acceleration, gravity's included (`MomentumObserver.memory`).
        """
        felt = np.zeros(6)
        kernels.feel_beyond(self._known, self._told, self.offset, moved.table, felt)
        return felt + self.offset

    def at(self, frame: pin.Frame) -> Array:
        """(FELT,): what `kernels.observe` is to know of this sensor, about a frame's origin."""
        known = self._known.copy()
        known[kernels.FRAME_JOINT], known[kernels.DEVICE] = frame.parentJoint, self._row
        known[kernels.FRAME_P : kernels.FRAME_P + 3] = frame.placement.translation
        return known


class ExternalWrenches:
    """Wrenches at frames, each as if its frame were the only one touched."""

    def __init__(self, kinematics: Kinematics, joints: JointState, period: float, devices: DeviceState | None = None):
        self.wrenches: dict[str, Array] = {}
        """frame → (6,) N, N·m about its origin, world axes: what something outside exerts there"""
        self._kinematics = kinematics
        self._observer = MomentumObserver(kinematics, joints, period)
        self._gain = 1.0 - math.exp(-2.0 * math.pi * SENSOR_HZ * period)
        self._squared_weight = 1.0 / kinematics.description.torque_limit**2
        self._rows = kinematics.index_v
        self.sensors: dict[int, WristSensor] = {}
        """row of RobotDescription.devices → the sensor"""
        self._frames: Collection[str] = ()
        self._felt: list[tuple[str, WristSensor | None]] = []
        """of each frame, who carries it"""
        if devices is not None and len(devices):
            memory = self._observer.memory
            memory.put("told", devices.values)
            offsets = memory.make("offset", len(devices), 6)
            self.sensors = {
                row: WristSensor(kinematics, device.link, row, devices, offsets)
                for row, device in enumerate(kinematics.description.devices)
                if device.family == "force_torque"
            }

    def update(self, frames: Collection[str], q: Array, velocity: Array) -> None:
        """Once a cycle, for these frames."""
        begun = frames is not self._frames and frames != self._frames
        if begun:
            self._ask_at(frames)
        if not frames:
            self._observer.stop()
            return
        self._observer.update(q, velocity)
        for frame, sensor in self._felt:
            if sensor is None or not sensor.fresh:
                self._feel_by_joints(self.wrenches[frame], frame, q)
        if begun:
            felt = self._observer.memory["felt"]
            felt[felt[:, kernels.GAIN] > 0.0, kernels.GAIN] = self._gain

    def _ask_at(self, frames: Collection[str]) -> None:
        """From this cycle on at these frames; a frame's first wrench counts fully."""
        memory, before = self._observer.memory, dict(self.wrenches)
        self._frames, self._felt = frames, [(frame, self._sensor(frame)) for frame in frames]
        known = memory.make("felt", len(frames), kernels.FELT)
        wrenches = memory.make("wrench", len(frames), 6)
        self.wrenches.clear()
        for row, wrench, (frame, sensor) in zip(known, wrenches, self._felt, strict=False):
            self.wrenches[frame] = wrench
            if frame in before:
                wrench[:] = before[frame]
            if sensor is not None:
                row[:] = sensor.at(self._kinematics.model.frames[self._kinematics.frame_id(frame)])
                row[kernels.GAIN] = self._gain if frame in before else 1.0

    @property
    def moved(self) -> Memory:
        """As the observer saw the robot move in the last `update`; see WristSensor.excess."""
        return self._observer.memory

    def by_joints(self, frame: str, q: Array) -> Array:
        """(6,) N, N·m, world axes, at a frame, as the joints tell it; after `update`."""
        wrench = np.zeros(6)
        self._feel_by_joints(wrench, frame, q)
        return wrench

    def _feel_by_joints(self, wrench: Array, frame: str, q: Array) -> None:
        kinematics, observer = self._kinematics, self._observer
        number = kinematics.frame_id(frame)
        jacobian = pin.computeFrameJacobian(kinematics.model, observer.data, q, number, pin.LOCAL_WORLD_ALIGNED)
        _least_squares(wrench, jacobian, observer.residual, self._rows, self._squared_weight)

    def _sensor(self, frame: str) -> WristSensor | None:
        return next((sensor for sensor in self.sensors.values() if frame in sensor.frames), None)


@compiled
def _least_squares(wrench, jacobian, residual, rows, squared_weight):  # type: ignore[no-untyped-def]
    """wrench (6,) ← argmin over F of Σ_j (w_j (Jᵀ F − r)_j)² + noise² (|force|²/largest² + |moment|²/largest²), by Cholesky."""
    normal, right = np.zeros((6, 6)), np.zeros(6)
    for a in range(6):
        normal[a, a] = (_TORQUE_NOISE / (_LARGEST_FORCE if a < 3 else _LARGEST_MOMENT)) ** 2
    for i in range(rows.shape[0]):
        j, weight = rows[i], squared_weight[i]
        for a in range(6):
            weighted = weight * jacobian[a, j]
            if weighted == 0.0:
                continue
            right[a] += weighted * residual[j]
            for b in range(a + 1):
                normal[a, b] += weighted * jacobian[b, j]
    for a in range(6):
        for b in range(a + 1):
            rest = normal[a, b]
            for c in range(b):
                rest -= normal[a, c] * normal[b, c]
            normal[a, b] = np.sqrt(rest) if a == b else rest / normal[b, b]
    for a in range(6):
        for c in range(a):
            right[a] -= normal[a, c] * right[c]
        right[a] /= normal[a, a]
    for a in range(5, -1, -1):
        for c in range(a + 1, 6):
            right[a] -= normal[c, a] * right[c]
        right[a] /= normal[a, a]
        wrench[a] = right[a]
