"""`handrail template`: templates looked at, checked, drawn, begun, brought in from elsewhere."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from affordance_templates import authoring_cli, catalogue, running_cli, template_file
from affordance_templates.template import ResolvedTemplate, ResolvedTrajectory
from affordance_templates.template_file import Template
from affordance_templates.template_schema import json_schema
from handrail.config import ConfigError

app = typer.Typer(
    help="Affordance templates: look at them, check, draw, begin, import, teach, run them; what of them can be reached.",
    no_args_is_help=True,
)
app.command()(authoring_cli.new)
app.command("import")(authoring_cli.import_)
app.command()(authoring_cli.record)
app.command()(authoring_cli.save)
app.command()(running_cli.reach)
app.command()(running_cli.run)
app.command()(running_cli.expand)
_out = Console()

_Name = Annotated[str, typer.Argument(help="A template of the library, or a file.")]
_Set = Annotated[list[str] | None, typer.Option("--set", help="PARAMETER=VALUE, as often as you like.")]
_Joint = Annotated[list[str] | None, typer.Option("--joint", help="JOINT=POSITION, rad or m.")]


def load(name_or_file: str) -> Template:
    """A template by name or by file. Raises ConfigError."""
    if name_or_file.endswith((".yaml", ".yml")):
        return template_file.read(Path(name_or_file))
    return catalogue.load(name_or_file)


def numbers(option: str, given: list[str] | None) -> dict[str, float]:
    """NAME=NUMBER each. Raises ValueError naming the option."""
    found = {}
    for text in given or []:
        name, _, value = text.partition("=")
        try:
            found[name] = float(value)
        except ValueError:
            raise ValueError(f"{option}: got {text!r}; expected NAME=NUMBER") from None
    return found


def resolved(name: str, given: list[str] | None, joints: list[str] | None) -> tuple[Template, ResolvedTemplate]:
    """A template with what was given on the command line. Raises ValueError (ConfigError among it)."""
    template = load(name)
    state = numbers("--joint", joints)
    found = template.resolve(numbers("--set", given), state)
    for joint in state:
        if joint not in found.joints:
            raise ValueError(f"--joint: got {joint!r}; expected one of {', '.join(found.joints) or 'none'}")
    return template, found


@app.command("list")
def list_() -> None:
    """Templates of the library and of the workspace, and what is wrong with those that can't be used."""
    table = Table("template", "title", "trajectories", box=None)
    for name, file in sorted(catalogue.files().items()):
        try:
            template = template_file.read(file)
            table.add_row(name, template.title, ", ".join(template.trajectories))
        except ConfigError as problem:
            table.add_row(name, Text(str(problem), "red"), "")
    _out.print(table)


@app.command()
def check(names: Annotated[list[str], typer.Argument(help="Templates of the library, or files.")]) -> None:
    """Read templates; resolve each at every bound of its parameters. Exits 1 when one is wrong."""
    wrong = False
    for name in names:
        try:
            template = load(name)
            count = sum(1 for _ in corners(template))
            _out.print(f"{name}: sound, with defaults and at {count} bounds of its parameters", highlight=False)
        except ValueError as problem:
            wrong = True
            told = str(problem)
            _out.print(
                told if told.startswith(name) else f"{name}: {told}",
                style="red",
                markup=False,
                highlight=False,
                soft_wrap=True,
            )
    sys.exit(wrong)


def corners(template: Template) -> list[dict[str, float]]:
    """Each parameter at each of its bounds, the others at their defaults. Raises ValueError saying at which it does not resolve."""
    found = []
    for name, parameter in template.parameters.items():
        for value in parameter.choices or (parameter.min, parameter.max):
            if math.isfinite(value):
                try:
                    template.resolve({name: value})
                except ValueError as problem:
                    raise ValueError(f"with {name} {value:g}: {problem}") from problem
                found.append({name: value})
    return found


