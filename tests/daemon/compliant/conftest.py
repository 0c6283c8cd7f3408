"""The real loop on TALOS' upper body in the plant, in one process: drives with firmware, sensors with noise, no bus between."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from daemon.exchange import ActionState, Outcome
from daemon.replay.tape import TapeWriter
from daemon.warm_up import warm_up
from hal.drives.protocol import LimbProtocol
from hal.plant.bullet import pybullet as p
from hal.plant.direct_port import DirectPort
from hal.plant.scene import EMPTY, Box, Scene
from hal.plant.world import World
from handrail.messages import Pose
from handrail.robot import library as robots
from handrail.robot.description import RobotDescription
from handrail.robot.kinematics import Kinematics
from tests.daemon.loop.conftest import Bench

TIP = "tool_right_tip"
END = 0.03
"""m from the tip to the stub's end"""
Vector = tuple[float, float, float]


class PlantPort(DirectPort):
    """With something that acts on the world before each of its steps."""

    def __init__(self, world: World):
        super().__init__(world)
        self.each_step: list[Callable[[], None]] = []

    def advance(self, steps: int) -> None:
        for left in range(steps, 0, -1):
            for act in self.each_step:
                act()
            self.world.step(felt=left == 1)


class InPlant(Bench):
    """A loop, and a world that is asked for the truth."""

    def __init__(
        self, folder: Path, description: RobotDescription, scene: Scene = EMPTY, tape: TapeWriter | None = None
    ):
        kinematics = Kinematics(description)
        self.world = World(description, scene)
        self.port = PlantPort(self.world)
        super().__init__(folder, description, kinematics, LimbProtocol(description), self.port, tape)
        self.kinematics = kinematics

    def enable(self) -> None:
        super().enable()
        self.run(60)  # the brakes open

    def tip(self) -> pin.SE3:
        """Where the tool's tip really is."""
        return self.kinematics.frame(self.world.position, TIP)

    def push(self, force: Vector, link: str = "tool_right") -> None:
        """Push a link with so many N, world axes, at its tip from now on."""
        body = self.world.robot

        def act() -> None:
            carrier = body.frame(link)[0]
            point = self.tip().translation
            p.applyExternalForce(
                body.number, carrier, force, point.tolist(), p.WORLD_FRAME, physicsClientId=self.world.client
            )

        self.port.each_step[:] = [act]

    def force_on(self, thing: str) -> np.ndarray:
        """N (3,), world axes, that the robot really exerts on an object now."""
        return sum((force for _, force in self._contacts(thing)), np.zeros(3))

    def moment_on(self, thing: str, about: np.ndarray) -> np.ndarray:
        """N·m (3,), world axes, likewise about a point."""
        return sum((np.cross(point - about, force) for point, force in self._contacts(thing)), np.zeros(3))

    def _contacts(self, thing: str) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Where the robot touches an object, m, and the force on it there, N."""
        body = self.world.body(thing)
        for contact in p.getContactPoints(self.world.robot.number, body, physicsClientId=self.world.client):
            # The normal is on the other body and points at the robot; friction acts along two directions.
            friction = contact[10] * np.array(contact[11]) + contact[12] * np.array(contact[13])
            yield np.array(contact[6]), -contact[9] * np.array(contact[7]) - friction

    def run_to_end(self, slot: int = 0, cycles: int = 4000, each: Callable[[], None] = lambda: None) -> Outcome:
        for _ in range(cycles):
            state, outcome = self.action(slot)
            if state is ActionState.ENDED:
                return outcome
            self.run(1, each)
        raise AssertionError("the action did not end")


def wall_before(tip: pin.SE3, gap: float, friction: float = 0.6) -> Scene:
    """A wall across the stub's direction, `gap` m before its end."""
    out = pin.SE3(tip.rotation, tip.act(np.array([0.0, 0.0, -END - gap - 0.05])))
    quaternion = pin.Quaternion(out.rotation)
    place = Pose(
        position=tuple(out.translation.tolist()), orientation=(quaternion.x, quaternion.y, quaternion.z, quaternion.w)
    )
    return Scene(
        EMPTY.file, {"wall": Box(pose_in_world=None, size=(0.6, 0.6, 0.1), friction=friction)}, {"wall": place}
    )


@pytest.fixture(scope="session")
def talos() -> RobotDescription:
    return robots.load("talos_upper")


@pytest.fixture(scope="session")
def ready(talos: RobotDescription) -> pin.SE3:
    """The tip at home."""
    kinematics = Kinematics(talos)
    warm_up(kinematics)
    return kinematics.frame(talos.home_position(), TIP)


@pytest.fixture
def in_plant(talos: RobotDescription) -> Iterator[Callable[..., InPlant]]:
    made: list[tuple[InPlant, Path]] = []

    def make(scene: Scene = EMPTY, description: RobotDescription = talos) -> InPlant:
        folder = Path(tempfile.mkdtemp(prefix="hr", dir="/dev/shm"))
        made.append((InPlant(folder, description, scene), folder))
        made[-1][0].enable()
        return made[-1][0]

    yield make
    for bench, folder in made:
        bench.loop.close()
        shutil.rmtree(folder)
