"""`handrail replay FILE`: drive the loop and its controllers from a recording, and compare every command."""

from __future__ import annotations

import itertools
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from handrail.config import ConfigError
from handrail.robot import library as robots
from handrail.robot.description import RobotDescription
from handrail.robot.keepsake import restore
from handrail.runtime import memory_folder

if TYPE_CHECKING:  # what a loop needs takes a second to import: not for --help
    from daemon.replay.player import Difference
    from daemon.replay.recorded_loop import Cycle, LoopStart
    from daemon.replay.tape_file import FiledLoop

_SHOWN_EVERY = 1000
"""cycles"""


def replay(
    file: Annotated[Path, typer.Argument(help="A recording of `handrail up --record`.", metavar="FILE")],
    robot: Annotated[
        str | None, typer.Option(help="Replay with this robot's description, by name or folder, not the recorded one.")
    ] = None,
    most: Annotated[int | None, typer.Option("--cycles", min=1, help="Replay no more of each loop than this.")] = None,
) -> None:
    """Drive the loop and its controllers from a recording, as fast as they go, and compare every command bit for bit.

    Nothing moves, and no robot need be up. Controllers are those of now: change one, and see the first cycle in which the robot
    would have been commanded otherwise. Exit status 0: the same; 1: different; 2: the file can't be used.
    """
    from daemon.replay.tape_file import UnusableRecording, loops

    same = True
    try:
        for number, loop in enumerate(loops(file), 1):
            same &= _replayed(loop, number, robot, most)
    except (UnusableRecording, ConfigError) as error:
        typer.echo(f"handrail replay: {error}", err=True)
        raise typer.Exit(2) from error
    if not same:
        raise typer.Exit(1)


def _replayed(loop: FiledLoop, number: int, robot: str | None, most: int | None) -> bool:
    """Replay one of a file's loops and tell of it; whether it did the same."""
    from daemon.replay.player import Replay
    from daemon.replay.recorded_loop import cycles, made_with
    from daemon.replay.tape_file import UnusableRecording
    from daemon.warm_up import warm_up
    from handrail.robot.kinematics import Kinematics

    start = loop.start
    with tempfile.TemporaryDirectory(prefix="hr", dir=memory_folder()) as folder:
        description = _description(start, robot, Path(folder))
        typer.echo(f"loop {number} of the recording: {start.robot}, {start.clock} clock")
        kinematics = Kinematics(description)
        warm_up(kinematics)
        replayed = Replay(kinematics, start.clock == "lockstep", Path(folder))
        try:
            found = replayed.run(_shown(itertools.islice(cycles(loop.entries()), most)))
        except ValueError as error:
            raise UnusableRecording(str(error)) from error
        finally:
            replayed.close()
    seconds = replayed.compared * description.period_ns * 1e-9
    if found is None:
        typer.echo(f"  {replayed.compared} cycles ({seconds:.1f} s) compared: every command is the same, bit for bit")
        if loop.incomplete:
            typer.echo(f"  incomplete, the loop went on after that: {loop.incomplete}")
        return True
    typer.echo(f"  {replayed.compared} cycles ({seconds:.1f} s) are the same, bit for bit; the first difference:")
    for line in _told(found):
        typer.echo(f"  {line}")
    now = made_with()
    for what, then in start.made_with.items():
        if then != now.get(what):
            typer.echo(
                f"  {what}: {then} recorded, {now.get(what, 'nothing known')} here: last digits may come from that"
            )
    return False


def _description(start: LoopStart, robot: str | None, folder: Path) -> RobotDescription:
    """The robot as it was recorded, or the one that is asked for. Raises ConfigError, UnusableRecording."""
    from daemon.replay.tape_file import UnusableRecording

    if robot is None:
        try:
            return restore(start.files, folder)
        except KeyError as error:
            raise UnusableRecording(f"the recorded robot {start.robot} has no file {error}") from error
    description = robots.load(robot)
    if list(description.joints) != start.joints:
        raise UnusableRecording(
            f"--robot {robot}: has the joints {', '.join(description.joints)}; recorded were {', '.join(start.joints)}"
        )
    return description


def _told(found: Difference) -> Iterator[str]:
    yield f"cycle {found.cycle}, {found.time_ns * 1e-9:.3f} s of the robot's clock: {found.node}: {found.field}"
    yield f"  recorded  {found.recorded}"
    yield f"  replayed  {found.replayed}"
    if found.more:
        yield f"  and {found.more} more values of that cycle's command"


def _shown(recorded: Iterator[Cycle]) -> Iterator[Cycle]:
    """The same cycles; who looks on is told how far it is."""
    shown = sys.stderr.isatty()
    for cycle in recorded:
        if shown and cycle.number % _SHOWN_EVERY == 0:
            sys.stderr.write(f"\r  {cycle.number} cycles\r")
            sys.stderr.flush()
        yield cycle
