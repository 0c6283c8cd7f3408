"""What the way from controller to joint costs, for TALOS' upper body at 500 Hz: ``handrail bench hal``. About 40 s.

- the daemon's bus work in lock-step: the real loop runs in this process against a plant of its own process; timed is the CPU time
  that it takes to receive, decode, encode and send, system calls included, the waiting not (by the wall clock, a send that wakes
  the plant on the core that they share would count the plant's turn);
- the plant alone: physics, drives and their 5 kHz firmware, without a bus;
- the whole stack in lock-step: plant, loop and server as processes, a subscriber to all events; holding, and moving an arm under
  end conditions that need the estimated contact force.

Figures are medians over turns, since machines have moods.
"""

from __future__ import annotations

import gc
import select
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from benchmarks.rows import Row
from daemon.controllers.gains import joint_damping
from daemon.loop import Loop
from daemon.warm_up import warm_up
from hal.awake import Awake
from hal.can.port import HubPort
from hal.core_pair import CorePair
from hal.drives.lifecycle import State, controlword_towards
from hal.drives.protocol import LimbProtocol
from hal.hardware import Hardware
from hal.joint import JointCommand, Mode
from hal.plant import scene
from hal.plant.world import World
from handrail.demo.children import Children
from handrail.messages import (
    CheckIn,
    ContactEnd,
    DaemonEvent,
    DaemonStatus,
    DivergenceEnd,
    Enable,
    GetStatus,
    JointTrajectory,
    StartAction,
)
from handrail.robot import library as robots
from handrail.robot.description import RobotDescription
from handrail.robot.kinematics import Kinematics
from handrail.runtime import Runtime, memory_folder
from handrail.topics import Caller, Subscriber

ROBOT, SCENE = "talos_upper", "valve"
_START_S = 120.0
_BUS_CYCLES = 4000
_TURNS, _TURN_S = 7, 1.0
_PLANT_STEPS = 1000
_OWNER, _CHECK_IN_S = "bench", 0.25
_MOVE_S, _SWAY = 120.0, 0.2
"""s of the robot's time that the moving arm moves; rad to each side"""


def rows() -> list[Row]:
    """One row a figure."""
    return [*_bus_rows(), _plant_row(), *_stack_rows()]


def _row(name: str, value: float, unit: str, *, at_most: float | None = None, at_least: float | None = None) -> Row:
    holds = (at_most is None or value <= at_most) and (at_least is None or value >= at_least)
    goal = f"≤ {at_most:g}" if at_most is not None else f"≥ {at_least:g}"
    return Row(name=name, value=round(value, 2), unit=unit, goal=goal, holds=holds)


@contextmanager
def _processes(*names: str, marked: bool = False) -> Iterator[Runtime]:
    """The named processes of a robot's service in lock-step, in a folder of their own. marked: see `stack`."""
    folder = Path(tempfile.mkdtemp(prefix="handrail-bench-", dir=memory_folder()))
    common = ["--robot", ROBOT, "--clock", "lockstep", "--runtime", str(folder)]
    marks = "benchmarks.turn_marks"
    plant, loop = ([marks, "plant"], [marks, "loop"]) if marked else (["hal.plant.world"], ["daemon.loop"])
    commands = {
        "plant": [sys.executable, "-m", *plant, "--scene", SCENE, *common],
        "loop": [sys.executable, "-m", *loop, *common],
        "server": [sys.executable, "-m", "daemon.server", *common],
    }
    try:
        with Children(folder / "logs") as children:
            for name in names:
                children.start(name, commands[name]).wait_for(f"{name} ready", _START_S)
            yield Runtime.at(folder)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


# ---------------------------------------------------------------------------------------------------------- bus work


class _TimedHardware(Hardware):
    """Hardware that tells what each cycle's reading and writing took of the thread's CPU time.

    That counts the system calls, too, and whatever interrupts the kernel accounts to this thread; it does not count the waiting,
    which is done awake as the loop does it (hal.awake), nor the plant's turn.
    """

    def __init__(self, description: RobotDescription, port: HubPort, protocol: LimbProtocol):
        super().__init__(description, port, protocol)
        self.took_ns: list[int] = []
        self._reading_ns = 0
        self._awake, self._poll = Awake(), select.poll()
        self._poll.register(port, select.POLLIN)

    def read(self, wait_s: float = 0.0) -> bool:
        if not self._awake.look(self._poll.poll) and self._poll.poll(wait_s * 1e3):
            self._awake.woken()
        began = time.thread_time_ns()
        done = super().read(wait_s)
        self._reading_ns += time.thread_time_ns() - began
        return done

    def write(self, command: JointCommand | None, cycle: int) -> None:
        began = time.thread_time_ns()
        super().write(command, cycle)
        self.took_ns.append(self._reading_ns + time.thread_time_ns() - began)
        self._reading_ns = 0


