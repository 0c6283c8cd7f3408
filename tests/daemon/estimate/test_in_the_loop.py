"""The base in the real loop: TALOS on its own feet in the plant, in one process, frames between."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from daemon import exchange
from daemon.cli import _based
from daemon.warm_up import warm_up
from hal.drives.protocol import LimbProtocol
from hal.plant.direct_port import DirectPort
from hal.plant.world import World
from handrail.messages import Base
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics
from tests.daemon.loop.conftest import Bench

IMU_STATUS = 0x300


class DeafPort(DirectPort):
    """With frames that do not arrive."""

    def __init__(self, world: World):
        super().__init__(world)
        self.unheard: set[int] = set()

    def receive(self, timeout_s: float = 0.0) -> np.ndarray:
        records = super().receive(timeout_s)
        return records[~np.isin(records["can_id"], list(self.unheard))]


@pytest.fixture
def make() -> Iterator[Callable[..., Bench]]:
    made: list[tuple[Bench, Path]] = []

    def bench(kinematics: Kinematics, drives: object = None) -> Bench:
        robot, folder = kinematics.description, Path(tempfile.mkdtemp(prefix="hr", dir="/dev/shm"))
        warm_up(kinematics)
        made.append((Bench(folder, robot, kinematics, LimbProtocol(robot), drives), folder))
        return made[-1][0]

    yield bench
    for one, folder in made:
        one.loop.close()
        shutil.rmtree(folder)


def _base(bench: Bench, snapshot: np.ndarray) -> Base | None:
    return exchange.robot_state(snapshot, [foot.name for foot in bench.description.feet]).base


def test_a_standing_robots_states_have_its_base_and_contacts_until_its_imu_falls_silent(standing, make):
    world = World(standing.description)
    port = DeafPort(world)
    bench = make(standing, port)
    base = _base(bench, bench.run(100))
    assert base is not None
    truth = world.truth().base_in_world
    assert base.source == "feet"
    assert np.linalg.norm(np.subtract(base.pose_in_world.position, truth.position)) < 0.003
    assert abs(np.dot(base.pose_in_world.orientation, truth.orientation)) > 0.99999
    assert [(foot.name, foot.holds) for foot in base.feet] == [("right", True), ("left", True)]
    assert sum(foot.force[2] for foot in base.feet) == pytest.approx(911.0, abs=60.0)
    assert "by its feet" in "\n".join(_based(base))

    port.unheard.add(IMU_STATUS)
    snapshot = bench.run(15)
    base = _base(bench, snapshot)
    assert base is not None
    assert (base.source, base.problem) == ("none", "the inertial sensor does not answer")
    assert int(snapshot["time_ns"]) - 15 * bench.description.period_ns < base.since_ns <= int(snapshot["time_ns"])
    assert "nobody knows where the base is" in _based(base)[0]
    assert [foot.holds for foot in base.feet] == [True, True]
    port.unheard.clear()
    assert _base(bench, bench.run(15)).source == "feet"  # type: ignore[union-attr]


def test_a_robot_on_a_fixed_base_says_nothing_about_it(make):
    bench = make(Kinematics(robots.load("z1")))
    snapshot = bench.run(2)
    assert _base(bench, snapshot) is None
    told = exchange.base(snapshot)
    assert told.source == "fixed"
    assert (told.pose_in_world.position, told.pose_in_world.orientation) == ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    assert _based(told) == ["the base is fixed: its frame is the world's"]
