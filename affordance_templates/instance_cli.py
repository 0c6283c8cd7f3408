"""`handrail instance`: templates placed in the robot's world, edited together with other operators."""

from __future__ import annotations

import contextlib
import datetime
import time
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from affordance_templates.cli import numbers
from affordance_templates.placement import of_message, placed, rotation_of, rpy_of, to_message
from handrail.client import DEFAULT_ADDRESS
from handrail.messages import InstanceEdit, InstanceState, Pose
from handrail.robot_option import ConnectTo, Keys, fail, the_robot

app = typer.Typer(
    help="Templates in the robot's world: place, move, change, attach, hold them, undo.",
    no_args_is_help=True,
    add_completion=False,
)
_out = Console()
_RENEWED_S = 0.5
_NUMBERS = {"ignore_unknown_options": True}
"""so that -0.3 is a number and no option"""

_Name = Annotated[str, typer.Argument(help="An instance's name.")]
_Set = Annotated[list[str] | None, typer.Option("--set", help="PARAMETER=VALUE, as often as you like.")]
_Rpy = Annotated[
    tuple[float, float, float] | None,
    typer.Option("--rpy", help="Roll, pitch and yaw in degrees, about the world's fixed x, y, z."),
]


@app.callback()
def _instance() -> None:
    """The instances of the robot that is up (docs/templates.md). You are known by your key's name."""


@app.command("list")
def list_(connect_to: ConnectTo = DEFAULT_ADDRESS, keys: Keys = None) -> None:
    """List all: where they stand, what they go along with, who placed, edited and holds them."""
    with the_robot(connect_to, keys) as robot:
        found = robot.instances()
    if not found:
        _out.print("none is placed yet")
        return
    table = Table("instance", "template", "version", "x y z m", "r p y °", "goes along with", "", box=None)
    for each in found:
        table.add_row(each.name, each.template, str(each.version), *_where(each), _along(each), _history(each))
    _out.print(table)


