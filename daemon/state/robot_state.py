"""What the loop knows of the robot in one cycle: measured joints, the model at them, and the model at what was commanded."""

from __future__ import annotations

import copy
from collections.abc import Collection
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from daemon.state.base_state import BaseSource, BaseState, Trouble
from daemon.state.carried import CarriedFrame
from daemon.state.estimator import BaseEstimator, can_estimate
from daemon.state.invariant_filter import GRAVITY
from daemon.state.observer import ExternalWrenches
from daemon.state.stance import Stance
from daemon.state.weight import Weight
from daemon.wbc.memory import Memory
from hal.device import DeviceState
from hal.joint import JointCommand, JointState
from handrail.robot.kinematics import Kinematics

Array = NDArray[np.float64]


class FramePose(NamedTuple):
    """A frame in the world."""

    rotation: Array
    """(3, 3)"""
    translation: Array
    """(3,) m"""


class Hand(NamedTuple):
    """A gripper as its drive told last."""

    position: float
    """rad or m"""
    holds: bool
    """it stands still at its effort limit, short of where it was sent"""
    age: int
    """cycles since it told"""


class RobotState:
    """The robot as measured (`joints`) and as commanded, with pinocchio's answers about both.

    Gravity and forward kinematics are computed when somebody asks for them, once a cycle. Arrays have one row a joint in the
    description's order, frames are seen from the base (`base_link`), which on a fixed one is the world. Where it is not fixed,
    gravity is turned as the base is estimated to be, and what the feet bear is no joint's to carry.
    """

    def __init__(self, kinematics: Kinematics, joints: JointState, period: float, devices: DeviceState | None = None):
        """`devices`: what the robot's sensors tell; None: nothing."""
        if kinematics.description.base == "free":  # whose model's gravity turns with its base
            kinematics = copy.copy(kinematics)
            kinematics.model = kinematics.model.copy()
        self.kinematics = kinematics
        self.joints = joints
        self.period = period
        self._devices = devices
        self._grippers = {
            device.name: row
            for row, device in enumerate(kinematics.description.devices)
            if device.family == "gripper" and devices is not None
        }
        self._gravity = np.zeros(len(joints))
        self._outside = ExternalWrenches(kinematics, joints, period, devices)
        self.sensors = self._outside.sensors
        """row of RobotDescription.devices → force-torque sensor"""
        self.wrenches = self._outside.wrenches
        """frame → (6,) N, N·m about its origin, world axes: what something outside exerts there; see `estimate_forces`"""
        self._estimator: BaseEstimator | None = None
        self.stance: Stance | None = None
        """how it stands, as of the last `estimate_base`; None: its base is fixed, or nobody can tell where it is"""
        self.base = BaseState()
        """where the base is in the world, as of the last `estimate_base`"""
        if devices is not None and can_estimate(kinematics.description):
            self._estimator = BaseEstimator(kinematics, joints, devices, period)
            self.base = self._estimator.state
            self.stance = Stance(kinematics, self.base, period)
        elif kinematics.description.base == "free":
            self.base.source[0], self.base.trouble[0] = BaseSource.NONE, Trouble.NO_SENSORS
        self._model = kinematics.model
        self._measured, self._commanded = self._model.createData(), self._model.createData()
        self._rows, self._weight = kinematics.index_v, Weight(self._model, kinematics.index_v)
        self._q, self._v = np.zeros(self._model.nq), np.zeros(self._model.nv)
        self._q_command, self._v_command = np.zeros(self._model.nq), np.zeros(self._model.nv)
        self._last = JointCommand(len(joints))
        self._measured_fresh = self._commanded_fresh = self._gravity_fresh = False
        self._carried: dict[str, CarriedFrame] = {}
        self._followed: set[str] = set()
        """those of them that were looked at in this cycle"""

    def update(self, last: JointCommand) -> None:
        """Take the joints as measured now into the model. `last`: what was commanded in the cycle before, and frames then tell."""
        self._last = last
        self._q[self._rows] = self.joints.position
        self._v[self._rows] = self.joints.velocity
        self._measured_fresh = self._commanded_fresh = self._gravity_fresh = False
        self._followed.clear()

    @property
    def gravity(self) -> Array:
        """N·m (n,), at the measured position; the next cycle overwrites it."""
        if not self._gravity_fresh:
            self._weight.carry(self._q, self._gravity)
            if self.stance is not None and self.base.source[0] == BaseSource.FEET:
                self.stance.relieve(self._gravity)
            self._gravity_fresh = True
        return self._gravity

    def estimate_base(self, time_ns: int) -> None:
        """Update `base`, where it is not fixed. time_ns: the robot's clock."""
        if self._estimator is None:
            return
        self._estimator.update(time_ns)
        if self.stance is not None and self.base.source[0] != BaseSource.NONE:
            x, y, z, w = self.base.pose[3:].tolist()
            down = np.array([2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)])
            self._model.gravity.linear = -GRAVITY * down
            self.stance.update(self._q, self._v)

    def frame(self, name: str) -> FramePose:
        """A frame where it is measured to be."""
        pose = pin.updateFramePlacement(self._model, self._measured_pass(), self.kinematics.frame_id(name))
        return FramePose(pose.rotation.copy(), pose.translation.copy())

    def commanded_frame(self, name: str) -> FramePose:
        """A frame where the joints are commanded to bring it."""
        pose = pin.updateFramePlacement(self._model, self._commanded_pass(), self.kinematics.frame_id(name))
        return FramePose(pose.rotation.copy(), pose.translation.copy())

    def hand(self, name: str) -> Hand | None:
        """A gripper as measured; None where there is none of that name."""
        row = self._grippers.get(name)
        if self._devices is None or row is None:
            return None
        position, holding = self._devices.values[row, [0, 5]].tolist()
        return Hand(position, holding > 0.5, int(self._devices.age[row]))

    def carried(self, name: str) -> CarriedFrame:
        """A frame as it is commanded and as it is measured to be; the next cycle overwrites it."""
        if name in self._followed:
            return self._carried[name]
        if (carried := self._carried.get(name)) is None:
            carried = CarriedFrame(self._model, self._rows, self.kinematics.frame_id(name))
            self._carried[name] = carried
        carried.follow(self._last.table, self.joints.table)
        self._followed.add(name)
        return carried

    def lag(self, name: str) -> Array:
        """(3,) m: a frame's commanded minus its measured position."""
        return self.carried(name).lag

    def jacobian(self, name: str) -> Array:
        """(6, n): linear and angular velocity of a frame's origin, world axes, per joint velocity, where it is measured."""
        return self._model_jacobian(name)[:, self._rows]

    def estimate_forces(self, frames: Collection[str]) -> None:
        """Update `wrenches`: for each of `frames`, what something outside exerts there.

        A force-torque sensor that carries the frame tells it, freed of the weight and inertia of what it carries, and of its
        offset where it was tared. Otherwise the joints do: weighted, damped least squares of Jᵀ F = r with the momentum
        observer's r (daemon.state.observer). Then a force elsewhere on the arm is taken for one at the frame, an error of the
        model's mass and friction in the joints count fully, and along directions that the joints hardly move the estimate is
        pulled to zero by the damping.
        """
        if frames or self.wrenches:
            self._outside.update(frames, self._q, self._v)

    @property
    def moved(self) -> Memory:
        """Velocities and accelerations of the model's bodies, as of the last `estimate_forces`: see WristSensor.excess."""
        return self._outside.moved

    def felt_by_joints(self, frame: str) -> Array:
        """(6,) N, N·m as `wrenches`, but by the joints alone, whatever sensor there is; after `estimate_forces` of some frame."""
        return self._outside.by_joints(frame, self._q)

    def _measured_pass(self) -> pin.Data:
        """Forward kinematics at the measured joints."""
        if not self._measured_fresh:
            pin.forwardKinematics(self._model, self._measured, self._q, self._v)
            self._measured_fresh = True
        return self._measured

    def _commanded_pass(self) -> pin.Data:
        """Forward kinematics at the commanded joints."""
        if not self._commanded_fresh:
            self._q_command[self._rows] = self._last.position
            self._v_command[self._rows] = self._last.velocity
            pin.forwardKinematics(self._model, self._commanded, self._q_command, self._v_command)
            self._commanded_fresh = True
        return self._commanded

    def _model_jacobian(self, name: str) -> Array:
        frame = self.kinematics.frame_id(name)
        return pin.computeFrameJacobian(self._model, self._measured, self._q, frame, pin.LOCAL_WORLD_ALIGNED)
