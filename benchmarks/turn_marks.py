"""Plant and loop in lock-step that write down when each part of a turn is over, for `handrail bench hal_turn`.

    python -m benchmarks.turn_marks plant|loop --robot NAME [--scene NAME] --clock lockstep --runtime DIR

Both are what `python -m hal.plant.world` and `python -m daemon.loop` run, with times of the one monotonic clock taken between their
parts: `time.perf_counter_ns`, which all processes of a machine share on Linux.
"""

from __future__ import annotations

import argparse
import contextlib
import enum
import gc
import mmap
import os
import resource
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from daemon.loop import Loop
from daemon.state.bus_watch import NODE
from daemon.warm_up import warm_up
from hal.can.hub import Hub
from hal.can.port import HubPort
from hal.can.timing import BusTiming
from hal.core_pair import CorePair
from hal.drives.protocol import LimbProtocol
from hal.hardware import Hardware
from hal.joint import JointCommand
from hal.plant import scene, service
from hal.plant.bullet import own_stdout
from hal.plant.world import World
from handrail.robot import library as robots
from handrail.robot.kinematics import Kinematics
from handrail.runtime import Runtime
from handrail.topics import Publisher

_TURNS = 1 << 18
_WORD = 8


class LoopMark(enum.IntEnum):
    """Moments of the loop's turn."""

    WAITS = 0
    """what the turn before left to do is done"""
    HEARD = enum.auto()
    """the drives' frames are in this process"""
    DECODED = enum.auto()
    JUDGED = enum.auto()
    """the robot's state, orders and end conditions are dealt with"""
    DECIDED = enum.auto()
    """controllers and limits have said what to write"""
    ENCODED = enum.auto()
    SENT = enum.auto()
    PUBLISHED = enum.auto()
    SLEPT = enum.auto()
    """no moment: how often this thread has gone to sleep so far"""
    OUSTED = enum.auto()
    """no moment: how often another thread has got its core while it could have run; it offers the core while it waits awake"""


class PlantMark(enum.IntEnum):
    """Moments of the plant's turn."""

    WAITS = 0
    HEARD = enum.auto()
    """the host's frames have been taken off the bus"""
    DECODED = enum.auto()
    STEPPED = enum.auto()
    ENCODED = enum.auto()
    SENT = enum.auto()
    SLEPT = enum.auto()
    """as the loop's"""
    OUSTED = enum.auto()
    """likewise"""


class Marks:
    """Where a thread writes its moments, a row a turn; it stops writing new rows after 2¹⁸."""

    def __init__(self, path: Path, kinds: type[enum.IntEnum]):
        self._kinds, self._row, self._end = len(kinds), 0, (_TURNS - 1) * len(kinds)
        with path.open("xb+") as file:
            file.truncate(_TURNS * self._kinds * _WORD)
            self._words = memoryview(mmap.mmap(file.fileno(), 0)).cast("q")

    def at(self, mark: int) -> None:
        """It is that moment of the turn; where it comes again, the last time counts."""
        self._words[self._row + mark] = time.perf_counter_ns()

    def first_at(self, mark: int) -> None:
        """Likewise; the first time counts."""
        if not self._words[self._row + mark]:
            self.at(mark)

    def next(self) -> None:
        """The turn is over."""
        usage = resource.getrusage(resource.RUSAGE_THREAD)
        end = self._row + self._kinds
        self._words[end - 2], self._words[end - 1] = usage.ru_nvcsw, usage.ru_nivcsw
        self._row = min(self._row + self._kinds, self._end)


def read(path: Path, kinds: type[enum.IntEnum]) -> npt.NDArray[np.int64]:
    """ns (turns, kinds): the whole turns so far."""
    rows = np.fromfile(path, np.int64).reshape(-1, len(kinds))
    return rows[(rows[:, :-2] > 0).all(axis=1)]  # the last two are counts


def loop_file(folder: Path) -> Path:
    """Where the loop's moments are."""
    return folder / "loop.marks"


def plant_file(folder: Path) -> Path:
    """Where the plant's moments are."""
    return folder / "plant.marks"


# -------------------------------------------------------------------------------------------------------------- loop


class _MarkedPort(HubPort):
    marks: Marks

    def receive(self, timeout_s: float = 0.0) -> npt.NDArray[np.void]:
        records = super().receive(timeout_s)
        self.marks.at(LoopMark.HEARD)
        return records

    def send(self, records: npt.NDArray[np.void]) -> None:
        self.marks.at(LoopMark.ENCODED)
        super().send(records)
        self.marks.at(LoopMark.SENT)


