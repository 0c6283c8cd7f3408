"""A loop on drives of a simple joint model, in one process: no bus, no plant, every cycle called by the test."""

from __future__ import annotations

import copy
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from daemon import exchange
from daemon.controllers.roster import Roster, read_roster, roster_file
from daemon.exchange import LOADED_CODE, ActionState, Answer, ControllerState, Flag, Kind, Outcome
from daemon.exchange.doorbell import Bell, loop_doorbell
from daemon.exchange.mailbox import MailboxWriter
from daemon.exchange.ring import StateRingReader
from daemon.loop import Loop
from daemon.replay.recorded_loop import LoopStart
from daemon.replay.tape import TapeWriter
from daemon.replay.taping import TapedLoop, TapedPort
from daemon.serving.validation import check_gripper
from hal.can import frames
from hal.drives import lifecycle
from hal.drives.lifecycle import State
from hal.drives.parameters import Parameter, ParameterResult
from hal.drives.protocol import DriveTargets, LimbProtocol
from hal.hardware import Hardware
from hal.joint import JointCommand, JointState
from handrail.messages import (
    CommandGripper,
    EndCondition,
    JointTrajectory,
    LoadController,
    Motion,
    StartAction,
    StartBehaviour,
    Step,
)
from handrail.robot import library as robots
from handrail.robot.description import RobotDescription
from handrail.robot.kinematics import Kinematics
from handrail.runtime import Runtime

PATIENCE_S = 60.0
TAPE_WORDS = 1 << 21
SWAY = """
import numpy as np
from daemon.controllers.base import Controller

class Sway(Controller):
    def activate(self, robot, last):
        self.start, self.phase = last.position[self.joints].copy(), 0.0

    def update(self, robot, out):
        self.phase += 2 * np.pi * robot.period
        velocity = np.full(len(self.joints), 0.2 * np.pi * np.sin(self.phase))
        self.write_impedance(robot, out, self.start + 0.1 * (1 - np.cos(self.phase)), velocity)
"""
"""A user's controller: swings its joints by 0.2 rad and back, once a second."""