@app.command()
def show(name: _Name, set_: _Set = None, joint: _Joint = None) -> None:
    """Parameters, objects, joints, features and trajectories, with numbers."""
    try:
        template, found = resolved(name, set_, joint)
        values = template.values(numbers("--set", set_))
    except ValueError as problem:
        sys.exit(f"handrail template show: {problem}")
    _out.print(f"[bold]{template.title}[/bold] ({template.name}, {template.hash})")
    if template.file.description:
        _out.print(template.file.description)
    table = Table("parameter", "value", "unit", "from", "to", "what", box=None)
    for parameter, each in template.parameters.items():
        bounds = (f"{each.min:g}", f"{each.max:g}")
        if each.choices:
            bounds = ("", " or ".join(f"{choice:g}" for choice in each.choices))
        table.add_row(parameter, f"{values[parameter]:g}", each.unit, *bounds, each.title)
    _out.print(table)
    table = Table("object", "where", "shapes", box=None)
    for thing, frame in found.objects.items():
        kinds = [shape.kind for shape in found.shapes if shape.object == thing]
        table.add_row(thing, _place(frame[:3, 3]), ", ".join(f"{kinds.count(k)} {k}" for k in dict.fromkeys(kinds)))
    _out.print(table)
    if found.joints:
        table = Table("joint", "kind", "at", "from", "to", "axis", box=None)
        for each_joint in found.joints.values():
            row = (
                f"{each_joint.position:g}",
                f"{each_joint.lower:g}",
                f"{each_joint.upper:g}",
                _place(each_joint.axis),
            )
            table.add_row(each_joint.name, each_joint.kind, *row)
        _out.print(table)
    for feature in found.features.values():
        brackets = f"[{', '.join(f'0..{count - 1}' for count in feature.indices)}]" if feature.indices else ""
        brackets = brackets or (f"({', '.join(feature.arguments)})" if feature.arguments else "")
        _out.print(f"feature {feature.name}{brackets}: {feature.kind}", markup=False, highlight=False)
    for trajectory in found.trajectories.values():
        _show_trajectory(trajectory)
    for sync in found.syncs.values():
        _out.print(f"sync {sync.name}: {' with '.join(sync.trajectories)}, {len(sync.points)} points", markup=False)


def _show_trajectory(trajectory: ResolvedTrajectory) -> None:
    side = f", written for the {trajectory.side}" if trajectory.side else ""
    _out.print(f"\ntrajectory {trajectory.name} of {trajectory.hand}{side}", markup=False, highlight=False)
    table = Table("waypoint", "approach", "where", "points", "hand", "more", box=None)
    for each in trajectory.waypoints:
        more = [f"{each.joint} to {each.to if isinstance(each.to, str) else f'{each.to:.3g}'}"] if each.joint else []
        more += [f"until {each.until:g} N"] if each.until else []
        more += [f"at most {each.speed:g} m/s"] if each.speed else []
        table.add_row(
            each.name, each.approach, _place(each.position), _place(each.axis), each.hand_pose, ", ".join(more)
        )
    _out.print(table)


def _place(vector: object) -> str:
    return " ".join(f"{0.0 if abs(part) < 5e-4 else part:.3f}" for part in vector)  # type: ignore[attr-defined]


@app.command()
def schema() -> None:
    """Print the JSON Schema of templates: an editor that knows it completes and checks while you write."""
    _out.print_json(data=json_schema())


@app.command()
def render(
    name: _Name,
    trajectory: Annotated[
        list[str] | None, typer.Option(help="Whose waypoints to draw; left out: the first one's.")
    ] = None,
    set_: _Set = None,
    joint: _Joint = None,
    yaw: Annotated[float, typer.Option(help="deg, where the eye stands about the template's z, from its x.")] = -140.0,
    png: Annotated[Path | None, typer.Option(help="Default: NAME.png.")] = None,
) -> None:
    """A picture of a template: solids, joints' axes, the hand at every waypoint."""
    from PIL import Image

    from affordance_templates import picture

    try:
        template, found = resolved(name, set_, joint)
        drawn = trajectory or list(found.trajectories)[:1]
        image = picture.render(found, drawn, yaw=yaw)
    except ValueError as problem:
        sys.exit(f"handrail template render: {problem}")
    file = png or Path(f"{template.name}.png")
    Image.fromarray(image).save(file, format="PNG")
    _out.print(f"{file}: {template.title}, {', '.join(drawn) or 'no trajectory'}", markup=False, highlight=False)