@app.command(context_settings=_NUMBERS)
def place(
    name: Annotated[str, typer.Argument(help="A new name.")],
    template: Annotated[str, typer.Argument(help="A template of the library (`handrail template list`).")],
    x: Annotated[float, typer.Argument(help="m")],
    y: Annotated[float, typer.Argument(help="m")],
    z: Annotated[float, typer.Argument(help="m, in the world.")],
    rpy: _Rpy = None,
    set_: _Set = None,
    source: Annotated[str, typer.Option(help="What it was made from, for people.")] = "",
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Put a template into the world."""
    with the_robot(connect_to, keys) as robot:
        parameters = numbers("--set", set_)
        _show(robot.place_instance(name, template, _pose((x, y, z), rpy), parameters, source=source))


@app.command()
def move(
    name: _Name,
    position: Annotated[
        tuple[float, float, float] | None, typer.Option("--position", help="x y z, m in the world; left out: stays.")
    ] = None,
    rpy: _Rpy = None,
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Give an instance another position, another orientation, or both; plans made from it become stale."""
    if position is None and rpy is None:
        fail("move: got neither --position nor --rpy; expected at least one")
    with the_robot(connect_to, keys) as robot:
        turned = None if rpy is None else _pose((0.0, 0.0, 0.0), rpy).orientation
        _told(robot.edit_instance(name, position=position, orientation=turned))


@app.command("set")
def set_parameters(
    name: _Name,
    parameters: Annotated[list[str] | None, typer.Argument(help="PARAMETER=VALUE each.")] = None,
    joint: Annotated[list[str] | None, typer.Option("--joint", help="JOINT=POSITION, rad or m.")] = None,
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Change parameters, or say where joints are; plans made from the instance become stale."""
    with the_robot(connect_to, keys) as robot:
        given, joints = numbers("PARAMETER=VALUE", parameters), numbers("--joint", joint)
        if not given and not joints:
            raise ValueError("set: got nothing to change; expected PARAMETER=VALUE or --joint JOINT=POSITION")
        _told(robot.edit_instance(name, parameters=given, joints=joints))


@app.command()
def attach(
    name: _Name,
    link: Annotated[str, typer.Option(help="A link of the robot: it goes along with the measured joints.")] = "",
    instance: Annotated[str, typer.Option(help="Another instance.")] = "",
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Have an instance go along with a link or another instance; with neither it stands in the world."""
    with the_robot(connect_to, keys) as robot:
        _told(robot.attach_instance(name, link=link, instance=instance))


@app.command()
def hold(name: _Name, connect_to: ConnectTo = DEFAULT_ADDRESS, keys: Keys = None) -> None:
    """Hold an instance until Ctrl-C: nobody else may move or remove it, and all that you do to it is one step to undo."""
    with the_robot(connect_to, keys) as robot:
        held = robot.hold_instance(name)
        _out.print(f"{name}: held by {held.held_by}; Ctrl-C lets it go", highlight=False, markup=False)
        try:
            while True:
                time.sleep(_RENEWED_S)
                robot.hold_instance(name)
        except KeyboardInterrupt:
            with contextlib.suppress(KeyboardInterrupt):
                robot.release_instance(name)


@app.command()
def undo(connect_to: ConnectTo = DEFAULT_ADDRESS, keys: Keys = None) -> None:
    """Take back the last thing that you did to any instance; what others have changed since stays."""
    with the_robot(connect_to, keys) as robot:
        _told(robot.undo_instances())


@app.command()
def redo(connect_to: ConnectTo = DEFAULT_ADDRESS, keys: Keys = None) -> None:
    """Do again what you took back last."""
    with the_robot(connect_to, keys) as robot:
        _told(robot.redo_instances())


@app.command()
def remove(name: _Name, connect_to: ConnectTo = DEFAULT_ADDRESS, keys: Keys = None) -> None:
    """Take an instance away."""
    with the_robot(connect_to, keys) as robot:
        robot.remove_instance(name)


def _pose(position: tuple[float, float, float], rpy: tuple[float, float, float] | None) -> Pose:
    turned = rotation_of(np.radians(rpy or (0.0, 0.0, 0.0)))
    return to_message(placed(np.array(position), turned))


def _where(state: InstanceState) -> tuple[str, str]:
    angles = np.degrees(rpy_of(of_message(state.pose_in_world)[:3, :3])).round(1) + 0.0  # no -0.0
    return " ".join(f"{each:.3f}" for each in state.pose_in_world.position), " ".join(f"{each:.1f}" for each in angles)


def _along(state: InstanceState) -> str:
    to = state.attachment
    return "" if to is None else f"link {to.link}" if to.link else to.instance


def _history(state: InstanceState) -> str:
    came, words = state.provenance, []
    if came.placed_by:
        words.append(f"placed by {came.placed_by} {_ago(came.placed_at)}" + (f" ({came.source})" * bool(came.source)))
    if came.edited_by:
        words.append(f"edited by {came.edited_by} {_ago(came.edited_at)}")
    if state.held_by:
        words.append(f"held by {state.held_by}")
    return ", ".join(words)


def _ago(utc: float) -> str:
    return datetime.datetime.fromtimestamp(utc, datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")


def _show(state: InstanceState) -> None:
    position, angles = _where(state)
    values = ", ".join(f"{name} {value:g}" for name, value in {**state.parameters, **state.joint_state}.items())
    along = _along(state)
    words = f"{state.name}, version {state.version}: at {position} m, {angles}°" + (f", on {along}" if along else "")
    _out.print(f"{words}; {values}" if values else words, highlight=False, markup=False, soft_wrap=True)


def _told(edit: InstanceEdit) -> None:
    """What came of an edit. Exits with 1 where nothing of what was to go back could."""
    if edit.instance is not None:
        _show(edit.instance)
    else:
        _out.print(f"{edit.name} is not there any more", highlight=False, markup=False)
    for field, who in edit.overwrote.items():
        _out.print(f"{field}: replaced a newer value of {who}", style="yellow", highlight=False, markup=False)
    for field, why in edit.left.items():
        _out.print(f"{field} stays: {why}", style="yellow", highlight=False, markup=False, soft_wrap=True)
    if edit.left and not edit.fields:
        raise typer.Exit(1)