class _MarkedHardware(Hardware):
    marks: Marks

    def read(self, wait_s: float = 0.0) -> bool:
        done = super().read(wait_s)
        self.marks.at(LoopMark.DECODED)
        return done

    def write(self, command: JointCommand | None, cycle: int) -> None:
        self.marks.at(LoopMark.DECIDED)
        super().write(command, cycle)


class _MarkedLoop(Loop):
    marks: Marks

    def read_bus(self) -> None:
        self.marks.at(LoopMark.WAITS)
        super().read_bus()

    def run_controllers(self) -> JointCommand | None:
        self.marks.at(LoopMark.JUDGED)
        return super().run_controllers()

    def publish(self) -> None:
        super().publish()
        if not self.holds.active():  # else nobody waits for a turn
            self.marks.at(LoopMark.PUBLISHED)
            self.marks.next()


def _run_loop(options: argparse.Namespace) -> None:
    description, runtime = robots.load(options.robot), Runtime.at(options.runtime)
    kinematics, protocol = Kinematics(description), LimbProtocol(description)
    warm_up(kinematics)
    names = [channel.name for channel in description.channels]
    port = _MarkedPort(runtime.bus, names, name=NODE, ticks=True)
    port.take_turns()
    hardware = _MarkedHardware(description, port, protocol)
    loop = _MarkedLoop(hardware, kinematics, True, runtime, CorePair(port.hub_process))
    port.marks = hardware.marks = loop.marks = Marks(loop_file(runtime.folder), LoopMark)
    signal.signal(signal.SIGTERM, loop.end)
    try:
        loop.run()
    finally:
        loop.close()


# ------------------------------------------------------------------------------------------------------------- plant


class _MarkedWorld(World):
    marks: Marks

    def go_on(self, most: int) -> int:
        self.marks.first_at(PlantMark.DECODED)
        done = super().go_on(most)
        self.marks.at(PlantMark.STEPPED)
        return done


class _MarkedHub(Hub):
    marks: Marks

    def poll(self, timeout_s: float | None = 0.0) -> npt.NDArray[np.void]:
        self.marks.at(PlantMark.WAITS)
        records = super().poll(timeout_s)
        self.marks.at(PlantMark.HEARD)
        return records

    def transmit(
        self, records: npt.NDArray[np.void], senders: npt.NDArray[np.int64] | None = None
    ) -> npt.NDArray[np.void]:
        self.marks.at(PlantMark.ENCODED)
        sent = super().transmit(records, senders)
        self.marks.at(PlantMark.SENT)
        self.marks.next()
        return sent


def _run_plant(options: argparse.Namespace) -> None:
    with own_stdout() as stdout:
        description, objects, runtime = (
            robots.load(options.robot),
            scene.load(options.scene),
            Runtime.at(options.runtime),
        )
        world = _MarkedWorld(description, objects)
        channels = [BusTiming(c.name, c.bitrate, c.data_bitrate) for c in description.channels]
        hub = _MarkedHub(runtime.bus, channels, clock=lambda: world.time_ns)
        world.marks = hub.marks = Marks(plant_file(runtime.folder), PlantMark)
        truth = Publisher(runtime.endpoint("plant.truth"))
        plant = service.Service(world, hub, truth)
        signal.signal(signal.SIGTERM, lambda *_: plant.stop())
        with contextlib.closing(hub), contextlib.closing(world), contextlib.closing(truth):
            service.warm_up(description, objects)
            gc.collect()
            gc.freeze()
            print("plant ready", file=stdout, flush=True)
            plant.run_lockstep()


def main(arguments: list[str] | None = None) -> None:
    """Run one of the two until SIGTERM."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.turn_marks")
    runs: dict[str, Any] = {"plant": _run_plant, "loop": _run_loop}
    parser.add_argument("which", choices=runs)
    parser.add_argument("--robot", required=True)
    parser.add_argument("--scene", default="empty")
    parser.add_argument("--clock", choices=("lockstep",), required=True)
    parser.add_argument("--runtime", required=True)
    options = parser.parse_args(arguments)
    runs[options.which](options)


if __name__ == "__main__":
    main()
    os._exit(0)  # as the loop does: all is closed
