"""`handrail drives ...`: drive families and their references, and the parameters of a robot's drives."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Column, Table

from hal.drives import docs as references
from hal.drives import family as families
from hal.drives.lifecycle import DriveError
from hal.drives.parameters import DICTIONARY, Parameter, find
from handrail.config import ConfigError

app = typer.Typer(help="Drive families and drives.", no_args_is_help=True, add_completion=False)

_ROBOT = typer.Option("--robot", help="The robot's name or folder.", show_default="the one that is up")
_RUNTIME = typer.Option(help="The robot's runtime folder.", show_default="$HANDRAIL_RUNTIME, else this user's")
_INFO = (
    Parameter.PROTOCOL_VERSION, Parameter.FIRMWARE_VERSION, Parameter.SERIAL, Parameter.BUS_VOLTAGE,
    Parameter.MOTOR_TEMPERATURE, Parameter.MOTOR_CURRENT,
)  # fmt: skip


@app.callback()
def _group() -> None:
    """Look at drive families, and at the drives of a robot that is up."""


@app.command("list")
def list_families() -> None:
    """All drive families there are, a user's own (in the workspace's folder `drives`) first. Exit status 1: one can't be read."""
    table, wrong = (
        Table(Column("family", no_wrap=True), "serves", "what", "messages", Column("from", overflow="fold")),
        [],
    )
    for name in sorted(families.folders()):
        try:
            made = families.load(name)
        except ConfigError as error:
            table.add_row(name, "", "[red]can't be read[/]", "", str(families.folders()[name]))
            wrong.append(f"handrail drives list: {error}")
        else:
            roles = ", ".join(role.name.lower() for role in sorted(made.messages))
            table.add_row(name, made.serves, made.title, roles, str(made.folder))
    Console().print(table)
    if wrong:
        sys.exit("\n".join(wrong))


@app.command()
def docs(
    family: Annotated[str, typer.Argument(help="A family, as `handrail drives list` names them.")],
    write: Annotated[bool, typer.Option("--write", help="Into docs/reference of this repository.")] = False,
) -> None:
    """The reference of a family as Markdown: every message, signal and meaning."""
    try:
        text = references.reference(families.load(family))
    except ConfigError as error:
        sys.exit(f"handrail drives docs: {error}")
    if write:
        file = references.reference_file(family)
        file.parent.mkdir(exist_ok=True)
        file.write_text(text, encoding="utf-8")
        print(file)
    else:
        sys.stdout.write(text)


@app.command()
def types(
    family: Annotated[str, typer.Argument(help="A family, as `handrail drives list` names them.")],
    out: Annotated[Path | None, typer.Option(help="Into this file instead.", dir_okay=False)] = None,
) -> None:
    """A family's messages as Python classes, for editors and type checkers: print the module, or write it.

    hal.drives.typed.messages(FAMILY) makes the same while a program runs. Exit status 1: no such family, or the file can't be
    written.
    """
    from hal.drives.typed_source import source

    try:
        text = source(families.load(family))
        if out is None:
            sys.stdout.write(text)
        else:
            out.write_text(text, encoding="utf-8")
            print(out)
    except (ConfigError, OSError, ValueError) as error:
        sys.exit(f"handrail drives types: {error}")


@app.command()
def get(
    joint: Annotated[str, typer.Argument(help="A joint.")],
    parameter: Annotated[str, typer.Argument(help="A parameter's name or index.")],
    robot: Annotated[str | None, _ROBOT] = None,
    runtime: Annotated[Path | None, _RUNTIME] = None,
) -> None:
    """Read one parameter of one drive. Exit status 1: refused, or no answer."""
    with _client("get", robot, runtime, joint) as (client, row, _):
        index = find(parameter)
        print(f"{client.read(row, index):.9g} {DICTIONARY[index].unit}".rstrip())


@app.command("set")
def set_value(
    joint: Annotated[str, typer.Argument(help="A joint.")],
    parameter: Annotated[str, typer.Argument(help="A parameter's name or index.")],
    value: Annotated[float, typer.Argument(help="In the parameter's unit.")],
    robot: Annotated[str | None, _ROBOT] = None,
    runtime: Annotated[Path | None, _RUNTIME] = None,
) -> None:
    """Write one parameter of one drive, until it loses power; prints what the drive made of it. Exit status 1: refused."""
    with _client("set", robot, runtime, joint) as (client, row, _):
        index = find(parameter)
        if index is Parameter.INJECT_ERROR:
            DriveError(int(value))
        print(f"{client.write(row, index, value):.9g} {DICTIONARY[index].unit}".rstrip())


@app.command()
def info(
    robot: Annotated[str | None, _ROBOT] = None,
    runtime: Annotated[Path | None, _RUNTIME] = None,
) -> None:
    """What every drive says of itself. Exit status 1: one does not answer, or speaks another version of its protocol."""
    table, wrong = (
        Table(Column("joint", no_wrap=True), "family", *map(_heading, _INFO), box=None, padding=(0, 1, 0, 0)),
        [],
    )
    with _client("info", robot, runtime, None) as (client, _, protocol):
        from hal.drives.parameter_client import ParameterError

        for row, joint in enumerate(protocol.joints):
            expected = int(protocol.protocol_version[row])
            if not expected:
                table.add_row(joint, protocol.program.joint_family[row], *["–"] * len(_INFO))
                continue
            try:
                values = [client.read(row, parameter) for parameter in _INFO]
            except ParameterError as error:
                wrong.append(str(error))
                continue
            if values[0] != expected:
                wrong.append(f"{joint}: protocol version {values[0]:g}; expected {expected}")
            # Measurements have a unit and a few digits that matter; versions and serial numbers are whole.
            measured = [bool(DICTIONARY[parameter].unit) for parameter in _INFO]
            shown = [f"{v:.2f}" if unit else f"{v:.9g}" for v, unit in zip(values, measured, strict=True)]
            table.add_row(joint, protocol.program.joint_family[row], *shown)
    Console().print(table)
    if wrong:
        sys.exit("\n".join(f"handrail drives info: {line}" for line in wrong))


def _heading(parameter: Parameter) -> str:
    words, unit = parameter.name.lower().split("_"), DICTIONARY[parameter].unit
    return f"{words[0]} {unit}" if unit else " ".join(words)


@contextlib.contextmanager
def _client(verb: str, robot: str | None, runtime: Path | None, joint: str | None) -> Iterator[tuple]:
    """(ParameterClient, row of the joint, protocol) on the buses of a robot that is up."""
    from hal.can.port import BusLost, open_port
    from hal.drives.parameter_client import ParameterClient
    from hal.drives.protocol import LimbProtocol
    from handrail.robot import library as robots
    from handrail.runtime import Runtime

    try:
        place = Runtime.at(runtime, make=False)
        description = robots.load(robot or place.robot_up("name the robot of these buses (--robot)"))
        if joint is not None and joint not in description.joints:
            raise ValueError(f"joint {joint}: not on this robot; expected one of {', '.join(description.joints)}")
        protocol = LimbProtocol(description)
        port = open_port(description, place, timeout_s=1.0, name=f"drives {verb}")
        with contextlib.closing(port):
            yield ParameterClient(port, protocol), description.index(joint) if joint else -1, protocol
    except (BusLost, OSError, ValueError) as error:
        sys.exit(f"handrail drives {verb}: {error}")


if __name__ == "__main__":
    app()
