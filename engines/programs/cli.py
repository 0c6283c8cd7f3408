"""`handrail program check|list|run|pause|...`: programs from the command line, over the same client API that the tablet uses."""

from __future__ import annotations

import contextlib
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from engines.programs import library
from engines.programs.program import Program
from handrail.client import DEFAULT_ADDRESS, Client, RefusedError
from handrail.config import ConfigError
from handrail.following import FOLLOWED, follow, on_failure
from handrail.messages import TaskCheck
from handrail.robot_option import ConnectTo, Keys, the_robot

app = typer.Typer(help="Check, list and run programs.", no_args_is_help=True, add_completion=False)
_out = Console()
_err = Console(stderr=True)


class Level(Enum):
    """Levels of autonomy."""

    OFF = "off"
    LOW = "low"
    HIGH = "high"
    FULL = "full"


@app.command()
def check(
    programs: Annotated[
        list[str] | None, typer.Argument(help="Names in the library, or files; none: the whole library.")
    ] = None,
    robot: Annotated[
        str | None, typer.Option(help="Rehearse them with this robot, at its home posture: every motion is planned.")
    ] = None,
    scene: Annotated[
        str | None, typer.Option(help="With --robot: what stands around, a scene whose objects templates know.")
    ] = None,
    bind: Annotated[list[str] | None, typer.Option(help="With --robot: resource=NAME.")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="With --robot: parameter=VALUE.")] = None,
) -> None:
    """Check programs whole, without a robot. Exits with 1 when one can't be deployed, naming file, line, field and expectation.

    With --robot, each is rehearsed as well: all its motions are planned and verified end to end, and the first that is infeasible
    is named. Nothing needs to run for that.
    """
    if robot is not None:
        raise typer.Exit(_rehearse(programs or sorted(library.files()), robot, scene, bind, set_))
    for option, value in {"--scene": scene, "--bind": bind, "--set": set_}.items():
        if value:
            raise typer.BadParameter("expected only with --robot", param_hint=option)
    wrong = False
    for name in programs or sorted(library.files()):
        try:
            program = library.load(name)
            _out.print(
                f"{program.name}: sound, {len(list(program.states()))} states, hash {program.hash}", highlight=False
            )
            if program.whole_because:
                told = f"  a process node carries it out whole, since no program can say that: {program.whole_because}"
                _out.print(told, markup=False, highlight=False, soft_wrap=True)
        except ConfigError as problem:
            wrong = True
            _err.print(str(problem), style="red", markup=False, highlight=False, soft_wrap=True)
    raise typer.Exit(int(wrong))


