"""`handrail controllers ...`: which controllers there are on the robot that is up; load, switch and unload them while it runs."""

from __future__ import annotations

import fnmatch
import sys
import time
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Annotated, Any

import msgspec
import typer

from daemon.cli import RUNTIME, aligned, ask
from handrail.messages import (
    ConfigureController,
    ControllerEvent,
    ControllerInfo,
    ControllerList,
    GetControllers,
    GetRobot,
    LoadController,
    RobotInfo,
    SwitchControllers,
    UnloadController,
)
from handrail.runtime import Runtime
from handrail.topics import Subscriber

controllers = typer.Typer(help="Controllers.", no_args_is_help=True, add_completion=False)

_PATIENCE_S = 120.0
"""for a controller to be made: compiling its kernels for the first time takes long"""
_LOOK_S = 1.0
"""an event is waited for, and looked for itself in case that it came before this process heard any"""

_Runtime = Annotated[Path | None, RUNTIME]
_Parameters = Annotated[str | None, typer.Option(help="What its kind takes: a JSON object, or @FILE with one.")]


@controllers.callback()
def _controllers() -> None:
    """The controllers of the robot that is up (docs/controllers.md)."""


@controllers.command(name="list")
def list_(
    json: Annotated[bool, typer.Option("--json", help="Print everything as JSON.")] = False, runtime: _Runtime = None
) -> None:
    """What is loaded and what is active, for how long and with what each claims; and which kinds may be loaded.

    Of what was active and is not any more it says what took it out of service, and what to do.

    Exit status 1: one of them has failed, which is then said below.
    """
    told: ControllerList = ask("controllers list", GetControllers(), runtime)
    if json:
        print(msgspec.json.format(msgspec.json.encode(told), indent=1).decode())
    else:
        heads = ("controller", "kind", "state", "for", "claims", "of", "joints")
        rows = [_row(info, told.time_ns) for info in told.controllers]
        print(*(aligned([heads, *rows]) if rows else ["no controller is loaded"]), sep="\n")
        for info in (info for info in told.controllers if info.why):
            print(f"{info.name} is inactive: {info.why}")
        print(f"kinds: {', '.join(told.kinds)}")
    if failed := [c for c in told.controllers if c.error]:
        sys.exit("\n".join(f"handrail controllers list: {c.name}: {c.error}" for c in failed))


@controllers.command()
def load(
    name: Annotated[str, typer.Argument(help="What to call it.")],
    joints: Annotated[list[str], typer.Option(help="Joints, globs or groups that it will claim; may be repeated.")],
    kind: Annotated[str, typer.Option(help="One that `list` names; else its name is its kind.")] = "",
    parameters: _Parameters = None,
    onto: Annotated[str, typer.Option(help="A loaded controller whose references it commands, not the robot.")] = "",
    fallback: Annotated[list[str] | None, typer.Option(help="What takes over when it fails; may be repeated.")] = None,
    unconfigured: Annotated[bool, typer.Option("--unconfigured", help="Do not make it yet.")] = False,
    runtime: _Runtime = None,
) -> None:
    """Load a controller and wait until it is inactive: ready to be switched on. The robot goes on meanwhile."""
    verb = "controllers load"
    robot: RobotInfo = ask(verb, GetRobot(), runtime)
    call = LoadController(
        name=name,
        kind=kind or name,
        joints=_named(joints, robot),
        parameters=_object(verb, parameters) or {},
        onto=onto,
        fallback=fallback or [],
        configure=not unconfigured,
    )
    with _heard(verb, runtime) as events:
        ask(verb, call, runtime)
        _wait(verb, name, runtime, events)


@controllers.command()
def configure(
    name: Annotated[str, typer.Argument(help="A loaded controller that is not active.")],
    parameters: _Parameters = None,
    runtime: _Runtime = None,
) -> None:
    """Make a controller anew, with other parameters or after it has failed, and wait until it is inactive."""
    verb = "controllers configure"
    call = ConfigureController(name=name, parameters=_object(verb, parameters))
    with _heard(verb, runtime) as events:
        ask(verb, call, runtime)
        _wait(verb, name, runtime, events)


@controllers.command()
def switch(
    activate: Annotated[list[str] | None, typer.Option(help="Loaded, inactive; may be repeated.")] = None,
    deactivate: Annotated[list[str] | None, typer.Option(help="Loaded, active; may be repeated.")] = None,
    runtime: _Runtime = None,
) -> None:
    """Start and end controllers: all of them in one cycle, or none. What is left over is held."""
    if not activate and not deactivate:
        sys.exit("handrail controllers switch: nothing to switch; expected --activate NAME, --deactivate NAME or both")
    call = SwitchControllers(activate=activate or [], deactivate=deactivate or [])
    ask("controllers switch", call, runtime)


@controllers.command()
def unload(
    name: Annotated[str, typer.Argument(help="A loaded controller that is not active.")], runtime: _Runtime = None
) -> None:
    """Forget a controller."""
    ask("controllers unload", UnloadController(name=name), runtime)


def _row(info: ControllerInfo, now_ns: int) -> tuple[str, ...]:
    since = f"{(now_ns - info.since_ns) * 1e-9:.1f} s" if info.since_ns else "-"
    what = "everything" if len(info.interfaces) == 5 else "+".join(info.interfaces)
    return (info.name, info.kind, info.state, since, what, info.onto or "robot", " ".join(info.joints))


def _named(words: Sequence[str], robot: RobotInfo) -> list[str]:
    """Joints by name, glob or group, in the robot's order; a word that means none is left for the daemon to refuse."""
    found = {joint for word in words for joint in (robot.groups.get(word) or fnmatch.filter(robot.joints, word))}
    unknown = [word for word in words if word not in robot.groups and not fnmatch.filter(robot.joints, word)]
    return [joint for joint in robot.joints if joint in found] + unknown


def _object(verb: str, given: str | None) -> dict[str, Any] | None:
    if given is None:
        return None
    try:
        text = Path(given[1:]).read_bytes() if given.startswith("@") else given.encode()
        return msgspec.json.decode(text, type=dict[str, Any])
    except (OSError, msgspec.DecodeError) as error:
        sys.exit(f"handrail {verb}: --parameters {given}: {error}; expected a JSON object, or @FILE with one")


def _heard(verb: str, runtime: Path | None) -> closing[Subscriber]:
    """What is told of controllers from now on."""
    try:
        return closing(Subscriber(Runtime.at(runtime, make=False).endpoint("daemon.events"), ControllerEvent))
    except ValueError as error:
        sys.exit(f"handrail {verb}: {error}")


def _wait(verb: str, name: str, runtime: Path | None, events: Subscriber) -> None:
    """Until the controller is made, or is known not to be."""
    deadline = time.monotonic() + _PATIENCE_S
    while time.monotonic() < deadline:
        told: ControllerList = ask(verb, GetControllers(), runtime)
        info = next((c for c in told.controllers if c.name == name), None)
        if info is None:
            sys.exit(f"handrail {verb}: {name} could not be loaded: {told.lost.get(name, 'it is not there')}")
        if info.error:
            sys.exit(f"handrail {verb}: {name} could not be made: {info.error}")
        if info.state != "loading":
            print(f"{name} is {info.state}")
            return
        while (event := events.receive(_LOOK_S)) is not None and event.name != name:
            pass
    sys.exit(f"handrail {verb}: {name} is still loading after {_PATIENCE_S:g} s (handrail controllers list)")
