"""`handrail template reach | run | expand`: a template that is placed, and an arm of the robot that is up."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from handrail.client import DEFAULT_ADDRESS
from handrail.following import FOLLOWED, follow, on_failure
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
    clearance: Annotated[float, typer.Option(min=0.0, help="m to keep from everything.")] = 0.015,
    watch: Annotated[bool, typer.Option(help="Go on as the instance or the robot moves, until Ctrl-C.")] = False,
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Which waypoints an arm can reach, near which limit, or which constraint fails. Exits 1 when one is not reached."""
    with the_robot(connect_to, keys) as robot:
        if not watch:
            # The first one that is settled: what it would be from where it was, is no answer to whoever asks once.
            about = robot.watch_reach(instance, trajectory, arm, clearance=clearance)
            found = next(each for each in about if each.settled or each.problem)
            if found.problem:
                fail(found.problem)
            _show(found)
            raise typer.Exit(any(each.state == "not" for each in found.waypoints))
        with contextlib.suppress(KeyboardInterrupt):
            for found in robot.watch_reach(instance, trajectory, arm, clearance=clearance):
                _show(found)


_Other = Annotated[
    str, typer.Option(help="For a sync of two hands: the arm of the second one; left out: the robot's other one.")
]
_First = Annotated[str, typer.Option("--from", help="Waypoint to go to first; left out: the first, or the next one.")]
_Steps = Annotated[int, typer.Option(min=0, help="Waypoints to go to, from where the last run left the hand; 0: all.")]
_Back = Annotated[bool, typer.Option("--backwards", help="Each leg as it was gone forwards.")]
_Loop = Annotated[int, typer.Option(min=1, max=1000, help="How often, beginning anew after the last waypoint.")]


def run(
    instance: _Instance,
    trajectory: _Trajectory,
    arm: _Arm = "",
    other: _Other = "",
    first: _First = "",
    steps: _Steps = 0,
    backwards: _Back = False,
    loop: _Loop = 1,
    yes: Annotated[bool, typer.Option("--yes", help="Approve every prompt (its first option) without asking.")] = False,
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Go along a trajectory, or a sync of two hands, waypoint by waypoint: an ordinary run, as `handrail program run` follows it.

    `handrail program autonomy high` has every motion asked about first, with its plan's ghost to be seen. Ctrl-C stops the motion.
    Exits with 0 when it succeeded, 1 when it failed or was refused, 130 when it was stopped.
    """
    with the_robot(connect_to, keys) as robot, robot.events(*FOLLOWED) as events:
        started = robot.run_template(
            instance,
            trajectory,
            arm,
            other=other,
            first=first,
            steps=steps,
            backwards=backwards,
            loop=loop,
            on_failure=on_failure(yes),
        )
        raise typer.Exit(follow(robot, events, started, yes=yes))


def expand(
    instance: _Instance,
    trajectory: _Trajectory,
    arm: _Arm = "",
    other: _Other = "",
    first: _First = "",
    steps: _Steps = 0,
    backwards: _Back = False,
    loop: _Loop = 1,
    to: Annotated[Path | None, typer.Option(help="Write it to this file, which must not be there yet.")] = None,
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Print the program that `run` would run, or save it as one of your own."""
    with the_robot(connect_to, keys) as robot:
        program = robot.expand_template(
            instance, trajectory, arm, other=other, first=first, steps=steps, backwards=backwards, loop=loop
        )
    if to is None:
        print(program.text, end="")
        return
    try:
        with to.open("x", encoding="utf-8") as file:
            file.write(program.text)
    except OSError as problem:
        fail(str(problem))
    bound = " ".join(f"--bind {name}={value}" for name, value in program.bindings.items())
    _out.print(f"{to}: handrail program run {to.stem} {bound}", markup=False, highlight=False, soft_wrap=True)


def _show(found: Reach) -> None:
    state = "" if found.settled else ", from where it was"
    _out.print(
        f"{found.instance} {found.trajectory}, {found.arm} arm (version {found.version}{state})", highlight=False
    )
    if found.problem:
        _out.print(f"  {found.problem}", style="red", markup=False, highlight=False, soft_wrap=True)
    for each in found.waypoints:
        _out.print(
            f"  {each.name:12} {each}", style=_COLOURS[each.state], markup=False, highlight=False, soft_wrap=True
        )
