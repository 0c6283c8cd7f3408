"""The guard on TALOS in the plant: what is really the case between its bodies, by the meshes' own hulls and by PyBullet."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest

from daemon.exchange import ActionState, Answer, Outcome, Rule
from hal.plant.bullet import pybullet as p
from handrail.messages import JointTrajectory
from handrail.robot import library as robots
from handrail.robot.guarding import Guarding
from handrail.robot.kinematics import Kinematics
from tests.daemon.compliant.conftest import InPlant

HAND = [f"arm_left_{number}_link" for number in (5, 6, 7)] + ["wrist_left_ft_tool_link", "tool_left"]
OTHER_HAND = [link.replace("left", "right") for link in HAND]


class Truth:
    """Distances between the hulls of the URDF's collision meshes at the plant's true joints."""

    def __init__(self, kinematics: Kinematics, one: list[str], other: list[str]):
        self._kinematics = kinematics
        model = kinematics.model
        self._geometry = pin.buildGeomFromUrdf(model, str(kinematics.description.urdf), pin.COLLISION)
        links = []
        for body in self._geometry.geometryObjects:
            if isinstance(body.geometry, coal.BVHModelBase):
                body.geometry.buildConvexHull(True, "Qt")
                body.geometry = body.geometry.convex
            links.append(model.frames[body.parentFrame].name)
        for a, first in enumerate(links):
            for b, second in enumerate(links):
                if first in one and second in other:
                    self._geometry.addCollisionPair(pin.CollisionPair(a, b))
        self._data = self._geometry.createData()

    def distance(self, position: np.ndarray) -> float:
        q = self._kinematics.configuration(position)
        pin.computeDistances(self._kinematics.model, self._kinematics.data, self._geometry, self._data, q)
        return min(result.min_distance for result in self._data.distanceResults)


Make = Callable[[bool], InPlant]


@pytest.fixture
def in_plant() -> Iterator[Make]:
    made: list[tuple[InPlant, Path]] = []

    def make(guarded: bool) -> InPlant:
        folder = Path(tempfile.mkdtemp(prefix="hr"))
        description = replace(robots.load("talos_upper"), guard=Guarding(self_collision=guarded))
        made.append((InPlant(folder, description), folder))
        return made[-1][0]

    yield make
    for bench, folder in made:
        bench.loop.close()
        bench.world.close()
        shutil.rmtree(folder)


def rush(bench: InPlant, goal: dict[str, float], share: float, duration: float = 0.0) -> JointTrajectory:
    """Straight to a posture, the fastest joint at a `share` of its speed limit, or in `duration` s."""
    rows = bench.description.index(list(goal))
    start = bench.loop.written.position[rows].copy()
    way = np.array(list(goal.values())) - start
    duration = duration or float(np.max(np.abs(way) / bench.description.velocity_limit[rows])) * 1.1 / share
    u, ramp = np.linspace(0.0, 1.0, 41), 1.0 / 11.0
    # A trapezium of speed, the plateau at 1.1 times the mean.
    done = np.where(
        u < ramp, 0.55 * u**2 / ramp, np.where(u > 1 - ramp, 1 - 0.55 * (1 - u) ** 2 / ramp, 1.1 * u - 0.05)
    )
    speed = np.clip(np.minimum(u, 1 - u) / ramp, 0.0, 1.0) * 1.1 / duration
    return JointTrajectory(
        joints=list(goal),
        times=(u * duration).tolist(),
        positions=(start + done[:, None] * way).tolist(),
        velocities=(speed[:, None] * way).tolist(),
    )


# Both tools to places in front of the chest, each a little beyond where the other one comes to.
LEFT = {f"arm_left_{number}_joint": angle for number, angle in enumerate((-1.0, 0.37, 0.03, -1.76, 0.0), 1)}
RIGHT = {f"arm_right_{number}_joint": angle for number, angle in enumerate((1.15, -0.78, 0.2, -1.54, -0.07), 1)}
INTO_CHEST = {f"arm_left_{number}_joint": angle for number, angle in enumerate((-1.27, 0.43, -0.85, -1.9), 1)}


def meet(bench: InPlant, share: float) -> None:
    slower = max((rush(bench, goal, share) for goal in (LEFT, RIGHT)), key=lambda motion: motion.times[-1]).times[-1]
    assert bench.start(rush(bench, LEFT, share, slower)) is Answer.ACCEPTED
    assert bench.start(rush(bench, RIGHT, share, slower)) is Answer.ACCEPTED


def between_arms(bench: InPlant) -> float:
    """m between forearms, wrists and tools as PyBullet has them, no more than 1."""
    links, number, client = bench.world.robot.joints, bench.world.robot.number, bench.world.client
    ours, theirs = ([links[f"arm_{side}_{joint}_joint"] for joint in (5, 6, 7)] for side in ("left", "right"))
    found = [
        point[8]
        for one in ours
        for other in theirs
        for point in p.getClosestPoints(number, number, 1.0, one, other, physicsClientId=client)
    ]
    return min(found, default=1.0)


def watched(bench: InPlant, look: Callable[[], float], cycles: int) -> list[float]:
    """What is seen in every eighth cycle; most of the way is slow, or has ended."""
    seen = []
    for _ in range(cycles // 8):
        bench.run(8)
        seen.append(look())
    return seen


@pytest.mark.parametrize("share", [1.0, 0.5])
def test_two_arms_that_rush_into_each_other_never_touch(in_plant: Make, share: float) -> None:
    bench = in_plant(True)
    bench.enable()
    meet(bench, share)
    hulls = Truth(bench.kinematics, HAND, OTHER_HAND)
    seen = watched(bench, lambda: min(hulls.distance(bench.world.position), between_arms(bench)), round(500 / share))
    assert {bench.action(slot) for slot in (0, 1)} == {(ActionState.ENDED, Outcome.TOO_CLOSE)}
    assert bench.snapshot()["safety"][Rule.SELF_COLLISION]["holds"]
    assert np.abs(bench.world.velocity).max() < 0.02, "they stand"
    assert 0.0 < min(seen) < 0.1, "nearer than by the largest inertia that there is: 16 cm"


def test_without_the_guard_the_same_arms_meet(in_plant: Make) -> None:
    bench = in_plant(False)
    bench.enable()
    meet(bench, 1.0)
    seen = watched(bench, lambda: between_arms(bench), 450)
    assert min(seen) < 0.0


@pytest.mark.parametrize("guarded", [True, False])
def test_a_hand_that_is_sent_into_the_chest_stops_before_it(in_plant: Make, guarded: bool) -> None:
    bench = in_plant(guarded)
    bench.enable()
    assert bench.start(rush(bench, INTO_CHEST, 1.0)) is Answer.ACCEPTED
    hulls = Truth(bench.kinematics, HAND, ["torso_1_link", "torso_2_link", "base_link"])
    seen = watched(bench, lambda: hulls.distance(bench.world.position), 350)
    assert (min(seen) > 0.0) is guarded, "and without the guard it goes in: the plant's chest has no shape"
    assert bench.action()[1] is (Outcome.TOO_CLOSE if guarded else Outcome.DONE)
