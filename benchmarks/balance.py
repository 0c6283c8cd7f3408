"""TALOS on its own feet, by what its daemon estimates, judged by the plant: ``handrail bench balance``.

The daemon's loop runs on the plant in lock-step in one process. The gantry lets the robot down, `stand` balances it for half a
minute; `reach` brings its right hand 15 cm forwards and 10 cm up; and it is pushed at the pelvis for 0.2 s, forwards, backwards and
aside, harder and softer until it is known to 10 N what it bears. It bears a push when it is back within a centimetre 3 s later,
with every foot within 5 mm of where it was, and no rule has said that it fell.
"""

from __future__ import annotations

import dataclasses
import math
import shutil
import tempfile
from pathlib import Path

import msgspec
import numpy as np
import numpy.typing as npt

from benchmarks.rows import Row
from daemon.controllers.whole_body import WholeBodyControl, made_from
from daemon.exchange import Command, Kind, Outcome, PreparedMotion, Rule, StreamedReference
from daemon.loop import Loop
from daemon.warm_up import warm_up
from daemon.wbc import composition
from daemon.wbc.model import WholeBodyModel
from hal.drives.protocol import LimbProtocol
from hal.hardware import Hardware
from hal.plant.bullet import pybullet as p
from hal.plant.direct_port import DirectPort
from hal.plant.robot_body import BASE
from hal.plant.world import World
from handrail import compound_tasks
from handrail import messages as m
from handrail.robot import library as robots
from handrail.robot.description import RobotDescription
from handrail.robot.kinematics import Kinematics
from handrail.runtime import Runtime, memory_folder

STAND_S, PUSH_S = 30.0, 0.2
SLIP_MM, OFF_MM = 5.0, 10.0
_HAND = "grasp_right"
_WAY = (0.15, 0.0, 0.10)
"""m"""
_STEP, _MOST = 10.0, 400.0
"""N: pushes are tried so finely, and up to there"""
_LEAST = 60.0
"""N that the robot is to bear in every direction"""
DIRECTIONS = {"forwards": (1.0, 0.0), "backwards": (-1.0, 0.0), "to the left": (0.0, 1.0)}

Floats = npt.NDArray[np.float64]


class _Pushed(DirectPort):
    """With a push at the pelvis."""

    force: tuple[float, float, float] = (0.0, 0.0, 0.0)
    until = 0

    def advance(self, steps: int) -> None:
        body, world = self.world.robot, self.world
        for left in range(steps, 0, -1):
            if world.steps < self.until:
                at = body.base_motion()[0]
                p.applyExternalForce(body.number, BASE, self.force, at, p.WORLD_FRAME, physicsClientId=world.client)
            world.step(felt=left == 1)


class Bout:
    """One robot, from the gantry or on its feet, until it is closed."""

    def __init__(self, description: RobotDescription):
        self.description, self.period = description, description.period_ns * 1e-9
        self.kinematics = Kinematics(description)
        self.world = World(description)
        self._port = _Pushed(self.world)
        self._folder = Path(tempfile.mkdtemp(prefix="balance", dir=memory_folder()))
        hardware = Hardware(description, self._port, LimbProtocol(description))
        self.loop = Loop(hardware, self.kinematics, True, Runtime(self._folder))
        self._model = WholeBodyModel.of(self.kinematics, free=True)
        self._soles = [self.world.robot.frame(foot.link)[0] for foot in description.feet]
        self.run(0.01)
        if (refusal := self.loop.life.enable()) is not None:
            raise RuntimeError(f"the robot can't be enabled: {refusal}")
        self.run(0.3)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / self.period)):
            self.loop.cycle()

    def begin(self, name: str, *references: m.Reference) -> None:
        """Start a compound task of the robot's."""
        compound = composition.find(name, compound_tasks.folders(self.description.folder), lambda _: self._model)
        motion = m.WholeBody(compound=msgspec.json.encode(compound).decode(), references=list(references))
        gains, position = self.loop.manager.gains, self.loop.robot.joints.position
        control = made_from(msgspec.msgpack.encode(motion), self.kinematics, gains, self.period, position)
        command = Command(1, Kind.START, motion=PreparedMotion(control.joints, 0, control))
        if (refusal := self.loop.actions.start(command, self.loop.written, self.loop.time_ns)) is not None:
            raise RuntimeError(f"{name} can't be started: {refusal}")

    def bring(self, task: str, position: Floats) -> None:
        """Stream one pose."""
        self.loop.actions.stream(1, StreamedReference(task, position, None, np.zeros(6)))

    def push(self, force: tuple[float, float]) -> None:
        self._port.force, self._port.until = (*force, 0.0), self.world.steps + round(PUSH_S * 1e3)

    @property
    def stands(self) -> bool:
        """Its whole-body controller runs, and no rule has said that it fell."""
        runs = any(isinstance(controller, WholeBodyControl) for controller in self.loop.manager.active)
        return runs and not self.loop.life.ledger.rows["times"][Rule.BALANCE]

    @property
    def outcome(self) -> str:
        """Why its action ended."""
        action = next((one for one in self.loop.actions.slots if one is not None), None)
        return "" if action is None or action.outcome is Outcome.NONE else action.outcome.name.lower()

    def base(self) -> Floats:
        """(3,) m, really."""
        return np.array(self.world.truth().base_in_world.position)

    def soles(self) -> Floats:
        """(feet, 3) m, really."""
        return np.array([self.world.robot.link_motion(sole)[1] for sole in self._soles])

    def estimate_off(self) -> float:
        """mm."""
        return 1e3 * float(np.linalg.norm(self.loop.robot.base.pose[:3] - self.base()))

    def truth(self) -> WholeBodyModel:
        """The model where robot and base really are."""
        pose = self.world.truth().base_in_world
        self._model.place(
            self.world.position, np.zeros(len(self.world.position)), np.array([*pose.position, *pose.orientation]),
            np.zeros(6),
        )  # fmt: skip
        return self._model

    def com_off(self) -> float:
        """mm, level: the centre of mass from the middle of the feet."""
        return 1e3 * float(np.linalg.norm(self.truth().com[:2] - self.soles()[:, :2].mean(axis=0)))

    def close(self) -> None:
        self.loop.close()
        shutil.rmtree(self._folder)


