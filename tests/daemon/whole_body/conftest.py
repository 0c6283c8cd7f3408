"""Compound tasks in the daemon's loop, on TALOS' upper body in the plant; everything in the test's own process."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon import exchange
from daemon.controllers.whole_body import WholeBodyControl
from daemon.exchange import Answer, Kind
from daemon.replay.tape import TapeWriter
from daemon.serving.whole_body_door import WholeBodyDoor
from hal.plant.scene import EMPTY, Scene
from handrail.messages import EndCondition, StartAction, StartBehaviour, Step, StreamPose, WholeBody
from handrail.robot import library as robots
from handrail.robot.description import RobotDescription
from tests.daemon.compliant.conftest import InPlant


class WholeBodyBench(InPlant):
    """Gives the loop what the server would: checked, prepared, started."""

    def __init__(
        self,
        folder: Path,
        description: RobotDescription,
        scene: Scene,
        door: WholeBodyDoor,
        tape: TapeWriter | None = None,
    ):
        super().__init__(folder, description, scene, tape)
        self.door = door
        self.started = 0

    def begin(self, motion: WholeBody, ends: tuple[EndCondition, ...] = ()) -> Answer:
        """Check, prepare and start a motion; in lock-step the start waits until it is prepared."""
        call = StartAction(id="a", owner="o", motion=motion, ends=list(ends))
        prepared = self.prepare(motion, ends)
        self.started = self._count()
        self._mailbox.post(*exchange.encode_start(call, self.started, 1, self._joints, self._frames, prepared))
        return Answer(int(self.run()["answer"]))

    def prepare(self, motion: WholeBody, ends: Sequence[EndCondition]) -> int:
        """Check a motion, and have its controller made; under which serial."""
        checked = self.door.checked(motion, ends, self.loop.robot.joints.position, 1 << 18)
        prepared = self._count()
        self._mailbox.post(*exchange.encode_prepare(checked, prepared))
        self.run()
        return prepared

    def begin_behaviour(self, *steps: Step, **fields: Any) -> Answer:
        """Likewise of a behaviour's whole-body steps; those that are the same motion share a controller."""
        serials: dict[int, int] = {}
        for row, step in enumerate(steps):
            if isinstance(step.motion, WholeBody):
                same = [known for known in serials if steps[known].motion == step.motion]
                serials[row] = serials[same[0]] if same else self.prepare(step.motion, step.ends)
        call = StartBehaviour(id="a", owner="o", steps=list(steps), **fields)
        self.started = self._count()
        meant = (self._joints, self._frames, self._devices, {}, serials)
        self._mailbox.post(*exchange.encode_behaviour(call, self.started, 1, *meant))
        return Answer(int(self.run()["answer"]))

    def stream(self, task: str, **pose: tuple[float, ...]) -> None:
        """Put a streamed reference into the mailbox."""
        message = StreamPose(id="a", task=task, **pose)  # type: ignore[arg-type]
        self._mailbox.post(*exchange.encode_stream(message, self._count(), self.started))

    @property
    def control(self) -> WholeBodyControl:
        """The controller that runs."""
        return next(c for c in self.loop.manager.active if isinstance(c, WholeBodyControl))

    def torque(self) -> np.ndarray:
        """N·m (n,) that the drives make of what was written last, at the state that it was written for."""
        written, state = self.loop.written, self.loop.robot.joints
        spring = written.stiffness * (written.position - state.position)
        return written.torque + spring + written.damping * (written.velocity - state.velocity)

    def cancel(self) -> Answer:
        return self.ask(Kind.CANCEL, action=self.started)

    def _count(self) -> int:
        self._serial += 1
        return self._serial


@pytest.fixture(scope="session")
def talos() -> RobotDescription:
    return robots.load("talos_upper")


@pytest.fixture(scope="session")
def door(talos: RobotDescription) -> WholeBodyDoor:
    made = WholeBodyDoor(talos)
    assert made.open(120.0)
    return made


@pytest.fixture
def in_plant(talos: RobotDescription, door: WholeBodyDoor) -> Iterator[Callable[..., WholeBodyBench]]:
    made: list[tuple[WholeBodyBench, Path]] = []

    def make(scene: Scene = EMPTY, tape: bool = False, robot: RobotDescription = talos) -> WholeBodyBench:
        folder = Path(tempfile.mkdtemp(prefix="hr", dir="/dev/shm"))
        written = TapeWriter(folder / "loop.tape") if tape else None
        made.append((WholeBodyBench(folder, robot, scene, door, written), folder))
        made[-1][0].enable()
        return made[-1][0]

    yield make
    for bench, folder in made:
        bench.loop.close()
        shutil.rmtree(folder)
