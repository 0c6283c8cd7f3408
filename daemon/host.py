"""`handrail up ROBOT`: the robot's service. Starts plant and cameras (if simulated), loop, server, engine and link, and keeps them
alive.

What a death means: the *loop* is started anew, and nothing moves until it is enabled; the *server* goes on where it was, the
motion with it; the *engine*'s running action ends, since its owner no longer checks in; the *link* or the *camera* is started anew,
and the motion goes on; the *plant* takes the loop with it, since the bus lives inside it.
"""

from __future__ import annotations

import contextlib
import os
import shlex
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from daemon import exchange, timing
from daemon.exchange import mailbox, ring
from daemon.exchange.shared_file import drop_unless_fit
from daemon.service_desk import ServiceDesk
from daemon.serving.health import clear_health, write_health, write_processes
from daemon.supervisor import Child, StartError, Supervisor
from handrail.config import ConfigError
from handrail.engines import FIRST, checked
from handrail.robot import library as robots
from handrail.robot.description import RobotDescription
from handrail.runtime import Runtime
from handrail.sole_holder import HeldElsewhere, sole_holder

_MOST_ENGINES = 8


class Clock(StrEnum):
    """The robot's clock."""

    WALL = "wall"
    LOCKSTEP = "lockstep"


class UsageError(ValueError):
    """What was asked for can't be done; str() is one line for people."""


def children(
    description: RobotDescription,
    *,
    robot: str,
    scene: str | None,
    clock: Clock,
    runtime: Runtime,
    port: int,
    bind: str = "127.0.0.1",
    engine: bool = True,
    engines: Sequence[str] = (),
    code: Path | None = None,
    link: bool = True,
    camera: bool = True,
    bus_timing: bool = False,
    faults: Path | None = None,
    let_down: bool = False,
    record: Path | None = None,
) -> list[Child]:
    """The processes of this robot's service, in the order in which they start. Raises UsageError and ConfigError.

    `robot`: its name or folder as the user gave it; `engines`: names of those beside the first; `code`: where each keeps, in a
    folder of its name, what is deployed to it.
    """
    simulated = any(channel.interface == "handrail" for channel in description.channels)
    if clock is Clock.LOCKSTEP and not all(channel.interface == "handrail" for channel in description.channels):
        raise UsageError(
            f"--clock lockstep: {description.name} has real buses, and a real robot's time can't be held; expected wall"
        )
    if scene is not None and not simulated:
        raise UsageError(f"--scene {scene}: {description.name} has real buses, nothing is simulated; leave it out")
    if let_down and description.base != "free":
        raise UsageError(f"--let-down: {description.name} has a fixed base; leave it out")
    if not simulated and (bus_timing or let_down or faults is not None):
        option = "--bus-timing" if bus_timing else "--let-down" if let_down else f"--faults {faults}"
        raise UsageError(f"{option}: {description.name} has real buses, which can't be told; leave it out")
    python = (sys.executable, "-m")
    place = ("--runtime", str(runtime.folder))
    robot_and_clock = ("--robot", robot, "--clock", clock.value, *place)
    processes = []
    if record is not None:
        # First, and so ended last: what the others say at their end is recorded, too.
        processes.append(
            Child("recorder", (*python, "daemon.replay.recorder", "--out", str(record.absolute()), *place))
        )
    if simulated:
        on_bus = (
            *(["--bus-timing"] if bus_timing else []),
            *(["--let-down"] if let_down else []),
            *(["--faults", _checked_faults(faults, description)] if faults else []),
        )
        processes.append(
            Child("plant", (*python, "hal.plant.world", "--scene", _checked_scene(scene), *robot_and_clock, *on_bus))
        )
    with_plant = ("plant",) if simulated else ()
    tape = ("--tape",) if record is not None else ()
    processes.append(Child("loop", (*python, "daemon.loop", *robot_and_clock, *tape), bound_to=with_plant))
    processes.append(Child("server", (*python, "daemon.server", *robot_and_clock)))
    if engine:
        for name in (FIRST, *engines):
            own = () if name == FIRST else ("--name", name)
            kept = () if code is None else ("--code", str(code.absolute() / name))
            what = ("engines.engine", "--robot", robot, *place, *own, *kept)
            processes.append(Child(name, (*python, *what), after=("server",)))
    if link:
        processes.append(Child("link", (*python, "handrail.link.gate", *place, "--port", str(port), "--bind", bind)))
    if camera and simulated and description.cameras:
        # Last, and nobody waits for it: it looks at a plant that may come and go.
        what = ("--scene", _checked_scene(scene), *robot_and_clock)
        processes.append(Child("camera", (*python, "hal.plant.camera", *what), after=("plant",)))
    return processes


