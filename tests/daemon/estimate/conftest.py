"""What TALOS' joints and devices tell while it lands on its feet, stands and is pushed, with the plant's truth beside it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest

from daemon.controllers.gains import joint_damping
from daemon.state.estimator import BaseEstimator, BaseState
from hal.device import DeviceState
from hal.drives.lifecycle import State, controlword_towards, statusword
from hal.joint import JointCommand, JointState, Mode
from hal.plant.bullet import pybullet as p
from hal.plant.robot_body import BASE
from hal.plant.world import World
from handrail.robot import library as robots
from handrail.robot.description import RobotDescription
from handrail.robot.kinematics import Kinematics

PERIOD_MS = 2
PUSHED_MS, PUSH = (300, 400), (60.0, 150.0, 0.0)
"""N, world axes, on the pelvis, while it stands on its brakes: one foot leaves the floor, then the other"""
ENABLED_MS, LIFTED_MS, LIFT_MS, LIFT = 700, 1300, 200, {3: -0.75, 4: 1.5, 5: -0.75}
"""It stands by its drives from the one on, and draws its left leg up at the other: rad, by the number in the joint's name"""
SECONDS = 1.66


@dataclass
class Tape:
    """One row a cycle."""

    time_ns: list[int] = field(default_factory=list)
    joints: list[np.ndarray] = field(default_factory=list)
    """hal.joint.JointState.memory"""
    devices: list[np.ndarray] = field(default_factory=list)
    """hal.device.DeviceState.values"""
    position: list[np.ndarray] = field(default_factory=list)
    orientation: list[np.ndarray] = field(default_factory=list)
    """the truth of the base: m, quaternion x y z w"""
    twist: list[np.ndarray] = field(default_factory=list)
    """m/s of the base's origin, rad/s, base's axes"""
    force: list[np.ndarray] = field(default_factory=list)
    """N, normal force between each foot and the floor, really"""


def _record(robot: RobotDescription) -> Tape:
    world, tape, joints = World(robot), Tape(), JointState(len(robot.joints))
    body, drives, command = world.robot, world.drives, JointCommand(len(robot.joints))
    command.position[:], command.stiffness[:] = robot.home_position(), robot.stiffness
    command.damping[:], command.mode[:] = joint_damping(Kinematics(robot), robot.home_position()), Mode.IMPEDANCE
    feet = [body.frame(foot.link)[0] for foot in robot.feet]
    for ms in range(round(SECONDS * 1000)):
        if PUSHED_MS[0] <= ms < PUSHED_MS[1]:
            at = body.base_motion()[0]
            p.applyExternalForce(body.number, BASE, PUSH, at, p.WORLD_FRAME, physicsClientId=world.client)
        last = ms % PERIOD_MS == PERIOD_MS - 1
        for number, angle in LIFT.items():
            row, share = robot.index(f"leg_left_{number}_joint"), (ms - LIFTED_MS) / LIFT_MS
            command.position[row] += (angle - robot.home_position()[row]) / LIFT_MS if 0.0 <= share < 1.0 else 0.0
        if ms >= ENABLED_MS:
            drives.control(controlword_towards(State.OPERATION_ENABLED, drives.state))
            drives.command(command)
        world.step(felt=last)
        if not last:
            continue
        joints.position[:], joints.velocity[:] = world.position, world.velocity
        joints.torque[:], joints.status[:] = drives.actuators.measured_torque, statusword(drives.state)
        tape.joints.append(joints.memory.copy())
        tape.devices.append(world.devices.measure().values.copy())
        tape.time_ns.append(world.time_ns)
        centre, position, orientation, linear, angular = (np.array(part) for part in body.link_motion(BASE))
        turned = np.array(p.getMatrixFromQuaternion(orientation.tolist())).reshape(3, 3)
        moving = linear + np.cross(angular, position - centre)
        tape.position.append(position)
        tape.orientation.append(orientation)
        tape.twist.append(np.concatenate((moving @ turned, angular @ turned)))
        contacts = p.getContactPoints(body.number, world.floor, physicsClientId=world.client)
        tape.force.append(np.array([sum(c[9] for c in contacts if c[3] == foot) for foot in feet]))
    world.close()
    return tape


class Run:
    """An estimator that is played a tape."""

    def __init__(self, kinematics: Kinematics, tape: Tape):
        robot = kinematics.description
        self.tape, self.joints, self.devices = tape, JointState(len(robot.joints)), DeviceState(len(robot.devices))
        self.row = {device.name: row for row, device in enumerate(robot.devices)}
        self.estimator = BaseEstimator(kinematics, self.joints, self.devices, robot.period_ns * 1e-9)
        self.state = self.estimator.state
        self.memory: list[np.ndarray] = []
        """of each cycle's state"""

    def play(self, first: int = 0, end: int | None = None, spoil: Callable[[], None] = lambda: None) -> Run:
        """Cycles [first, end) of the tape; `spoil` changes what was measured before the estimator looks."""
        for cycle in range(first, len(self.tape.time_ns) if end is None else end):
            self.joints.memory[...], self.devices.values[...] = self.tape.joints[cycle], self.tape.devices[cycle]
            self.joints.age[:] = self.devices.age[:] = 0
            spoil()
            self.estimator.update(self.tape.time_ns[cycle])
            self.memory.append(self.state.memory.copy())
        return self

    def states(self) -> list[BaseState]:
        """Each cycle's."""
        told = []
        for memory in self.memory:
            state = BaseState(len(self.state.contact))
            state.memory[:] = memory
            told.append(state)
        return told


@pytest.fixture(scope="session")
def standing() -> Kinematics:
    """TALOS on its own feet."""
    return Kinematics(dataclasses.replace(robots.load("talos"), support="none"))


@pytest.fixture(scope="session")
def tape(standing: Kinematics) -> Tape:
    return _record(standing.description)


@pytest.fixture
def run(standing: Kinematics, tape: Tape) -> Run:
    return Run(standing, tape)


@pytest.fixture(scope="session")
def played(standing: Kinematics, tape: Tape) -> Run:
    """All of the tape, as it is."""
    return Run(standing, tape).play()