class JointDrives:
    """A port with drives behind it: CiA 402, impedance law, and a free joint with gravity for each.

    They see what a bus would carry (frames, quantised set-points) and step one period at Sync.
    """

    def __init__(self, description: RobotDescription, kinematics: Kinematics, protocol: LimbProtocol):
        n = len(description.joints)
        self.counters = np.zeros((len(description.channels), 3), np.int64)
        self.refused = self.lost = 0
        self.state, self.targets = JointState(n), DriveTargets(n, len(description.devices))
        self.state.position[:] = description.home_position()
        self.life = np.full(n, State.SWITCH_ON_DISABLED, np.uint8)
        self.silent = np.zeros(n, bool)
        self.protocol_version, self.mute = protocol.protocol_version.astype(float), np.zeros(n, bool)
        """what each drive says when it is asked; drives that do not answer parameter requests"""
        self.external_torque = np.zeros(n)
        self.saturate = True
        self.seen: list[JointCommand] = []
        """set-points of each cycle that had some, as the drives decoded them"""
        self.jumps: list[np.ndarray] = []
        """N·m by which each of them, but the first, changed the drives' torque at the state of that moment"""
        self.beats = 0
        self.control_frames = self.command_frames = 0
        self.commanded = np.zeros(n, bool)
        """drives that were told set-points last"""
        self._period = description.period_ns * 1e-9
        self._kinematics, self._protocol = kinematics, protocol
        self._inertia = np.diag(kinematics.mass_matrix(description.home_position())) + 0.05
        self._limit = description.torque_limit
        self._previous = np.zeros(n, np.uint8)
        self._out, self._waiting = frames.empty(64), 0

    def send(self, records: np.ndarray) -> None:
        self._protocol.decode(records, len(records), self.targets)
        self.beats += self.targets.holds
        if self.targets.controlled.any():
            self.control_frames += 1
            words, told = self.targets.controlword, self.targets.controlled
            self.life = np.where(told, lifecycle.transition(self.life, words, self._previous), self.life)
            self._previous = np.where(told, words, self._previous)
        if self.targets.syncs:
            self.commanded = self.targets.commanded.copy()
        if self.targets.commanded.any():
            self.command_frames += 1
            copy = JointCommand(len(self.life))
            copy.copy_from(self.targets.command)
            if self.seen:
                self.jumps.append(effective(copy, self.state) - effective(self.seen[-1], self.state))
            self.seen.append(copy)
        if self.targets.syncs:
            self._step()

    def _step(self) -> None:
        state, command, n = self.state, self.targets.command, len(self.life)
        moving = self.life == State.OPERATION_ENABLED
        gravity = self._kinematics.gravity(state.position)
        for _ in range(10):
            torque = np.where(self.targets.commanded, effective(command, state), 0.0)
            if self.saturate:
                torque = np.clip(torque, -self._limit, self._limit)
            acceleration = (torque - gravity + self.external_torque) / self._inertia
            state.velocity += np.where(moving, acceleration * self._period / 10, -state.velocity)
            state.position += state.velocity * self._period / 10
            state.torque[:] = np.where(moving, torque, 0.0)
        state.status[:] = lifecycle.statusword(self.life)
        state.sequence[:] = self.targets.sequence
        answer = self.targets.answer & ~self.silent
        self._waiting = self._protocol.encode_status(state, np.zeros(n, np.uint8), answer, self._out)
        for request in self._protocol.requests(self.targets):
            if not self.silent[request.joint] and not self.mute[request.joint]:
                asked = request.index == Parameter.PROTOCOL_VERSION
                value = self.protocol_version[request.joint] if asked else 1.0
                out = self._out[self._waiting :]
                self._waiting += self._protocol.encode_reply(request, ParameterResult.OK, value, out)

    def receive(self, timeout_s: float = 0.0) -> np.ndarray:
        waiting, self._waiting = self._waiting, 0
        return self._out[:waiting]

    def fileno(self) -> int:
        return -1

    def close(self) -> None:
        pass


def effective(command: JointCommand, state: JointState) -> np.ndarray:
    return (
        command.torque
        + command.stiffness * (command.position - state.position)
        + command.damping * (command.velocity - state.velocity)
    )


