"""`handrail template reach`: a template that is placed, and what an arm of the robot that is up can do with it."""

from __future__ import annotations

import contextlib
from typing import Annotated

import typer
from rich.console import Console

from handrail.client import DEFAULT_ADDRESS
from handrail.messages import Reach
from handrail.robot_option import ConnectTo, Keys, fail, the_robot

_out = Console()
_COLOURS = {"reached": "green", "near": "yellow", "not": "red"}

_Instance = Annotated[str, typer.Argument(help="An instance that is placed.")]
_Trajectory = Annotated[str, typer.Argument(help="Of its template.")]
_Arm = Annotated[str, typer.Option(help="The robot's arm; left out: its only one.")]


def reach(
    instance: _Instance,
    trajectory: _Trajectory,
    arm: _Arm = "",
    clearance: Annotated[float, typer.Option(min=0.0, help="m to keep from everything.")] = 0.01,
    watch: Annotated[bool, typer.Option(help="Go on as the instance or the robot moves, until Ctrl-C.")] = False,
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Which waypoints an arm can reach, near which limit, or which constraint fails. Exits 1 when one is not reached."""
    with the_robot(connect_to, keys) as robot:
        if not watch:
            found = robot.reach(instance, trajectory, arm, clearance=clearance)
            if found.problem:
                fail(found.problem)
            _show(found)
            raise typer.Exit(any(each.state == "not" for each in found.waypoints))
        with contextlib.suppress(KeyboardInterrupt):
            for found in robot.watch_reach(instance, trajectory, arm, clearance=clearance):
                _show(found)


def _show(found: Reach) -> None:
    state = "" if found.settled else ", from where it was"
    _out.print(
        f"{found.instance} {found.trajectory}, {found.arm} arm (version {found.version}{state})", highlight=False
    )
    if found.problem:
        _out.print(f"  {found.problem}", style="red", markup=False, highlight=False)
    for each in found.waypoints:
        _out.print(f"  {each.name:12} {each}", style=_COLOURS[each.state], markup=False, highlight=False)
