"""What something outside exerts on the robot: felt by its joints (a momentum observer), or by a force-torque sensor.

Sources: De Luca, Mattone: Sensorless robot collision detection and hybrid force/motion control, ICRA 2005; Haddadin, De Luca,
Albu-Schäffer: Robot collisions, a survey on detection, isolation, and identification, T-RO 33(6), 2017, §III-D.
"""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

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
        self.residual, self._first = np.zeros(kinematics.model.nv), np.zeros(kinematics.model.nv)
        self.data = kinematics.model.createData()
        """after `update`: pinocchio's velocities and accelerations (gravity's included) of the robot as it moves"""
        self._model, self._rows, self._joints = kinematics.model, kinematics.index_v, joints
        self._period = period
        self._gain = 1.0 - np.exp(-2.0 * np.pi * OBSERVER_HZ * period)
        self._velocity, self._acceleration = np.zeros(self._model.nv), np.zeros(self._model.nv)
        self._torque = np.zeros(len(joints))
        self._running = False

    def stop(self) -> None:
        """Forget what was: the next `update` is a first one."""
        self._running = False

    def update(self, q: Array, velocity: Array) -> None:
        """Once a cycle, at the model's configuration and velocity: the first time as if all were still."""
        gain, torque = self._gain, self._joints.torque
        if not self._running:
            self._running, gain = True, 1.0
            self._velocity[:], self._torque[:] = velocity, torque
        np.subtract(velocity, self._velocity, out=self._acceleration)
        self._acceleration /= self._period
        self._velocity[:] = velocity
        wanted = pin.rnea(self._model, self.data, q, velocity, self._acceleration)
        _follow(self.residual, self._first, gain, wanted, torque, self._torque, self._rows)


class WristSensor:
    """A force-torque sensor, freed of the weight and inertia of what is mounted on it."""

    def __init__(self, kinematics: Kinematics, link: str, row: int, devices: DeviceState):
        model = kinematics.model
        self._values, self._age, self._row = devices.values[row, :6], devices.age, row
        self.offset = np.zeros(6)
        """N, N·m that it tells when nothing is there, in its own axes: see daemon.state.taring"""
        self._reading = pin.Force.Zero()
        self._read_into = self._reading.vector
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

    def wrench(self, moved: pin.Data) -> pin.Force:
        """What something outside exerts on what is beyond the sensor, in the frame of the joint that carries it.

        `moved`: with each joint's velocity and acceleration, gravity's included (pinocchio's `v`, `a_gf`).
        """
        velocity, acceleration = moved.v[self._joint], moved.a_gf[self._joint]
        kept_moving = self.inertia * acceleration + self.inertia.vxiv(velocity)
        np.subtract(self._values, self.offset, out=self._read_into)
        return kept_moving + self._placement.act(self._reading)

    def excess(self, moved: pin.Data) -> Array:
        """(6,) N, N·m, its own axes: what it tells beyond weight and inertia of what it carries; see `wrench`."""
        felt: Array = self._placement.actInv(self.wrench(moved)).vector + self.offset
        return felt

    @property
    def joint(self) -> int:
        """pinocchio's joint that carries it."""
        return int(self._joint)


class ExternalWrenches:
    """Wrenches at frames, each as if its frame were the only one touched."""

    def __init__(self, kinematics: Kinematics, joints: JointState, period: float, devices: DeviceState | None = None):
        self.wrenches: dict[str, Array] = {}
        """frame → (6,) N, N·m about its origin, world axes: what something outside exerts there"""
        self._kinematics = kinematics
        self._observer = MomentumObserver(kinematics, joints, period)
        self._gain = 1.0 - np.exp(-2.0 * np.pi * SENSOR_HZ * period)
        self._squared_weight = 1.0 / kinematics.description.torque_limit**2
        self._rows = kinematics.index_v
        self.sensors = {
            row: WristSensor(kinematics, device.link, row, devices)
            for row, device in enumerate(kinematics.description.devices)
            if devices is not None and device.family == "force_torque"
        }
        """row of RobotDescription.devices → the sensor"""
        self._sensor_of: dict[str, WristSensor | None] = {}

    def update(self, frames: Collection[str], q: Array, velocity: Array, measured: Callable[[], pin.Data]) -> None:
        """Once a cycle, for these frames. `measured`: gives pinocchio's data with forward kinematics at `q`."""
        for old in [frame for frame in self.wrenches if frame not in frames]:
            del self.wrenches[old]
        if not frames:
            self._observer.stop()
            return
        self._observer.update(q, velocity)
        model = self._kinematics.model
        for frame in frames:
            sensor, number = self._sensor(frame), self._kinematics.frame_id(frame)
            gain = self._gain
            if frame not in self.wrenches:
                self.wrenches[frame], gain = np.zeros(6), 1.0
            wrench = self.wrenches[frame]
            if sensor is not None and sensor.fresh:
                data = measured()
                origin = pin.updateFramePlacement(model, data, number).translation
                felt = data.oMi[sensor.joint].act(sensor.wrench(self._observer.data))
                _follow_sensor(wrench, gain, felt.vector, origin)
            else:
                jacobian = pin.computeFrameJacobian(model, self._observer.data, q, number, pin.LOCAL_WORLD_ALIGNED)
                _least_squares(wrench, jacobian, self._observer.residual, self._rows, self._squared_weight)

    @property
    def moved(self) -> pin.Data:
        """As the observer saw the robot move in the last `update`; see WristSensor.wrench."""
        return self._observer.data

    def by_joints(self, frame: str, q: Array) -> Array:
        """(6,) N, N·m, world axes, at a frame, as the joints tell it; after `update`."""
        wrench = np.zeros(6)
        number = self._kinematics.frame_id(frame)
        jacobian = pin.computeFrameJacobian(self._kinematics.model, self.moved, q, number, pin.LOCAL_WORLD_ALIGNED)
        _least_squares(wrench, jacobian, self._observer.residual, self._rows, self._squared_weight)
        return wrench

    def _sensor(self, frame: str) -> WristSensor | None:
        if frame not in self._sensor_of:
            carrying = (sensor for sensor in self.sensors.values() if frame in sensor.frames)
            self._sensor_of[frame] = next(carrying, None)
        return self._sensor_of[frame]


@compiled
def _follow(residual, first, gain, wanted, torque, last, rows):  # type: ignore[no-untyped-def]
    """Move `first` by `gain` towards what the motion wanted beyond what the joints' springs gave in the mean, and `residual`
    towards `first`; `last` ← torque."""
    for i in range(rows.shape[0]):
        j = rows[i]
        first[j] += gain * (wanted[j] - 0.5 * (torque[i] + last[i]) - first[j])
        residual[j] += gain * (first[j] - residual[j])
        last[i] = torque[i]


@compiled
def _follow_sensor(wrench, gain, felt, origin):  # type: ignore[no-untyped-def]
    """Move `wrench` (6,) about `origin` (3,) by `gain` towards `felt` (6,), which is about the world's."""
    fx, fy, fz, x, y, z = felt[0], felt[1], felt[2], origin[0], origin[1], origin[2]
    wrench[0] += gain * (fx - wrench[0])
    wrench[1] += gain * (fy - wrench[1])
    wrench[2] += gain * (fz - wrench[2])
    wrench[3] += gain * (felt[3] - (y * fz - z * fy) - wrench[3])
    wrench[4] += gain * (felt[4] - (z * fx - x * fz) - wrench[4])
    wrench[5] += gain * (felt[5] - (x * fy - y * fx) - wrench[5])


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