class Bench:
    """A loop, its drives, and the server's ends of ring and mailbox."""

    def __init__(
        self,
        folder: Path,
        description: RobotDescription,
        kinematics: Kinematics,
        protocol: LimbProtocol,
        drives: Any = None,
        tape: TapeWriter | None = None,
    ):
        """`drives`: the port with drives behind it, where they are others than `JointDrives`; `tape`: the loop writes one."""
        self.description, self.runtime = description, Runtime.at(folder)
        self.drives = drives or JointDrives(description, kinematics, protocol)
        port = self.drives if tape is None else TapedPort(self.drives, tape)
        self.hardware = Hardware(description, port, protocol)
        make = Loop if tape is None else partial(TapedLoop, tape, LoopStart.of(description, "lockstep"))
        self.loop = make(self.hardware, kinematics, True, self.runtime)
        dtype = exchange.snapshot_dtype(description)
        self._ring = StateRingReader(self.runtime.state_ring, dtype)
        self._mailbox = MailboxWriter(self.runtime.mailbox, exchange.COMMAND)
        self._serial = 0
        self._frames = {name: i for i, name in enumerate(exchange.frame_names(description))}
        self._joints = {name: i for i, name in enumerate(description.joints)}
        self._devices = {device.name: i for i, device in enumerate(description.devices)}

    def run(self, cycles: int = 1, each: Callable[[], None] = lambda: None) -> np.ndarray:
        """Run cycles; the newest snapshot."""
        for _ in range(cycles):
            self.loop.cycle()
            each()
        return self.snapshot()

    def snapshot(self) -> np.ndarray:
        """The newest snapshot, shape ()."""
        rows = self._ring.read()
        if len(rows):
            self._newest = rows[-1]
        return self._newest

    def post(self, kind: Kind, **fields: float) -> int:
        """Put a command into the mailbox; its serial."""
        self._serial += 1
        self._mailbox.post(exchange.encode_command(kind, self._serial, **fields))  # type: ignore[arg-type]
        return self._serial

    def ask(self, kind: Kind, **fields: float) -> Answer:
        """Put a command into the mailbox, run a cycle, and return the loop's answer."""
        self.post(kind, **fields)
        return Answer(int(self.run()["answer"]))

    def post_start(self, motion: Motion, ends: tuple[EndCondition, ...] = (), owner: int = 1, **fields: float) -> int:
        self._serial += 1
        message = StartAction(id=f"a{self._serial}", owner=f"o{owner}", motion=motion, ends=list(ends), **fields)
        header, payload = exchange.encode_start(
            message, self._serial, owner, self._joints, self._frames, device_index=self._devices
        )
        self._mailbox.post(header, payload)
        return self._serial

    def post_behaviour(self, *steps: Step, owner: int = 1, **fields: Any) -> int:
        self._serial += 1
        message = StartBehaviour(id=f"a{self._serial}", owner=f"o{owner}", steps=list(steps), **fields)
        orders = {
            number: check_gripper(CommandGripper(**msgspec.structs.asdict(step.gripper)), self.description)[1]
            for number, step in enumerate(steps)
            if step.gripper is not None
        }
        meant = (self._joints, self._frames, self._devices, orders)
        self._mailbox.post(*exchange.encode_behaviour(message, self._serial, owner, *meant))
        return self._serial

    def start(self, motion: Motion, ends: tuple[EndCondition, ...] = (), owner: int = 1, **fields: float) -> Answer:
        self.post_start(motion, ends, owner, **fields)
        return Answer(int(self.run()["answer"]))

    def enable(self) -> None:
        """Enable, and wait until the robot holds."""
        self.run(3)
        assert self.ask(Kind.ENABLE) is Answer.ACCEPTED
        for _ in range(50):
            if self.run()["flags"] & Flag.ENABLED:
                self.run(5)
                return
        raise AssertionError("the robot did not come to be enabled")

    def move(self, joint: str, by: float, duration: float = 0.5, **fields: object) -> JointTrajectory:
        """A smooth motion of one joint from where it is commanded, 20 knots of a minimum-jerk profile."""
        start = float(self.loop.written.position[self._joints[joint]])
        u = np.linspace(0.0, 1.0, 20)
        share = u**3 * (10 - 15 * u + 6 * u * u)
        slope = 30 * u * u * (1 - u) ** 2 / duration
        return JointTrajectory(
            joints=[joint],
            times=(u * duration).tolist(),
            positions=(start + by * share)[:, None].tolist(),
            velocities=(by * slope)[:, None].tolist(),
            **fields,  # type: ignore[arg-type]
        )

    def give(self, kind: Kind, **fields: object) -> Answer:
        """Put a command about controllers into the mailbox, run a cycle, and return the loop's answer."""
        self._serial += 1
        self._mailbox.post(*exchange.encode_controllers(kind, self._serial, **fields))  # type: ignore[arg-type]
        snapshot = self.run()
        assert snapshot["answered"] == self._serial
        return Answer(int(snapshot["answer"]))

    def post_device(self, row: int, values: Sequence[float], kind: Kind = Kind.DEVICE) -> None:
        """Put a command for a device into the mailbox."""
        self._serial += 1
        self._mailbox.post(exchange.encode_device(self._serial, row, values, kind))

    def ring_loop(self) -> None:
        """Wake a loop that holds time, as the server does."""
        bell = Bell(loop_doorbell(self.runtime.folder))
        assert bell.ring()
        bell.close()

    def action(self, slot: int = 0) -> tuple[ActionState, Outcome]:
        row = self.snapshot()["actions"][slot]
        return ActionState(int(row["state"])), Outcome(int(row["outcome"]))

    def index(self, joint: str) -> int:
        return self._joints[joint]