def _bus_rows() -> list[Row]:
    description = robots.load(ROBOT)
    kinematics, protocol = Kinematics(description), LimbProtocol(description)
    warm_up(kinematics)
    with _processes("plant") as runtime:
        port = HubPort(runtime.bus, [channel.name for channel in description.channels], name="daemon", ticks=True)
        hardware = _TimedHardware(description, port, protocol)
        core = CorePair(port.hub_process)
        loop = Loop(hardware, kinematics, True, runtime, core)
        try:
            for cycle in range(500):
                loop.cycle()
                if cycle == 3:
                    loop.life.enable()
            assert loop.life.enabled, "the robot did not come to be enabled"
            hardware.took_ns.clear()
            gc.collect()
            gc.freeze()
            for _ in range(_BUS_CYCLES):
                loop.cycle()
                core.look()
        finally:
            loop.close()
            gc.unfreeze()
    p50, p99 = np.percentile(np.array(hardware.took_ns) / 1e3, (50, 99))
    what = "the loop's CPU time for the bus in a cycle: receive, decode, encode, send"
    return [
        _row(f"{what}, median", float(p50), "µs", at_most=50.0),
        _row(f"{what}, p99", float(p99), "µs", at_most=120.0),
    ]


# ------------------------------------------------------------------------------------------------------- plant alone


def _plant_row() -> Row:
    """Holding the ready posture, every drive in operation and commanded each 2 ms."""
    description = robots.load(ROBOT)
    world = World(description, scene.load(SCENE))
    try:
        drives, n = world.drives, len(description.joints)
        words = np.zeros(n, np.uint8)
        for _ in range(5):
            words[:] = controlword_towards(State.OPERATION_ENABLED, drives.state, words)
            drives.control(words)
        hold = JointCommand(n)
        hold.position[:], hold.mode[:] = world.position, Mode.IMPEDANCE
        hold.stiffness[:] = description.stiffness
        hold.damping[:] = joint_damping(Kinematics(description), world.position)
        paces = []
        for _ in range(_TURNS):
            began = time.perf_counter()
            for step in range(_PLANT_STEPS):
                if step % 2 == 0:
                    drives.command(hold)
                world.step()
            paces.append(_PLANT_STEPS * 1e-3 / (time.perf_counter() - began))
        assert (drives.state == State.OPERATION_ENABLED).all(), "a drive left operation"
    finally:
        world.close()
    return _row("plant alone, firmware at 5 kHz", float(np.median(paces)), "× real time", at_least=10.0)


# ------------------------------------------------------------------------------------------------------- whole stack


def _stack_rows() -> list[Row]:
    with stack() as (_, caller):
        holding = _pace(caller)
        sway(caller)
        moving = _pace(caller)
        assert caller.call(GetStatus()).action, "the motion ended before its turns were over"
    what = "whole stack in lock-step: plant, loop, server"
    return [
        _row(f"{what}; holding", holding, "× real time", at_least=5.0),
        _row(f"{what}; an arm moves", moving, "× real time", at_least=5.0),
    ]


@contextmanager
def stack(*, marked: bool = False) -> Iterator[tuple[Runtime, Caller]]:
    """Plant, loop and server in lock-step with the robot enabled, and a subscriber to all events.

    marked: plant and loop write down when each part of a turn is over (benchmarks.turn_marks).
    """
    with _processes("plant", "loop", "server", marked=marked) as runtime:
        caller = Caller(runtime.endpoint("daemon.call"))
        listener = Subscriber(runtime.endpoint("daemon.events"), DaemonEvent)
        ending = threading.Event()
        listening = threading.Thread(target=_listen, args=(listener, ending))
        try:
            while not isinstance(listener.receive(_START_S), DaemonStatus):
                pass
            listening.start()
            caller.call(Enable())
            while not caller.call(GetStatus()).enabled:
                time.sleep(0.05)
            yield runtime, caller
        finally:
            ending.set()
            if listening.is_alive():
                listening.join()
            caller.close()
            listener.close()


def _listen(listener: Subscriber, ending: threading.Event) -> None:
    while not ending.is_set():
        listener.receive(0.1)


def _pace(caller: Caller) -> float:
    """The median of the robot's time over wall time."""
    paces = []
    for _ in range(_TURNS):
        before, began = caller.call(GetStatus()).time_ns, time.perf_counter()
        check_in_for(caller, _TURN_S)
        paces.append((caller.call(GetStatus()).time_ns - before) * 1e-9 / (time.perf_counter() - began))
    return float(np.median(paces))


def check_in_for(caller: Caller, seconds: float) -> None:
    """Let wall time go by while whoever commands the arm stays there."""
    began = time.perf_counter()
    while (passed := time.perf_counter() - began) < seconds:
        caller.call(CheckIn(owner=_OWNER))
        time.sleep(min(_CHECK_IN_S, seconds - passed))


def sway(caller: Caller) -> None:
    """Move the right arm to and fro from now on, for two minutes of the robot's time."""
    caller.call(_to_and_fro(robots.load(ROBOT)))


def _to_and_fro(description: RobotDescription) -> StartAction:
    arm = description.arms["right"]
    joints = description.groups["arm_right"]
    times = np.arange(0.0, _MOVE_S * 1.001, 0.25)
    start = description.home_position("ready")[description.index(joints)]
    share, slope = 0.5 - 0.5 * np.cos(np.pi * times / 2), 0.25 * np.pi * np.sin(np.pi * times / 2)
    towards = np.full(len(joints), _SWAY)
    return StartAction(
        id="sway",
        owner=_OWNER,
        motion=JointTrajectory(
            joints=list(joints),
            times=times.tolist(),
            positions=(start + share[:, None] * towards).tolist(),
            velocities=(slope[:, None] * towards).tolist(),
        ),
        ends=[DivergenceEnd(error=0.4), ContactEnd(frame=arm.tip, threshold=100.0)],
    )