def further_engines(text: str) -> list[str]:
    """Names of the engines beside the first, as `--engines` says them: their number or their names. Raises UsageError."""
    if text.isdecimal():
        if not 1 <= int(text) <= _MOST_ENGINES:
            raise UsageError(f"--engines {text}: expected 1 to {_MOST_ENGINES}, or names")
        return [f"{FIRST}{number}" for number in range(2, int(text) + 1)]
    names = text.split(",")
    try:
        for name in names:
            checked(name)
    except ValueError as problem:
        raise UsageError(f"--engines {text}: {problem}") from problem
    if len({FIRST, *names}) <= len(names):
        raise UsageError(f"--engines {text}: expected each name once, and the first engine is called {FIRST} already")
    return names


def check_network(description: RobotDescription) -> None:
    """Refuse a robot with real buses whose interfaces, bit rates or drives are not as described. Raises UsageError."""
    if all(channel.interface == "handrail" for channel in description.channels):
        return
    # Only robots on real buses pay for python-can.
    from hal.can import bus_check
    from hal.can.wire import BusLost
    from hal.drives.protocol import LimbProtocol

    try:
        bus_check.check_channels(description.channels)
        bus_check.check_real_drives(description, LimbProtocol)
    except (BusLost, ValueError) as error:
        raise UsageError(str(error)) from error


def _checked_scene(scene: str | None) -> str:
    """The scene, read once here so that a wrong file is one clear line and not a process that dies."""
    from hal.plant import scene as scenes  # only a simulated robot needs what it imports

    if scene is None:
        known = sorted(scenes.library())
        raise UsageError(f"--scene is missing: this robot is simulated; expected one of {', '.join(known)}, or a file")
    scenes.load(scene)
    return scene


def _checked_faults(file: Path, description: RobotDescription) -> str:
    """The file of faults, read once here as the scene is."""
    from hal.can import faults

    faults.read(file, channels=[channel.name for channel in description.channels])
    return str(file)


@contextmanager
def sole_service(runtime: Runtime) -> Iterator[None]:
    """Hold the runtime folder for this process. Raises UsageError when another service runs in it."""
    with ExitStack() as held:
        try:
            held.enter_context(sole_holder(runtime.folder / "up.lock"))
        except HeldElsewhere as error:
            raise UsageError(
                f"a robot is up in {runtime.folder} already (process {error.process}): end that one, or give another --runtime"
            ) from error
        except OSError as error:
            raise UsageError(
                f"runtime folder: {runtime.folder}: {error.strerror}; expected a folder that this user may write in"
            ) from error
        yield


def drop_leftovers(runtime: Runtime, description: RobotDescription) -> None:
    """Remove what another robot's (or version's) service left where this one's loop and server meet. Call as the sole service.

    What this robot's own left stays: a server that starts tells how its actions ended, and latches its operator stop again.
    """
    snapshot = exchange.snapshot_dtype(description)
    runtime.tape.unlink(missing_ok=True)  # of a recording that has ended: none of the next one's
    drop_unless_fit(runtime.state_ring, magic=ring.MARK, record_size=snapshot.itemsize)
    drop_unless_fit(runtime.mailbox, magic=mailbox.MARK, record_size=exchange.COMMAND.itemsize)
    drop_unless_fit(runtime.timing, magic=timing.MARK, record_size=timing.RECORD.itemsize)


class _Log:
    """The live log: one line an event, with the seconds since the start and the process that it is about."""

    def __init__(self) -> None:
        self._start = time.monotonic()
        self._colour = sys.stdout.isatty()

    def __call__(self, name: str, text: str) -> None:
        """A line about (or of) one process."""
        shown = f"\x1b[1m{name:<7}\x1b[0m" if self._colour else f"{name:<7}"
        # Whoever read the log may have gone (`| head`, a closed terminal): the robot's service goes on.
        with contextlib.suppress(OSError):
            typer.echo(f"{time.monotonic() - self._start:7.1f} s  {shown} {text}")