class Desk:
    """What the server does about controllers, for a loop in the test's process."""

    def __init__(self, bench: Bench):
        self.bench, self.table = bench, bench.loop.controllers

    def state(self, slot: int) -> ControllerState:
        return ControllerState(int(self.bench.snapshot()["controller_states"][slot]))

    def roster(self) -> Roster:
        return read_roster(roster_file(self.bench.runtime))

    def settle(self, slot: int) -> ControllerState:
        """Cycle until the workshop is done with a slot and has told of it; the slot's state."""
        gives_up = time.monotonic() + PATIENCE_S
        while self.state(slot) is ControllerState.LOADING or self.roster().number != self.table.roster:
            assert time.monotonic() < gives_up, "the workshop takes too long"
            self.bench.run()
            time.sleep(0)
        return self.state(slot)

    def begin(self, name: str, kind: str, joints: Sequence[str], **fields: object) -> int:
        """Have a controller loaded; its slot."""
        slot = self.bench.snapshot()["controller_states"].tolist().index(ControllerState.EMPTY)
        call = LoadController(name=name, kind=kind, joints=list(joints), **fields)  # type: ignore[arg-type]
        assert self.bench.give(Kind.LOAD, text=msgspec.json.encode(call)) is Answer.ACCEPTED
        return slot

    def load(self, name: str, kind: str, joints: Sequence[str], **fields: object) -> int:
        """The slot in which it is inactive now."""
        slot = self.begin(name, kind, joints, **fields)
        assert self.settle(slot) is ControllerState.INACTIVE, self.roster()
        return slot

    def give(self, kind: Kind, **fields: object) -> Answer:
        return self.bench.give(kind, **{"roster": self.table.roster, **fields})

    def switch(self, come: Sequence[int] = (), go: Sequence[int] = (), **fields: object) -> Answer:
        masks = {"come": sum(1 << slot for slot in come), "go": sum(1 << slot for slot in go)}
        return self.give(Kind.SWITCH, **masks, **fields)

    def claimed(self, slot: int) -> list[str]:
        """Joints that it claims whole."""
        rows = (self.bench.snapshot()["claims"] == LOADED_CODE + slot).all(axis=0)
        return [joint for joint, row in zip(self.bench.description.joints, rows, strict=True) if row]


@pytest.fixture
def desk(bench: Bench) -> Desk:
    bench.run(3)
    return Desk(bench)


@pytest.fixture
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user's folder of controllers, with `sway` in it, and `frail`, which sways for 0.15 s and then raises."""
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    folder = tmp_path / "controllers"
    folder.mkdir()
    worn_out = "        if self.phase > 0.9:\n            raise RuntimeError('worn out')\n"
    (folder / "sway.py").write_text(SWAY)
    (folder / "frail.py").write_text(SWAY.replace("        self.phase +=", f"{worn_out}        self.phase +="))
    return folder


@pytest.fixture(scope="session")
def talos() -> RobotDescription:
    return robots.load("talos_upper")


@pytest.fixture(scope="session")
def talos_kinematics(talos: RobotDescription) -> Kinematics:
    return Kinematics(talos)


@pytest.fixture(scope="session")
def talos_protocol(talos: RobotDescription) -> LimbProtocol:
    return LimbProtocol(talos)


@pytest.fixture
def make_bench(talos_kinematics: Kinematics, talos_protocol: LimbProtocol) -> Iterator[Callable[..., Bench]]:
    """Makes a bench for a description of TALOS; `tape`: what goes in and out is written down, in `loop.tape`."""
    made: list[tuple[Bench, Path]] = []

    def make(description: RobotDescription, tape: bool = False) -> Bench:
        folder = Path(tempfile.mkdtemp(prefix="hr"))
        kinematics = copy.copy(talos_kinematics)
        kinematics.description = description
        written = TapeWriter(folder / "loop.tape", TAPE_WORDS) if tape else None
        made.append((Bench(folder, description, kinematics, type(talos_protocol)(description), tape=written), folder))
        return made[-1][0]

    yield make
    for bench, folder in made:
        bench.loop.close()
        shutil.rmtree(folder)


@pytest.fixture
def bench(talos: RobotDescription, make_bench: Callable[..., Bench]) -> Bench:
    return make_bench(talos)
