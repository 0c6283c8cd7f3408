"""A robot whose base is free, recorded as it stands, is pushed and is disabled, and replayed: what is known of its base, too."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from daemon.exchange import Kind
from daemon.replay.player import Replay
from daemon.replay.recorded_loop import cycles
from daemon.replay.tape import TapeReader, TapeWriter
from daemon.warm_up import warm_up
from hal.drives.protocol import LimbProtocol
from hal.plant.bullet import pybullet as p
from hal.plant.direct_port import DirectPort
from hal.plant.robot_body import BASE
from hal.plant.world import World
from handrail.robot.kinematics import Kinematics
from tests.daemon.estimate.conftest import PUSH
from tests.daemon.loop.conftest import Bench

WORDS = 1 << 22


@pytest.fixture
def folder() -> Iterator[Path]:
    made = Path(tempfile.mkdtemp(prefix="hr", dir="/dev/shm"))
    yield made
    shutil.rmtree(made)


def test_a_standing_robots_loop_is_replayed_bit_for_bit_with_all_that_it_knew_of_its_base(
    standing: Kinematics, folder: Path
) -> None:
    robot, (there, again) = standing.description, (folder / "then", folder / "now")
    there.mkdir()
    again.mkdir()
    warm_up(standing)
    world, tape = World(robot), TapeWriter(there / "loop.tape", WORDS)
    bench = Bench(there, robot, standing, LimbProtocol(robot), DirectPort(world), tape)
    known: list[bytes] = []

    def keep() -> None:
        known.append(bench.loop.robot.base.memory.tobytes())

    def push() -> None:
        body = world.robot
        at = body.base_motion()[0]
        p.applyExternalForce(body.number, BASE, PUSH, at, p.WORLD_FRAME, physicsClientId=world.client)
        keep()

    bench.run(50, keep)
    bench.post(Kind.ENABLE)
    for _ in range(200):
        bench.run(1, keep)
        if bench.loop.life.enabled:
            break
    assert bench.loop.life.enabled
    bench.run(60, push)
    bench.run(60, keep)
    assert len(set(known[-60:])) > 50, "the base moves"
    bench.post(Kind.DISABLE)
    bench.run(20, keep)
    bench.loop.close()

    reader = TapeReader(there / "loop.tape")
    assert reader.attach()
    _, *entries = reader.read()
    recorded = list(cycles(entries))
    replay = Replay(Kinematics(robot), True, again)
    try:
        found = []
        for cycle in recorded:
            assert (difference := replay.run([cycle])) is None, difference
            found.append(replay.loop.robot.base.memory.tobytes())
    finally:
        replay.close()
    assert len(found) == len(known)
    assert found == known
