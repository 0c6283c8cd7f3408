"""A robot, its model, and a world with the drives enabled, driven without a bus."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from hal.drives.lifecycle import State, controlword_towards
from hal.joint import JointCommand, Mode
from hal.plant.scene import EMPTY, Scene
from hal.plant.world import World
from handrail.robot import library as robots
from handrail.robot.description import RobotDescription
from handrail.robot.kinematics import Kinematics


@pytest.fixture(scope="session")
def robot() -> RobotDescription:
    return robots.load("talos_upper")


@pytest.fixture(scope="session")
def kinematics(robot: RobotDescription) -> Kinematics:
    return Kinematics(robot)


class Host:
    """What a host does, as calls: joint impedance at 500 Hz with gravity from the host's own model."""

    def __init__(self, world: World, kinematics: Kinematics):
        self.world, self.kinematics = world, kinematics
        robot = world.description
        mass = kinematics.mass_matrix(world.position)
        inertia = np.sqrt(np.diag(mass) / np.diag(np.linalg.inv(mass)))
        self.command = JointCommand(len(robot.joints))
        self.command.mode[:] = Mode.IMPEDANCE
        self.command.stiffness[:] = robot.stiffness
        self.command.damping[:] = 2 * robot.damping_ratio * np.sqrt(robot.stiffness * inertia)
        self.command.position[:] = world.position

    def enable(self) -> None:
        """Take all drives to operation enabled, and hold until their brakes are open."""
        drives = self.world.drives
        while (drives.state != State.OPERATION_ENABLED).any():
            drives.control(controlword_towards(State.OPERATION_ENABLED, drives.state))
            self.world.step()
        while drives.brakes.any():
            self.cycle()
            assert not drives.error.any(), f"drives faulted: {drives.error}"

    def cycle(self, cycles: int = 1) -> None:
        for _ in range(cycles):
            self.command.torque[:] = self.kinematics.gravity(self.world.position)
            self.world.drives.command(self.command)
            self.world.advance(2)


@pytest.fixture
def host_of() -> type[Host]:
    return Host


@pytest.fixture
def make_host(robot: RobotDescription, kinematics: Kinematics) -> Iterator[Callable[[Scene], Host]]:
    worlds = []

    def make(scene: Scene = EMPTY) -> Host:
        worlds.append(World(robot, scene))
        return Host(worlds[-1], kinematics)

    yield make
    for world in worlds:
        world.close()


@pytest.fixture
def host(make_host: Callable[[], Host]) -> Host:
    return make_host()
