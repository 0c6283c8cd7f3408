"""One test's processes and handles: started as they are asked for, all gone at its end, and evidence kept when it fails."""

from __future__ import annotations

import contextlib
import shutil
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from hal.can import faults
from hal.hil.bus import Bus
from hal.hil.daemon import Daemon
from hal.hil.nursery import Nursery, Process
from hal.hil.plant import Plant
from hal.hil.robot import Robot
from hal.plant import scene
from handrail import messages as m
from handrail.recorder import Links, Recording
from handrail.robot import library as robots
from handrail.runtime import Runtime, memory_folder

_EMPTY = "objects: {}\n"
PLANT_MODULE = "hal.hil.plant_process"
_PLANT_READY_S = 120.0


@dataclass(frozen=True)
class Options:
    """What `@pytest.mark.handrail(...)` may say."""

    robot: str = "talos_upper"
    """name or folder"""
    scene: str = ""
    """name or file; empty: nothing but the robot"""
    clock: Literal["lockstep", "wall"] = "lockstep"
    bus_timing: bool = False
    """frames take the time that they take on a real bus"""
    faults: str = ""
    """a file of faults (hal.can.faults) that begin with the first Sync"""


class Rig:
    """Plant, bus, daemon and robot of one test."""

    def __init__(self, options: Options, nursery: Nursery, *, listens: bool = True):
        """listens: a node of the test's hears all of the daemon's frames, from the first; without it the bus is cheaper.

        Raises handrail.config.ConfigError for a robot, scene or file of faults that can't be read.
        """
        self.options, self._nursery, self._listens = options, nursery, listens
        self.description = robots.load(options.robot)
        if options.scene:
            scene.load(options.scene)
        if options.faults:
            robot = self.description
            faults.read(
                options.faults,
                channels=[channel.name for channel in robot.channels],
                nodes=["daemon", *robot.joints, *(device.name for device in robot.devices)],
            )
        self.folder = Path(tempfile.mkdtemp(prefix="hil", dir=memory_folder()))
        self.runtime = Runtime.at(self.folder)
        self._open = contextlib.ExitStack()
        self._open.callback(shutil.rmtree, self.folder, ignore_errors=True)
        self._process: Process | None = None
        self._plant: Plant | None = None
        self._bus: Bus | None = None
        self._daemon: Daemon | None = None
        self._robot: Robot | None = None
        self._began_ns = time.time_ns()

    def _scene(self) -> str:
        if self.options.scene:
            return self.options.scene
        file = self.folder / "empty.yaml"
        file.write_text(_EMPTY)
        return str(file)

    def _arguments(self) -> list[str]:
        return [
            *("--robot", self.options.robot, "--clock", self.options.clock),
            *("--runtime", str(self.folder)),
        ]

    @property
    def started(self) -> bool:
        """The plant was asked for."""
        return self._process is not None

    @property
    def plant_process(self) -> Process:
        """The plant, started when it is first asked for."""
        if self._process is None:
            arguments = [*self._arguments(), "--scene", self._scene()]
            if self.options.bus_timing:
                arguments.append("--bus-timing")
            if self.options.faults:
                arguments += ["--faults", self.options.faults]
            # Its warm part depends on robot and scene: only the first test with both pays for it.
            self._nursery.warm([PLANT_MODULE], [(f"{PLANT_MODULE}:warm_up", [self.options.robot, self.options.scene])])
            self._process = self._nursery.start("plant", PLANT_MODULE, arguments)
            self._open.callback(self._process.end)
            self._process.wait_for("plant ready", _PLANT_READY_S)
        return self._process

    @property
    def plant(self) -> Plant:
        if self._plant is None:
            assert self.plant_process
            self._plant = Plant(self.runtime, self.description)
            self._open.callback(self._plant.close)
        return self._plant

    @property
    def bus(self) -> Bus:
        if self._bus is None:
            assert self.plant_process
            self._bus = Bus(self.runtime, self.description)
            self._open.callback(self._bus.close)
        return self._bus

    @property
    def daemon(self) -> Daemon:
        if self._daemon is None:
            assert self.bus if self._listens else self.plant_process
            self._nursery.warm(["daemon.loop"], [("daemon.hil:warm_up", [self.options.robot])])
            self._daemon = Daemon(self._nursery, self.runtime, self._arguments())
            self._open.callback(self._daemon.close)
        return self._daemon

    @property
    def robot(self) -> Robot:
        if self._robot is None:
            self._robot = Robot(self.description, self.bus, self.plant, self.daemon)
            self._robot.enable()
        return self._robot

    # ------------------------------------------------------------------------------------------------------------- evidence

    def keep_evidence(self, folder: Path) -> list[str]:
        """Write what happened into `folder`: captures of the bus, a recording, every process's words. Lines for people."""
        folder.mkdir(parents=True, exist_ok=True)
        lines: list[str] = []
        if self._bus is not None:
            for name in ("bus.asc", "bus.blf"):
                lines.append(f"capture: {self._kept(self._bus.save, folder / name)}")
            with contextlib.suppress(ConnectionError):
                lines += [f"fault on the bus: {fault}" for fault in self._bus.report().faults.values()]
        if self._daemon is not None:
            lines.append(f"recording: {self._kept(self._record, folder / 'recording.mcap')}")
        for process in [
            *([self._process] if self._process else []),
            *(self._daemon.processes() if self._daemon else []),
        ]:
            log = folder / f"{process.name}.log"
            log.write_text("\n".join(process.lines))
            lines.append(f"{process.name} {'runs' if process.alive else 'has ended'}: {log}")
            lines += [f"  | {line}" for line in process.lines[-5:]]
        return lines

    @staticmethod
    def _kept(save: Callable[[Path], Path], file: Path) -> str:
        """The file's path, or why there is none: a test's report does not fail over its evidence."""
        try:
            return str(save(file))
        except Exception as error:  # noqa: BLE001
            return f"{file} could not be written: {type(error).__name__}: {error}"

    def _record(self, file: Path) -> Path:
        assert self._daemon is not None
        with file.open("wb") as stream:
            recording = Recording(stream, self._began_ns)
            with contextlib.suppress(ConnectionError, AssertionError):
                info = self._daemon.call(m.GetRobot(), timeout_s=2.0)
                recording.describe(info, Links(self.options.robot))
            for event in list(self._daemon.events):
                recording.take(event)
            recording.finish()
        return file

    def close(self) -> None:
        """End every process, whatever the test has made of it."""
        self._open.close()