def up(
    robot: Annotated[str, typer.Argument(help="Name or folder of the robot, e.g. talos_upper.")],
    *,
    scene: Annotated[str | None, typer.Option(help="What stands around a simulated robot: name or file.")] = None,
    clock: Annotated[
        Clock, typer.Option(help="wall, or lockstep: simulated time goes as fast as it can, the same way each time.")
    ] = Clock.WALL,
    runtime: Annotated[
        Path | None, typer.Option(help="Folder where the robot's processes meet (default: yours).")
    ] = None,
    bind: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Address that the link listens on; *: every interface.")
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(min=1, max=65534, help="TCP port of the link; events go out on the next.")
    ] = 47800,
    engine: Annotated[bool, typer.Option(help="Start the engine, which runs programs.")] = True,
    engines: Annotated[
        str, typer.Option(help="How many engines, or the names of further ones: vision,arm.", metavar="NUMBER|NAMES")
    ] = "1",
    code: Annotated[
        Path | None,
        typer.Option(help="Where deployed code is kept (default: the runtime folder, which a reboot empties)."),
    ] = None,
    link: Annotated[bool, typer.Option(help="Start the link, through which tablets and scripts come.")] = True,
    camera: Annotated[bool, typer.Option(help="Start a simulated robot's cameras.")] = True,
    check: Annotated[
        bool, typer.Option(help="First see that a robot's real buses are as described, and its drives answer.")
    ] = True,
    bus_timing: Annotated[
        bool, typer.Option("--bus-timing", help="Frames on a simulated robot's bus take the time that they would.")
    ] = False,
    faults: Annotated[
        Path | None, typer.Option(help="YAML file of faults that a simulated robot's bus shall have.")
    ] = None,
    let_down: Annotated[
        bool,
        typer.Option("--let-down", help="A simulated gantry lets its robot down on its feet once its drives hold it."),
    ] = False,
    record: Annotated[
        Path | None,
        typer.Option(
            help="MCAP file to record everything in that the robot says, and its control loop so that `handrail replay` can run it."
        ),
    ] = None,
) -> None:
    """Start a robot's service: plant and cameras (if simulated), loop, server, engine and link, and keep them alive until Ctrl-C.

    Nothing moves before somebody enables the robot. A process that dies is started anew.
    Exit status 0: ended as asked; 1: a process did not start; 2: wrong use.
    """
    try:
        place = _place(runtime)
        description = robots.load(robot)
        processes = children(
            description,
            robot=robot,
            scene=scene,
            clock=clock,
            runtime=place,
            port=port,
            bind=bind,
            engine=engine,
            engines=further_engines(engines),
            code=code,
            link=link,
            camera=camera,
            bus_timing=bus_timing,
            faults=faults,
            let_down=let_down,
            record=record,
        )
        if check:
            check_network(description)
        with sole_service(place):
            where = f" in scene {scene}" if scene else ""
            typer.echo(f"{description.name}{where}, {clock.value} clock")
            typer.echo(f"runtime folder {place.folder}")
            drop_leftovers(place, description)
            place.robot.write_text(f"{description.folder.resolve()}\n", encoding="utf-8")
            try:
                _serve(processes, place, port if link else None)
            finally:
                place.robot.unlink(missing_ok=True)
    except (ConfigError, UsageError) as error:
        typer.echo(f"handrail up: {error}", err=True)
        raise typer.Exit(2) from error
    except StartError as error:
        typer.echo(f"handrail up: {error}; everything has been ended again. What it said is above", err=True)
        raise typer.Exit(1) from error


def _place(runtime: Path | None) -> Runtime:
    try:
        return Runtime.at(runtime)
    except (ValueError, OSError) as error:
        raise UsageError(str(error)) from error


def _serve(processes: list[Child], runtime: Runtime, port: int | None) -> None:
    """Run the service until SIGINT or SIGTERM."""
    typer.echo(f"starting {', '.join(child.name for child in processes)}")
    supervisor = Supervisor(
        processes,
        report=_Log(),
        environment={
            "HANDRAIL_RUNTIME": str(runtime.folder),
            # Each process has small problems and a core at most: threads of linear algebra only steal from the loop.
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
        },
    )
    supervisor.on_health = lambda health: write_health(runtime.folder, health)
    supervisor.on_processes = lambda processes: write_processes(runtime.folder, processes)
    desk = ServiceDesk(runtime, supervisor)
    # A signal that comes just before a wait begins would be handled only after it: its arrival ends the wait, too.
    signal.set_wakeup_fd(supervisor.wake_fd, warn_on_full_buffer=False)
    numbers = [signal.SIGINT, signal.SIGTERM]
    if (
        signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN
    ):  # a closed terminal ends the service in order; not so with nohup
        numbers.append(signal.SIGHUP)
    for number in numbers:
        signal.signal(number, lambda _signal, _frame: supervisor.ask_end())
    try:
        if supervisor.start():
            with contextlib.suppress(OSError):  # as in _Log
                _welcome(runtime, port)
            supervisor.run()
        with contextlib.suppress(OSError):
            typer.echo("ending all processes")
    finally:
        signal.set_wakeup_fd(-1)
        desk.close()
        supervisor.close()
        clear_health(runtime.folder)


def _welcome(runtime: Runtime, port: int | None) -> None:
    """Tell how to go on."""
    # A terminal that finds another folder by itself needs to be told.
    ours = "HANDRAIL_RUNTIME" not in os.environ and runtime.folder == Runtime.at().folder
    there = "" if ours else f" --runtime {shlex.quote(str(runtime.folder))}"
    typer.echo("")
    typer.echo("All up. Nothing moves before the robot is enabled.")
    if port is not None:
        typer.echo(f"  operator's window   handrail tablet --connect tcp://127.0.0.1:{port}")
    typer.echo(f"  stop the robot      handrail stop{there}")
    typer.echo("  end the service     Ctrl-C")
    typer.echo("")
