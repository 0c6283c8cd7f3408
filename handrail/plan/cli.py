"""`handrail plan`: the plans that the engine has made, their figures, as a picture or as JSON."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from handrail.client import DEFAULT_ADDRESS
from handrail.messages import FrameGoal, PlanPreview, Pose, PostureGoal
from handrail.plan.words import asked_for, figure_of, value_of, worst_of
from handrail.robot_option import ConnectTo, Keys, fail, the_robot

app = typer.Typer(help="Look at plans.", no_args_is_help=True, add_completion=False)
_out = Console()
_err = Console(stderr=True)
_COLUMNS = {
    "residual": "off",
    "tilt": "tilt",
    "clearance": "clearance",
    "limit_margin": "limit margin",
    "torque_share": "torque",
}

_NUMBERS = {"ignore_unknown_options": True}
"""so that -0.3 is a number and no option"""

Plan = Annotated[str, typer.Argument(help="Its id, the end of one, `last`, or a file that `export` wrote.")]


@app.callback()
def _plan() -> None:
    """The plans of the robot that is up (docs/plans.md)."""


@app.command("list")
def list_(connect_to: ConnectTo = DEFAULT_ADDRESS, keys: Keys = None) -> None:
    """List the plans that are kept, oldest first, and why a stale one is stale."""
    with the_robot(connect_to, keys) as robot:
        plans = robot.snapshot().plans
    if not plans:
        _out.print("no plan was made yet")
        return
    table = Table("what", "arm", "s", "clearance", "limit margin", "torque", "", box=None)
    table.add_column("plan", no_wrap=True)
    for plan in plans:
        figures = [_worst(plan, measure) for measure in ("clearance", "limit_margin", "torque_share")]
        state = Text("fresh", "green") if plan.fresh else Text("stale", "red")
        table.add_row(plan.label, plan.arm, f"{plan.duration:.1f}", *figures, state, plan.id)
    _out.print(table)
    for plan in plans:
        if not plan.fresh:
            _out.print(f"{plan.id}: {plan.stale_because}", style="red", highlight=False, markup=False, soft_wrap=True)


@app.command()
def make(
    instance: Annotated[str, typer.Argument(help="A template's instance.")],
    trajectory: Annotated[str, typer.Argument(help="A trajectory of its template.")],
    arm: Annotated[
        str, typer.Option(help="Which arm; 'any': the first that can, in the order of `choices`.")
    ] = "right",
    arc: Annotated[float | None, typer.Option(help="rad around the joint, of `choices`; none: the planner's.")] = None,
    seen: Annotated[bool, typer.Option("--seen", help="Keep clear of what cameras see, too.")] = False,
    relax: Annotated[
        list[str] | None,
        typer.Option(help="What may give way where there is no plan, the first one first: tilt, reach."),
    ] = None,
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Plan a template's trajectory from where the robot is now, and show it. Nothing moves."""
    with the_robot(connect_to, keys) as robot:
        plan = robot.plan(instance, trajectory, "" if arm == "any" else arm, arc=arc, seen=seen, relax=relax or [])
        _show(robot.get_plan(plan.id, details=True))


