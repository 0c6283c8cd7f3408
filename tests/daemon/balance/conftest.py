"""TALOS on its own feet in the plant, under the real loop, in one process; the plant's truth judges it."""

from __future__ import annotations

import dataclasses
import math
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from daemon.serving.whole_body_door import WholeBodyDoor
from daemon.warm_up import warm_up
from hal.plant.bullet import pybullet as p
from hal.plant.robot_body import BASE
from hal.plant.scene import EMPTY
from handrail.robot import library as robots
from handrail.robot.description import RobotDescription
from handrail.robot.kinematics import Kinematics
from tests.daemon.whole_body.conftest import WholeBodyBench

PUSH_MS = 200


class Standing(WholeBodyBench):
    """A loop with TALOS in the plant, and what is really the case."""

    def __init__(self, folder: Path, description: RobotDescription, door: WholeBodyDoor):
        super().__init__(folder, description, EMPTY, door)
        body = self.world.robot
        self._feet = [body.frame(foot.link)[0] for foot in description.feet]

    def soles(self) -> np.ndarray:
        """(feet, 3) m, where the feet's links are in the world."""
        return np.array([self.world.robot.link_motion(foot)[1] for foot in self._feet])

    def com(self) -> np.ndarray:
        """(3,) m, the centre of mass in the world, of the plant's own bodies."""
        body = self.world.robot
        links = range(BASE, p.getNumJoints(body.number, physicsClientId=body.client))
        masses = [p.getDynamicsInfo(body.number, link, physicsClientId=body.client)[0] for link in links]
        return np.average([body.link_motion(link)[0] for link in links], axis=0, weights=masses)

    def base_off(self) -> float:
        """m between the estimated base and the real one."""
        true = self.world.truth().base_in_world.position
        return float(np.linalg.norm(self.loop.robot.base.pose[:3] - true))

    def tilt(self) -> float:
        """rad between the real base's z and up."""
        x, y, _, _ = self.world.truth().base_in_world.orientation
        return math.acos(1.0 - 2.0 * (x * x + y * y))

    def shove(self, force: tuple[float, float, float]) -> None:
        """Push the pelvis with so many N, world axes, for `PUSH_MS` from now on."""
        world, body = self.world, self.world.robot
        until = world.steps + PUSH_MS

        def act() -> None:
            if world.steps < until:
                at = body.base_motion()[0]
                p.applyExternalForce(body.number, BASE, force, at, p.WORLD_FRAME, physicsClientId=world.client)

        self.port.each_step[:] = [act]


@pytest.fixture(scope="session")
def robot() -> RobotDescription:
    return dataclasses.replace(robots.load("talos"), support="none")


@pytest.fixture
def standing(robot: RobotDescription) -> Iterator[Callable[..., Standing]]:
    made: list[tuple[Standing, Path]] = []
    door = WholeBodyDoor(robot)
    assert door.open(120.0)

    def make(support: Literal["hoist", "none"] = "none") -> Standing:
        warm_up(Kinematics(robot))
        folder = Path(tempfile.mkdtemp(prefix="hr", dir="/dev/shm"))
        made.append((Standing(folder, dataclasses.replace(robot, support=support), door), folder))
        made[-1][0].enable()
        return made[-1][0]

    yield make
    for bench, folder in made:
        bench.loop.close()
        shutil.rmtree(folder)