@app.command()
def show(
    program: Annotated[str, typer.Argument(help="Its name in the library, or its file.")],
    file: Annotated[
        Path | None, typer.Argument(help="Where to: .svg, .png, .pdf or .dot; NAME.svg if not given.")
    ] = None,
    expand: Annotated[bool, typer.Option("--expand", help="With the states of the programs that it runs.")] = False,
) -> None:
    """Draw a program as a statechart."""
    from engines.programs.picture import CanNotDraw, draw

    found = _loaded(program)
    file = file or Path(f"{found.name}.svg")
    try:
        draw(found, file, expand=expand)
    except (CanNotDraw, OSError) as problem:
        _err.print(str(problem), style="red", markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(1) from problem
    _out.print(str(file), highlight=False, soft_wrap=True)


@app.command()
def diff(
    old: Annotated[str, typer.Argument(help="A program's name in the library, or its file.")],
    new: Annotated[str, typer.Argument(help="Another one.")],
) -> None:
    """Tell what is different between two programs, field by field. Exits with 1 when something is."""
    from engines.programs.diff import differences

    lines = differences(_loaded(old), _loaded(new))
    for line in lines:
        style = {"+": "green", "-": "red", "~": "yellow"}[line[0]]
        _out.print(line, style=style, markup=False, highlight=False, soft_wrap=True)
    raise typer.Exit(int(bool(lines)))


@app.command()
def schema() -> None:
    """Print the JSON Schema of programs: an editor that knows it completes and checks while you write."""
    from engines.programs.call import SIGNATURES
    from engines.programs.schema import json_schema

    arguments = {
        name: {argument: each.required for argument, each in activity.arguments.items()}
        for name, activity in SIGNATURES.items()
    }
    _out.print_json(data=json_schema(arguments))


def _rehearse(names: list[str], robot: str, scene: str | None, bind: list[str] | None, given: list[str] | None) -> int:
    """Rehearse programs; 0 when all are feasible."""
    from engines.programs.offline import OfflineTask

    bindings = _pairs("--bind", bind)
    parameters = {name: _value(text) for name, text in _pairs("--set", given).items()}
    wrong = False
    try:
        task = OfflineTask(robot, scene)
        for name in names:
            checked = task.check(library.load(name), bindings, parameters)
            show_check(checked)
            wrong |= not checked.feasible
    except (ConfigError, RefusedError, ValueError) as problem:
        _err.print(str(problem), style="red", markup=False, highlight=False, soft_wrap=True)
        return 1
    return int(wrong)


def show_check(check: TaskCheck) -> None:
    """A rehearsal, for people."""
    table = Table("", "state", "does", "what", "s", "clearance", "to a limit")
    for number, step in enumerate(check.steps, 1):
        figures = [
            "" if value is None else f"{scale * value:.{digits}f}{unit}"
            for value, scale, digits, unit in (
                (step.duration, 1, 1, ""),
                (step.clearance, 1000, 0, " mm"),
                (step.limit_margin, 1, 2, " rad"),
            )
        ]
        what = f"[red]{escape(step.problem)}[/red]" if step.problem else escape(step.what)
        table.add_row(
            str(number), step.state, step.activity, f"{what} (not verified)" if step.unknown else what, *figures
        )
    _out.print(table)
    words = f"feasible: {check.detail}" if check.feasible else f"not feasible: {check.detail}"
    _out.print(f"{check.program} {check.hash}: {words}", highlight=False, markup=False, soft_wrap=True)


@app.command("list")
def list_(
    show: Annotated[str | None, typer.Argument(help="A program: show its resources and parameters.")] = None,
) -> None:
    """List the library's programs and templates, or what one program needs."""
    if show is not None:
        _describe(show)
        return
    table = Table("name", "kind", "title", "hash")
    for entry in library.listing().entries:
        title = f"[red]{entry.problem}[/red]" if entry.problem else entry.title
        table.add_row(entry.name, entry.kind, title, entry.hash)
    _out.print(table)


@app.command()
def run(
    program: Annotated[str, typer.Argument(help="Its name in the robot's library.")],
    bind: Annotated[
        list[str] | None, typer.Option(help="resource=NAME, e.g. --bind arm=right --bind valve=wheel_1")
    ] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", help="parameter=VALUE, e.g. --set goal_deg=180")] = None,
    check_first: Annotated[
        bool, typer.Option("--check", help="Rehearse it first, and run it only if all its motions are feasible.")
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Approve every prompt (its first option) without asking.")] = False,
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Deploy a program on a robot that is up, run it, and follow it to its end. Ctrl-C stops the run, at a prompt too.

    Exits with 0 when it succeeded, 1 when it failed or was refused, 130 when it was stopped.
    """
    bindings, given = _pairs("--bind", bind), _pairs("--set", set_)
    parameters = {name: _value(text) for name, text in given.items()}
    with the_robot(connect_to, keys) as robot:
        raise typer.Exit(_follow(robot, program, bindings, parameters, yes, check_first))


@app.command()
def pause(connect_to: ConnectTo = DEFAULT_ADDRESS, keys: Keys = None) -> None:
    """Pause the program that runs: the motion stops smoothly, nothing new begins."""
    with the_robot(connect_to, keys) as robot:
        robot.pause_run()


@app.command()
def resume(connect_to: ConnectTo = DEFAULT_ADDRESS, keys: Keys = None) -> None:
    """Let a paused program go on."""
    with the_robot(connect_to, keys) as robot:
        robot.resume_run()


@app.command()
def step(connect_to: ConnectTo = DEFAULT_ADDRESS, keys: Keys = None) -> None:
    """Let a paused program go on until its next activity is about to begin."""
    with the_robot(connect_to, keys) as robot:
        robot.step_run()


@app.command("break")
def break_(
    states: Annotated[list[str] | None, typer.Argument(help="States before which to pause; none: nowhere.")] = None,
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Set breakpoints, instead of those that there are: the program pauses before what these states do."""
    with the_robot(connect_to, keys) as robot:
        robot.set_breakpoints(states or [])


@app.command()
def skip(
    state: Annotated[str, typer.Argument(help="An active state.")],
    way: Annotated[int | None, typer.Option(help="Index of the transition to take instead, as in the file.")] = None,
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Leave a state as though it were done, or by the way that is given, whatever its guard says."""
    with the_robot(connect_to, keys) as robot:
        robot.skip(state) if way is None else robot.take_transition(state, way)


@app.command()
def fail(
    state: Annotated[str, typer.Argument(help="A state that waits for help, since what it does has failed.")],
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Let the program go on as it says where a state fails, instead of waiting for help."""
    with the_robot(connect_to, keys) as robot:
        robot.let_fail(state)


@app.command()
def end(connect_to: ConnectTo = DEFAULT_ADDRESS, keys: Keys = None) -> None:
    """End the program that runs: its motion is cancelled, the robot holds."""
    with the_robot(connect_to, keys) as robot:
        robot.stop_run()


@app.command("from")
def from_(
    state: Annotated[str, typer.Argument(help="The state to begin in.")],
    paused: Annotated[bool, typer.Option("--paused", help="Wait before what it does.")] = False,
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Run the last program anew from a state, with what it remembers."""
    with the_robot(connect_to, keys) as robot:
        _out.print(robot.run_from(state, paused=paused).run, highlight=False)


@app.command("set")
def set_parameters(
    values: Annotated[list[str], typer.Argument(help="parameter=VALUE")],
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Change parameters of the program that runs: each counts from its next use."""
    with the_robot(connect_to, keys) as robot:
        robot.set_run_parameters({name: _value(text) for name, text in _pairs("values", values).items()})


@app.command()
def autonomy(
    level: Annotated[Level, typer.Argument()], connect_to: ConnectTo = DEFAULT_ADDRESS, keys: Keys = None
) -> None:
    """Set how much programs do without asking: transitions that name this level or one above it are asked about first."""
    with the_robot(connect_to, keys) as robot:
        robot.set_autonomy(level.value)


@app.command()
def history(connect_to: ConnectTo = DEFAULT_ADDRESS, keys: Keys = None) -> None:
    """Show what the last run went through: states, how long each lasted, what ended it."""
    with the_robot(connect_to, keys) as robot:
        found = robot.run_history()
    table = Table("at", "state", "lasted", "ended by", title=found.run)
    start = found.visits[0].entered_ns if found.visits else 0
    for visit in found.visits:
        lasted = f"{(visit.left_ns - visit.entered_ns) / 1e9:.2f} s" if visit.left_ns else "active"
        table.add_row(f"{(visit.entered_ns - start) / 1e9:.2f} s", visit.state, lasted, visit.event)
    _out.print(table)


def _follow(
    robot: Client, program: str, bindings: dict[str, str], parameters: dict[str, object], yes: bool, check_first: bool
) -> int:
    with robot.events(*FOLLOWED) as events:
        deployed = robot.deploy(program, bindings, parameters)
        if check_first:
            checked = robot.check_task(deployed)
            show_check(checked)
            if not checked.feasible:
                return 1
        return follow(robot, events, robot.run(deployed, on_failure=on_failure(yes)), yes=yes)


def _pairs(option: str, texts: list[str] | None) -> dict[str, str]:
    pairs = {}
    for text in texts or []:
        name, sign, value = text.partition("=")
        if not (name and sign and value):
            raise typer.BadParameter(f"got {text!r}; expected NAME=VALUE", param_hint=option)
        pairs[name] = value
    return pairs


def _value(text: str) -> object:
    """A parameter's value as written: a number, true or false, else a text."""
    if text in ("true", "false"):
        return text == "true"
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            return kind(text)
    return text


def _loaded(name: str) -> Program:
    try:
        return library.load(name)
    except ConfigError as problem:
        _err.print(str(problem), style="red", markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(1) from problem


def _describe(name: str) -> None:
    program = _loaded(name)
    _out.print(f"{program.title} ({program.name}, {program.hash})", style="bold", highlight=False)
    table = Table("", "name", "default", "unit", "what it is")
    for key, resource in program.resources.items():
        table.add_row("--bind", key, "", " or ".join(resource.templates) or resource.kind, resource.title)
    for key, parameter in program.parameters.items():
        table.add_row("--set", key, str(parameter.default), parameter.unit, parameter.title)
    _out.print(table)
