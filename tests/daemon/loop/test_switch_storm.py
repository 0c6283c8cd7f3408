"""Thousands of random switches, legal and illegal, on TALOS in the plant: whole or refused, and no torque jumps at its drives.

The plant is in this process, its drives get the loop's frames, and both measures are the plant's own: what its drives make of the
set-points before and after a cycle's frames, and what its springs carry.
"""

from __future__ import annotations

import dataclasses
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import numpy as np
import pytest

from daemon.exchange import CONTROLLERS, LOADED_CODE, Answer, ControllerState, Kind
from hal.drives.protocol import LimbProtocol
from hal.joint import COMMANDED
from hal.plant.direct_port import DirectPort
from hal.plant.scene import EMPTY
from hal.plant.world import World
from handrail.messages import ConfigureController
from handrail.robot.description import RobotDescription
from handrail.robot.kinematics import Kinematics
from tests.daemon.loop.conftest import Bench, Desk
from tests.soaking import share_of

JUMP = 0.01
"""of a joint's rated torque, in the cycle of a switch"""
SPRING_JUMP = 0.005
"""likewise, of what its spring carries from one ms to the next, in the 10 ms after a switch"""

WAVE = """
import numpy as np
from daemon.controllers.base import Controller

class Wave(Controller):
    '''Waves about a posture that it brings home slowly; starts and ends at full speed.'''

    def activate(self, robot, last):
        self.home = robot.kinematics.description.home_position()[self.joints]
        self.centre, self.phase, self.cycles = last.position[self.joints].copy(), 0.0, 0

    def update(self, robot, out):
        self.cycles += 1
        self.phase += 4.0 * robot.period
        self.centre += np.clip(self.home - self.centre, -0.1 * robot.period, 0.1 * robot.period)
        position = self.centre + 0.02 * np.sin(self.phase)
        self.write_impedance(robot, out, position, np.full(len(self.joints), 0.08 * np.cos(self.phase)))
"""
FRAIL = WAVE.replace(
    "        self.cycles += 1\n", "        self.cycles += 1\n        assert self.cycles < 22, 'worn out'\n"
)
PUSH = """
from daemon.controllers.base import Controller

class Push(Controller):
    '''Feeds forward a little more than the weight; all else is held.'''
    interfaces = ("torque",)

    def activate(self, robot, last):
        pass

    def update(self, robot, out):
        limit = robot.kinematics.description.torque_limit[self.joints]
        out.torque[self.joints] = robot.gravity[self.joints] + 0.02 * limit
"""


class PlantPort(DirectPort):
    """That measures what a cycle's set-points change at drives and springs."""

    def __init__(self, description: RobotDescription):
        super().__init__(World(description, EMPTY))
        self.jump = self.spring_jump = 0.0
        """of the last cycle, the largest share of a joint's rated torque"""
        self.worst = -1
        """that joint"""
        self._rated, self._before = description.torque_limit, self._torque()

    def send(self, records: np.ndarray) -> None:
        self._before = self._torque()
        super().send(records)

    def advance(self, steps: int) -> None:
        jumps = np.abs(self._torque() - self._before) / self._rated
        self.worst = int(jumps.argmax())
        self.jump = float(jumps[self.worst])
        self.spring_jump = 0.0
        for left in range(steps, 0, -1):
            carried = self.world.drives.actuators.spring_torque.copy()
            self.world.step(felt=left == 1)
            change = np.abs(self.world.drives.actuators.spring_torque - carried) / self._rated
            self.spring_jump = max(self.spring_jump, float(change.max()))

    def _torque(self) -> np.ndarray:
        """What each drive makes of its set-point, as its sensors read."""
        drive = self.world.drives.actuators
        spring = drive.stiffness * (drive.position - drive.measured_position)
        return drive.torque + spring + drive.damping * (drive.velocity - drive.measured_velocity)


class PlantBench(Bench):
    """A bench whose drives are the plant's."""

    def __init__(self, folder: Path, description: RobotDescription, kinematics: Kinematics, protocol: LimbProtocol):
        self.port = PlantPort(description)
        super().__init__(folder, description, kinematics, protocol, self.port)


