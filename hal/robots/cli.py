"""`handrail robot ...`: which robots there are, whether one of them is consistent, and the power of the one that is up."""

from __future__ import annotations

import enum
import sys
import time
from collections import Counter
from collections.abc import Sized
from contextlib import closing
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn
from rich.table import Column, Table

from handrail.config import ConfigError
from handrail.messages import DeviceStates, SwitchRelay
from handrail.robot import library as robots
from handrail.runtime import Runtime
from handrail.topics import Caller, RefusedError, Subscriber

app = typer.Typer(help="The robots.", no_args_is_help=True, add_completion=False)


@app.callback()
def _group() -> None:
    """The robots that Handrail knows: a folder each, data alone (docs/robots.md)."""


@app.command("list")
def list_robots() -> None:
    """All robots: those of your workspace and those that come with Handrail."""
    table = Table(
        Column("robot", no_wrap=True), "drives", "network", "devices", "base", Column("folder", overflow="fold")
    )
    wrong = []
    for name, file in sorted(robots.files().items()):
        try:
            robot = robots.load(str(file.parent))
        except ConfigError as error:
            table.add_row(name, "", "[red]can't be read[/red]", "", "", str(file.parent))
            wrong.append(f"handrail robot list: {error}")
            continue
        kinds = Counter(device.family for device in robot.devices)
        devices = ", ".join(f"{count} {family}" if count > 1 else family for family, count in kinds.items()) or "none"
        limbs = f"{_count(robot.limbs, 'limb')} on {_count(robot.channels, 'channel')}"
        base = robot.base if robot.base == "fixed" else f"free, {'standing' if robot.support == 'none' else 'hung'}"
        table.add_row(name, str(len(robot.joints)), limbs, devices, base, str(file.parent))
    Console().print(table)
    if wrong:
        sys.exit("\n".join(wrong))


def _count(things: Sized, word: str) -> str:
    return f"{len(things)} {word}{'' if len(things) == 1 else 's'}"


class Contact(enum.StrEnum):
    """What a relay can be told."""

    OPEN = "open"
    CLOSE = "close"


@app.command()
def relay(
    what: Annotated[Contact, typer.Argument(help="Open it: the drives lose their power and close their brakes.")],
    power: Annotated[str | None, typer.Option(help="Which supply.", show_default="the robot's only one")] = None,
    force: Annotated[bool, typer.Option("--force", help="Open it though the robot is enabled.")] = False,
    runtime: Annotated[
        Path | None,
        typer.Option(help="The robot's runtime folder.", show_default="$HANDRAIL_RUNTIME, else this user's"),
    ] = None,
) -> None:
    """Switch the relay of the motors' supply, of the robot that is up. Closed again the drives stay where they are until Enable.

    Exit status 0: its own measurement says that it has switched; 1: refused, or it has not.
    """
    closed = what is Contact.CLOSE
    try:
        place = Runtime.at(runtime, make=False)
        if power is None:
            devices = robots.load(place.robot_up()).devices
            supplies = [device.name for device in devices if device.family == "power"]
            if len(supplies) != 1:
                raise ValueError(
                    f"the robot has {len(supplies)} power supplies; name one (--power): {', '.join(supplies)}"
                )
            power = supplies[0]
        with (
            closing(Subscriber(place.endpoint("daemon.events"), DeviceStates)) as told,
            closing(Caller(place.endpoint("daemon.call"), timeout_s=2.0)) as caller,
        ):
            caller.call(SwitchRelay(power=power, closed=closed, force=force))
            until = time.monotonic() + _SWITCHING_S
            while (left := until - time.monotonic()) > 0.0:
                states = told.receive(left)
                if states is not None and any(s.name == power and s.relay == closed for s in states.powers):
                    print(f"{power}: relay {'closed' if closed else 'open'}")
                    return
        raise ValueError(f"{power}: told to {what}, but it did not say within {_SWITCHING_S:g} s that it has")
    except (OSError, ValueError, RefusedError) as error:
        sys.exit(f"handrail robot relay: {error}")


_SWITCHING_S = 3.0


@app.command()
def check(
    name: Annotated[str, typer.Argument(help="A robot's name or folder.")],
    json: Annotated[Path | None, typer.Option(metavar="PATH", help="Write the rows to this file, too.")] = None,
) -> None:
    """Compare a robot's model with its plant, and look at its network and devices. Exits with 0 only when all of it holds."""
    try:
        robot = robots.load(name)
    except ConfigError as error:
        sys.exit(f"handrail robot: {error}")
    from hal.robots.check import check as rows_of

    rows = []
    with Progress(
        SpinnerColumn(), TextColumn("{task.description}"), console=Console(stderr=True), transient=True
    ) as shown:
        task = shown.add_task(f"checking {robot.name}", total=None)
        try:
            for row in rows_of(robot):
                rows.append(row)
                shown.update(task, description=f"checked {row.about}: {row.name}")
        except (OSError, ValueError) as error:
            sys.exit(f"handrail robot: {error}")
    table = Table("about", "what", "value", "expected", "holds", title=f"Is {robot.name} one robot?")
    for row in rows:
        verdict = "[green]yes[/green]" if row.holds else "[red]NO[/red]"
        table.add_row(row.about, row.name, row.value, row.expected, verdict)
    Console().print(table)
    failed = sum(not row.holds for row in rows)
    Console().print(f"{len(rows)} comparisons, {failed or 'none'} failed.")
    if json:
        json.write_bytes(msgspec.json.format(msgspec.json.encode(rows), indent=2) + b"\n")
    if failed:
        sys.exit(1)