def stand(description: RobotDescription, seconds: float = STAND_S) -> dict[str, float]:
    """Let down by the gantry, balanced for so long: the most of what is off after the first second."""
    bout = Bout(dataclasses.replace(description, support="hoist"))
    hoist = bout.world.hoist
    assert hoist is not None
    for _ in range(40):
        if hoist.slack:
            break
        bout.run(0.1)
    bout.begin("stand")
    bout.run(1.0)
    start, soles, seen = bout.base(), bout.soles(), np.zeros(4)
    for _ in range(round(seconds / 0.02)):
        bout.run(0.02)
        slipped, moved = np.abs(bout.soles() - soles).max(), np.linalg.norm(bout.base() - start)
        seen = np.maximum(seen, [1e3 * slipped, 1e3 * moved, bout.com_off(), bout.estimate_off()])
    stood = bout.stands
    bout.close()
    return dict(zip(("slip", "base", "com", "estimate"), (seen if stood else seen + math.inf).tolist(), strict=True))


def reach(description: RobotDescription) -> dict[str, float]:
    """The right hand goes `_WAY` and stays: mm from there, and what else is off meanwhile."""
    bout = Bout(dataclasses.replace(description, support="none"))
    bout.begin("reach", m.PoseStream(task="right_hand", speed=0.2))
    bout.run(1.0)
    goal = bout.truth().frame(_HAND).translation + _WAY
    soles, seen = bout.soles(), np.zeros(2)
    # What is known of the hand is what the estimate says.
    off = bout.loop.robot.base.pose[:3] - bout.base()
    for _ in range(200):
        bout.bring("right_hand", goal + off)
        bout.run(0.02)
        seen = np.maximum(seen, [1e3 * np.abs(bout.soles() - soles).max(), bout.com_off()])
    hand = 1e3 * float(np.linalg.norm(bout.truth().frame(_HAND).translation - goal))
    stood = bout.stands
    bout.close()
    told = {"hand": hand, "slip": float(seen[0]), "com": float(seen[1])}
    return told if stood else dict.fromkeys(told, math.inf)


def bears(description: RobotDescription, force: tuple[float, float]) -> bool:
    """Whether it is back, with its feet where they were, 3 s after a push of so many N."""
    bout = Bout(dataclasses.replace(description, support="none"))
    bout.begin("stand")
    bout.run(1.0)
    start, soles = bout.base(), bout.soles()
    bout.push(force)
    bout.run(PUSH_S)
    for _ in range(30):
        bout.run(0.1)
        if not bout.stands or 1e3 * np.abs(bout.soles() - soles).max() > SLIP_MM:
            break
    else:
        back = 1e3 * float(np.linalg.norm(bout.base() - start)) < OFF_MM
        bout.close()
        return back
    bout.close()
    return False


def limit(description: RobotDescription, direction: tuple[float, float]) -> float:
    """N: the most of the pushes tried in this direction that it bears, to 10 N, if what is less is borne, too."""
    low, high = 0.0, _MOST
    while high - low > _STEP:
        middle = _STEP * round(0.5 * (low + high) / _STEP)
        if bears(description, (middle * direction[0], middle * direction[1])):
            low = middle
        else:
            high = middle
    return low


def rows() -> list[Row]:
    """Some minutes."""
    talos = robots.load("talos")
    warm_up(Kinematics(talos))

    def most(name: str, value: float, limit: float, unit: str = "mm") -> Row:
        return Row(name=name, value=round(value, 3), unit=unit, goal=f"< {limit:g}", holds=value < limit)

    stood, reached = stand(talos), reach(talos)
    told = [
        most(f"let down and balanced for {STAND_S:g} s: a foot slips", stood["slip"], SLIP_MM),
        most("the pelvis wanders", stood["base"], OFF_MM),
        most("the centre of mass is off the feet's middle", stood["com"], 20.0),
        most("the estimated base is off", stood["estimate"], OFF_MM),
        most("reaches by 15 cm and 10 cm up: the hand ends off", reached["hand"], 15.0),
        most("meanwhile a foot slips", reached["slip"], SLIP_MM),
        most("and the centre of mass is off the feet's middle", reached["com"], 20.0),
    ]
    for name, direction in DIRECTIONS.items():
        borne = limit(talos, direction)
        told.append(
            Row(name=f"bears a push of {PUSH_S:g} s {name}", value=borne, unit="N", goal=f"≥ {_LEAST:g}",
                holds=borne >= _LEAST)
        )  # fmt: skip
    return told
