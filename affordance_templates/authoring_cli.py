"""`handrail template new | import | record | save`: templates begun, brought in, taught by the robot that is up."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console

from affordance_templates import authoring, catalogue, importing
from affordance_templates.instance import Instance
from affordance_templates.placement import of_message, placed
from handrail import new as beginnings
from handrail.client import DEFAULT_ADDRESS, Client, RefusedError, Unreachable, connect
from handrail.link.keys import KeysError
from handrail.messages import InstanceState, RobotState
from handrail.robot import library as robots
from handrail.robot.description import Arm
from handrail.robot_option import ConnectTo, Keys

_out, _err = Console(), Console(stderr=True)

_To = Annotated[
    Path | None, typer.Option("--to", help="File; left out: NAME.yaml in the workspace's affordance_templates.")
]
_STATE_WITHIN = 5.0  # s


def new(name: Annotated[str, typer.Argument(help="What to call it.")], like: str = "box") -> None:
    """Begin a template of your own as a copy of one that is there."""
    beginnings.begin("template", name, like)


def import_(
    file: Annotated[Path, typer.Argument(help="OTDF (.otdf, .xml), or NASA's affordance template (.atdf, .json).")],
    name: Annotated[str, typer.Option(help="What to call it; left out: as the file.")] = "",
    to: _To = None,
) -> None:
    """Make a template of somebody else's, and list what has no counterpart."""
    with _problems("import"):
        found = importing.read(file)
        target = to or authoring.own_file(name or file.stem)
        template = authoring.with_meshes(found.text, target, found.meshes)
    counts = (
        f"{len(template.objects)} objects, {len(template.joints)} joints, {len(template.trajectories)} trajectories"
    )
    _out.print(f"{target}: {counts}", highlight=False, markup=False, soft_wrap=True)
    for line in found.left_out:
        _out.print(f"left out: {line}", highlight=False, markup=False, soft_wrap=True)


def record(
    instance: Annotated[str, typer.Argument(help="An instance that is placed.")],
    trajectory: Annotated[str, typer.Argument(help="Of its template; one that is not there begins.")],
    waypoint: Annotated[str, typer.Argument(help="The new waypoint's name; it comes last.")],
    arm: Annotated[str, typer.Option(help="Whose tip is there now.")],
    frame: Annotated[str, typer.Option(help="Feature or object that it is said in; left out: the template.")] = "",
    approach: str = "straight",
    hand_pose: str = "",
    to: _To = None,
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Record the robot's present pose as a waypoint, in the template's own file if that is in the workspace."""
    with _problems("record"), connect(connect_to, keys) as robot:
        placed_one = instance_of(robot, instance)
        row = authoring.recorded(
            placed_one,
            *_tip(robot, arm),
            name=waypoint,
            frame=frame,
            approach=approach,
            hand_pose=hand_pose,
        )
        target = to or authoring.own_file(placed_one.template.name)
        template = placed_one.template
        if target.is_file():
            draft = authoring.Draft(target.read_bytes().decode("utf-8"), target)
        else:
            draft = authoring.Draft.of(template)
        draft.add_waypoint(trajectory, row)
        draft.save(target)
    where = ", ".join(f"{part:g}" for part in row["position"])
    _out.print(
        f"{target}: {trajectory}.{waypoint} at {where} m of {frame or 'the template'}", highlight=False, markup=False
    )


def save(
    instance: Annotated[str, typer.Argument(help="An instance that is placed.")],
    name: Annotated[str, typer.Argument(help="What to call the template.")],
    to: _To = None,
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Save an instance as a template of your own: its parameters' values are the defaults."""
    with _problems("save"), connect(connect_to, keys) as robot:
        target = to or authoring.own_file(name)
        authoring.saved_as(instance_of(robot, instance), target)
    _out.print(f"{target}: as {instance} stands", highlight=False, markup=False)


def instance_of(robot: Client, name: str) -> Instance:
    """An instance of the template as it is here, where the robot has it; a note where the robot has another version of it, as it
    has once something was recorded. Raises ValueError for one that is not placed, or whose parameters don't fit.
    """
    states: dict[str, InstanceState] = {state.name: state for state in robot.instances()}
    if name not in states:
        raise ValueError(f"instance: got {name!r}; expected one of {', '.join(states) or 'none: place one first'}")
    state = states[name]
    template = catalogue.load(state.template)
    if template.hash != state.template_hash:
        _err.print(f"{name}: the robot has another version of {state.template}; taken as it is here", highlight=False)
    parameters = template.values(state.parameters)
    return Instance(name, template, state.pose_in_world, parameters, state.joint_state, state.version)


def _tip(robot: Client, arm: str) -> tuple[Arm, np.ndarray]:
    """An arm, and where its tip is now in the world, (4, 4). Raises ValueError."""
    from handrail.robot.kinematics import Kinematics

    info = robot.robot()
    description = robots.load(info.name)
    if arm not in description.arms:
        raise ValueError(f"arm: got {arm!r}; expected one of {', '.join(description.arms)}")
    with contextlib.closing(robot.events(RobotState)) as events:
        state = events.next(_STATE_WITHIN)
    if state is None:
        raise ValueError(f"the robot told no state within {_STATE_WITHIN:g} s; expected its daemon to run")
    at = dict(zip(info.joints, state.position, strict=True))
    position = np.array([at[joint] for joint in description.joints])
    tip = Kinematics(description).frame(position, description.arms[arm].tip)
    return description.arms[arm], of_message(state.base_in_world) @ placed(tip.translation, tip.rotation)


@contextlib.contextmanager
def _problems(verb: str) -> Iterator[None]:
    """What goes wrong, as a line and exit status 1."""
    try:
        yield
    except (ValueError, OSError, RefusedError, Unreachable, KeysError) as problem:
        sys.exit(f"handrail template {verb}: {problem}")