@app.command()
def choices(
    instance: Annotated[str, typer.Argument(help="A template's instance.")],
    trajectory: Annotated[str, typer.Argument(help="A trajectory of its template; none: all.")] = "",
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Rank arms and places around the joint by how much of a behaviour they can do, then by how far the arm has to go."""
    with the_robot(connect_to, keys) as robot:
        found = robot.rank_choices(instance, trajectory)
    table = Table("trajectory", "arm", "arc", "feasible", "way", "lacks", box=None)
    for each in found:
        arc = "" if each.arc is None else f"{each.arc:.2f} rad"
        table.add_row(each.trajectory, each.arm, arc, f"{each.share:.0%}", f"{each.cost:.2f} rad", each.lacks)
    _out.print(table)


@app.command(context_settings=_NUMBERS)
def reach(
    arm: Annotated[str, typer.Argument(help="Which arm.")],
    x: Annotated[float, typer.Argument(help="m")],
    y: Annotated[float, typer.Argument(help="m")],
    z: Annotated[float, typer.Argument(help="m, of the tool's tip: in the world, or in an instance's frame.")],
    orientation: Annotated[
        tuple[float, float, float, float] | None,
        typer.Option("--orientation", help="x y z w, a unit quaternion; none: any."),
    ] = None,
    instance: Annotated[str, typer.Option(help="Whose frame it is said in; none: the world.")] = "",
    feature: Annotated[str, typer.Option(help="A joint of the instance's, or TRAJECTORY.WAYPOINT.")] = "",
    relax: Annotated[bool, typer.Option("--relax", help="As near as can be, where it is out of reach.")] = False,
    after: Annotated[str, typer.Option(help="Id of a plan from whose end; none: from where the robot is.")] = "",
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Plan a motion of an arm's tool tip to a place, and show it. Nothing moves."""
    goal = _tip_at((x, y, z), orientation, instance, feature)
    with the_robot(connect_to, keys) as robot:
        plan = robot.plan_motion([goal], arm, after=after, relax=["goals[0]"] if relax else [])
        _show(robot.get_plan(plan.id, details=True))


@app.command()
def posture(
    name: Annotated[str, typer.Argument(help="One of the robot's postures.")],
    arm: Annotated[str, typer.Option(help="Whose joints move.")] = "",
    joints: Annotated[list[str] | None, typer.Option(help="Joints or groups that move, in place of an arm's.")] = None,
    after: Annotated[str, typer.Option(help="Id of a plan from whose end; none: from where the robot is.")] = "",
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Plan a motion to a posture of the robot's, of all joints if neither arm nor joints are named. Nothing moves."""
    with the_robot(connect_to, keys) as robot:
        moving = joints or ([] if arm else robot.robot().joints)
        plan = robot.plan_motion([PostureGoal(name=name)], arm, joints=moving, after=after)
        _show(robot.get_plan(plan.id, details=True))


@app.command(context_settings=_NUMBERS)
def edit(
    x: Annotated[float, typer.Argument(help="m")],
    y: Annotated[float, typer.Argument(help="m")],
    z: Annotated[float, typer.Argument(help="m, of the tool's tip in the world.")],
    plan: Annotated[str, typer.Option(help="Its id, the end of one, or `last`.")] = "last",
    time: Annotated[float, typer.Option(min=0.0, help="s into the plan, where a key frame more goes.")] = 0.0,
    frame: Annotated[int, typer.Option(min=-1, help="Change this key frame, from 0, instead.")] = -1,
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Plan a motion to goals anew so that the tool's tip passes a place; later edits keep it. Nothing moves."""
    with the_robot(connect_to, keys) as robot:
        id = _id(plan, [each.id for each in robot.snapshot().plans])
        new = robot.edit_plan(id, [_tip_at((x, y, z))], time=time, frame=frame)
        _show(robot.get_plan(new.id, details=True))


def _tip_at(
    place: tuple[float, float, float],
    orientation: tuple[float, float, float, float] | None = None,
    instance: str = "",
    feature: str = "",
) -> FrameGoal:
    pose = Pose(position=place) if orientation is None else Pose(position=place, orientation=orientation)
    angle = math.pi if orientation is None else 0.0
    return FrameGoal(pose=pose, angle=angle, instance=instance, feature=feature)


@app.command()
def show(plan: Plan = "last", connect_to: ConnectTo = DEFAULT_ADDRESS, keys: Keys = None) -> None:
    """What a plan keeps on the way to each waypoint, the worst in red, and what it was made from."""
    _show(_found(plan, connect_to, keys))


@app.command()
def plot(
    plan: Plan = "last",
    png: Annotated[Path, typer.Option(help="The picture's file.", dir_okay=False)] = Path("plan.png"),
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Draw joints, clearance, margins, residual and torque over time, and the tool's way in space."""
    if not png.parent.is_dir():
        raise typer.BadParameter(f"got {png}; expected a file in a folder that exists", param_hint="--png")
    found = _found(plan, connect_to, keys)
    try:
        from handrail.plan.picture import draw

        draw(found, png)
    except ModuleNotFoundError as missing:
        fail(f"plots need the package {missing.name}: pip install 'handrail[sim]'")
    except (OSError, ValueError) as problem:
        fail(str(problem))
    _out.print(f"{png}: {found.label}, {found.id}", highlight=False, markup=False, soft_wrap=True)


@app.command()
def export(
    plan: Plan = "last",
    json: Annotated[Path | None, typer.Option(help="The file; none: standard output.", dir_okay=False)] = None,
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Write all that is known of a plan as JSON: knots, measures, what it was made from (SI units, radians)."""
    text = msgspec.json.format(msgspec.json.encode(_found(plan, connect_to, keys)), indent=1)
    if json is None:
        sys.stdout.buffer.write(text + b"\n")
        return
    try:
        json.write_bytes(text + b"\n")
    except OSError as problem:
        fail(str(problem))


def _found(plan: str, connect_to: str, keys: Path | None) -> PlanPreview:
    """A plan with its details, from the robot or from a file."""
    if plan.endswith(".json"):
        try:
            return msgspec.json.decode(Path(plan).read_bytes(), type=PlanPreview)
        except (OSError, msgspec.DecodeError) as problem:
            fail(f"{plan}: {problem}; expected a plan that `handrail plan export` wrote")
    with the_robot(connect_to, keys) as robot:
        return robot.get_plan(_id(plan, [each.id for each in robot.snapshot().plans]), details=True)


def _id(plan: str, known: list[str]) -> str:
    """The one plan that is meant; what fits none or several goes to the robot as it is, which says what there is."""
    if plan == "last" and known:
        return known[-1]
    fitting = [each for each in known if each == plan] or [each for each in known if each.endswith(plan)]
    return fitting[0] if len(fitting) == 1 else plan


def _worst(plan: PlanPreview, measure: str) -> str:
    waypoint = worst_of(plan, measure)
    return "–" if waypoint is None else figure_of(measure, value_of(waypoint, measure))


def _show(plan: PlanPreview) -> None:
    _out.print(
        f"{plan.label}, {plan.arm} arm, {plan.duration:.2f} s ({plan.id})", style="bold", highlight=False, markup=False
    )
    if plan.fresh:
        _out.print("fresh", style="green")
    else:
        _out.print(f"stale: {plan.stale_because}", style="red", highlight=False, markup=False, soft_wrap=True)
    table = Table("waypoint", "at, s", *_COLUMNS.values())
    worst = {measure: worst_of(plan, measure) for measure in _COLUMNS}
    for waypoint in plan.waypoints:
        cells = []
        for measure in _COLUMNS:
            style = "bold red" if waypoint is worst[measure] and len(plan.waypoints) > 1 else ""
            cells.append(Text(figure_of(measure, value_of(waypoint, measure)), style, justify="right"))
        table.add_row(waypoint.name, f"{waypoint.time:.2f}", *cells)
    _out.print(table)
    for measure, words in (
        ("clearance", "nearest"),
        ("limit_margin", "next to its limit"),
        ("torque_share", "works hardest"),
    ):
        if (at := worst[measure]) is not None:
            found = getattr(at, measure)
            line = f"{words}: {found.about}, {figure_of(measure, found.value)} at {found.time:.2f} s"
            _out.print(line, highlight=False, markup=False, soft_wrap=True)
    for gave in plan.gave:
        _out.print(
            f"gave way: {gave.goal}, {gave.what} by {gave.by:.3g} {gave.unit}", style="yellow", highlight=False,
            markup=False, soft_wrap=True,
        )  # fmt: skip
    if plan.key_times:
        passed = ", ".join(f"{number} at {time:.2f} s" for number, time in enumerate(plan.key_times))
        _out.print(f"passes key frames {passed}", highlight=False, markup=False, soft_wrap=True)
    if plan.origin is not None:
        _origin(plan)


def _origin(plan: PlanPreview) -> None:
    origin = plan.origin
    assert origin is not None
    lines = [f"asked for: {asked_for(origin)}{f' (run {origin.run})' if origin.run else ''}"]
    for instance in origin.instances:
        place = ", ".join(f"{value:.3f}" for value in instance.pose_in_world.position)
        sizes = ", ".join(f"{name} {value:g}" for name, value in instance.parameters.items())
        what = f"{instance.template} {instance.template_hash}"
        lines.append(f"from {instance.name}, version {instance.version}: {what} at ({place}) m, {sizes}")
    still = [joint for joint in origin.joints if joint not in plan.joints]
    lines.append(f"counts on {len(still)} other joints to stay: {', '.join(still)}" if still else "moves every joint")
    _out.print("\n".join(lines), highlight=False, markup=False, soft_wrap=True)