@pytest.fixture
def plant_desk(talos, talos_kinematics, monkeypatch, tmp_path: Path) -> Iterator[Desk]:
    monkeypatch.setenv("HANDRAIL_WORKSPACE", str(tmp_path))
    (tmp_path / "controllers").mkdir()
    for name, text in {"wave": WAVE, "frail": FRAIL, "push": PUSH}.items():
        (tmp_path / "controllers" / f"{name}.py").write_text(text)
    folder = Path(tempfile.mkdtemp(prefix="hr"))
    bench = PlantBench(folder, talos, talos_kinematics, LimbProtocol(talos))
    word = bench.loop.last_word
    word.limits = dataclasses.replace(word.limits, torque_step=np.full_like(word.limits.torque_step, np.inf))
    bench.enable()
    bench.run(300)  # the brakes open, and the springs take the weight
    yield Desk(bench)
    bench.loop.close()
    shutil.rmtree(folder)


@dataclass
class Known:
    """What the test knows of a loaded controller, to judge switches by."""

    joints: list[str]
    interfaces: tuple[str, ...] = COMMANDED
    onto: int = -1
    fallback: list[str] = field(default_factory=list)


class Storm:
    """Draws switches at random and says of each what must come of it."""

    def __init__(self, desk: Desk, seed: int):
        self.desk, self.draw = desk, np.random.default_rng(seed)
        self.known: dict[int, Known] = {}
        self.accepted = self.refused = self.failed = 0
        self.jump = self.spring_jump = 0.0
        left, right, torso = (
            [j for j in desk.bench.description.joints if word in j] for word in ("left", "right", "torso")
        )
        soft = {"stiffness": 0.4}
        self._load("left", "joint_impedance", left, parameters=soft)
        self._load("right", "joint_impedance", right, parameters=soft)
        self._load("arms", "joint_impedance", [*left, *right])
        self._load("guide", "gravity_compensation", left[3:], parameters={"damping": 1.0})
        self._load("wave_left", "wave", left[:4])
        self._load("wave_all", "wave", [*left, *right, *torso])
        self._load("wave_on_left", "wave", left[2:5], onto="left")
        self._load("wave_on_arms", "wave", [left[0], right[0]], onto="arms")
        self._load("frail", "frail", right, fallback=["right"])
        self._load("frail_on_left", "frail", left[:3], onto="left")
        self._load("push_elbow", "push", [left[3], right[3]], interfaces=("torque",))
        self._load("push_right", "push", right, interfaces=("torque",))

    def _load(self, name: str, kind: str, joints: list[str], interfaces: tuple[str, ...] = COMMANDED, **fields) -> None:
        slot = self.desk.load(name, kind, joints, **fields)
        names = {entry.name: entry.slot for entry in self.desk.roster().loaded}
        self.known[slot] = Known(joints, interfaces, names.get(fields.get("onto", ""), -1), fields.get("fallback", []))

    def legal(self, come: list[int], go: list[int], states: dict[int, ControllerState]) -> bool:
        active = {slot for slot, state in states.items() if state is ControllerState.ACTIVE}
        if not set(go) <= active:
            return False
        if any(states[slot] is not ControllerState.INACTIVE and slot not in go for slot in come):
            return False
        after = [*(active - set(go)), *come]
        taken: set[tuple[int, str, str]] = set()
        for slot in after:
            known = self.known[slot]
            if known.onto >= 0 and known.onto not in after:
                return False
            interfaces = known.interfaces if known.onto < 0 else ("position", "velocity")
            claims = {(known.onto, joint, interface) for joint in known.joints for interface in interfaces}
            if taken & claims:
                return False
            taken |= claims
        return True

    def states(self) -> dict[int, ControllerState]:
        return {slot: self.desk.state(slot) for slot in self.known}

    def turn(self) -> None:
        """One switch, judged, and a few cycles after it."""
        desk, bench = self.desk, self.desk.bench
        self._mend()
        before, claims = self.states(), bench.snapshot()["claims"].copy()
        active = [slot for slot, state in before.items() if state is ControllerState.ACTIVE]
        # One slot that is empty is among those that are drawn, and what is active goes more often than what is not.
        come = [slot for slot in [*self.known, 15] if self.draw.random() < 0.1]
        go = [slot for slot in [*self.known, 15] if self.draw.random() < (0.5 if slot in active else 0.02)]
        expected = self.legal(come, go, {**before, 15: ControllerState.EMPTY})
        answer = desk.switch(come, go)
        self._measure()
        assert (answer is Answer.ACCEPTED) == expected, f"{come} come, {go} go, {before}: {answer!r}"
        after = self.states()
        fails = [slot for slot in active if after[slot] is ControllerState.UNCONFIGURED]
        if not fails:
            want = {slot: ControllerState.INACTIVE for slot in go} | {slot: ControllerState.ACTIVE for slot in come}
            assert after == (before | want if expected else before)
            if not expected:
                assert np.array_equal(bench.snapshot()["claims"], claims)
        self.accepted, self.refused = self.accepted + expected, self.refused + (not expected)
        for _ in range(int(self.draw.integers(0, 12))):
            bench.run()
            self._measure()
        self._check_claims()

    def _measure(self) -> None:
        port = self.desk.bench.port
        self.jump, self.spring_jump = max(self.jump, port.jump), max(self.spring_jump, port.spring_jump)
        assert port.jump < JUMP, self._story()
        assert port.spring_jump < SPRING_JUMP, self._story()

    def _story(self) -> str:
        port, switches = self.desk.bench.port, self.accepted + self.refused
        joint = self.desk.bench.description.joints[port.worst]
        active = [slot for slot, state in self.states().items() if state is ControllerState.ACTIVE]
        return (
            f"after {switches} switches: {joint} {port.jump:.2%}, a spring {port.spring_jump:.2%}; active now {active}"
        )

    def _check_claims(self) -> None:
        """Everything is claimed, by who is active: directly, and what is claimed of references not at all."""
        bench = self.desk.bench
        claims = bench.snapshot()["claims"]
        expected = np.full(claims.shape, CONTROLLERS.index("hold"), np.uint8)
        for slot, state in self.states().items():
            known = self.known[slot]
            if state is ControllerState.ACTIVE and known.onto < 0:
                rows = [COMMANDED.index(interface) for interface in known.interfaces]
                expected[np.ix_(rows, bench.description.index(tuple(known.joints)))] = LOADED_CODE + slot
        assert np.array_equal(claims, expected)

    def _mend(self) -> None:
        """Make anew what has failed."""
        for slot, state in self.states().items():
            if state is ControllerState.UNCONFIGURED:
                self.failed += 1
                text = msgspec.json.encode(ConfigureController(name="whatever"))
                assert self.desk.give(Kind.CONFIGURE, go=1 << slot, text=text) is Answer.ACCEPTED
                self._measure()
                while self.desk.state(slot) is ControllerState.LOADING:
                    self.desk.bench.run()
                    self._measure()

    def rage(self, switches: int) -> None:
        for number in range(1, switches + 1):
            self.turn()
            if number % 500 == 0:
                print(f"{number} of {switches} switches", flush=True)
        story = f"{self.accepted} accepted, {self.refused} refused, {self.failed} failed in service"
        print(f"{story}; largest jump at a drive {self.jump:.2%} of rated, of a spring in a ms {self.spring_jump:.2%}")
        assert self.accepted > 0.1 * switches and self.refused > 0.1 * switches and self.failed > 0


def test_random_switches_are_whole_or_refused_and_no_torque_jumps_in_the_plant(plant_desk: Desk) -> None:
    Storm(plant_desk, seed=1).rage(200)


@pytest.mark.soak
@pytest.mark.timeout(3600)
def test_ten_thousand_random_switches(plant_desk: Desk) -> None:
    Storm(plant_desk, seed=2).rage(max(200, share_of(10_000)))
