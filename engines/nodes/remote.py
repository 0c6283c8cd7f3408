"""`handrail node running|start|put|reload|stop|watch`: the nodes of the engine of a robot that is up."""

from __future__ import annotations

import contextlib
import json
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from handrail.client import DEFAULT_ADDRESS
from handrail.robot_option import ConnectTo, Keys, the_robot

_out = Console()
_err = Console(stderr=True)

Running = Annotated[str, typer.Argument(help="What it is called where it runs.")]
Set = Annotated[list[str] | None, typer.Option("--set", help="parameter=VALUE")]
Given = Annotated[list[str] | None, typer.Option("--input", help="input=VALUE, as JSON; a text as it is.")]


def add_to(app: typer.Typer) -> None:
    """Add the verbs."""
    for verb in (running, start, put, reload, stop, watch):
        app.command()(verb)


def running(connect_to: ConnectTo = DEFAULT_ADDRESS, keys: Keys = None) -> None:
    """Show the nodes that the robot's engine runs, and what they use."""
    with the_robot(connect_to, keys) as robot:
        table = Table("name", "node", "state", "process", "CPU", "own memory", "started anew", "last words", box=None)
        for each in robot.nodes():
            what = (
                f"{100 * each.cpu_share:.0f} %",
                f"{each.memory_mb:.0f} MB",
                str(each.restarts),
                each.why or each.last,
            )
            table.add_row(each.name, each.node, each.state, str(each.process), *map(escape, what))
        _out.print(table)


def start(
    node: Annotated[str, typer.Argument(help="Its name in the robot's library.")],
    name: Annotated[str, typer.Option(help="What to call it.")] = "",
    set_: Set = None,
    input_: Given = None,
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Start a node beside the program; it runs until it is stopped."""
    params, inputs = values("--set", set_), values("--input", input_)
    with the_robot(connect_to, keys) as robot:
        robot.start_node(node, name=name, params=params, inputs=inputs)


def put(
    node: Running,
    set_: Set = None,
    input_: Given = None,
    step: Annotated[bool, typer.Option("--step", help="One step with them.")] = False,
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Give a node that runs new inputs and parameters, all or none."""
    params, inputs = values("--set", set_), values("--input", input_)
    with the_robot(connect_to, keys) as robot:
        robot.put_node(node, inputs, params, step=step)


def reload(node: Running, connect_to: ConnectTo = DEFAULT_ADDRESS, keys: Keys = None) -> None:
    """Let a node go on in its file as it is now. Exits with 1 where that can't run: it goes on as it was."""
    with the_robot(connect_to, keys) as robot:
        robot.reload_node(node)


def stop(node: Running, connect_to: ConnectTo = DEFAULT_ADDRESS, keys: Keys = None) -> None:
    """End a node that was started beside the program."""
    with the_robot(connect_to, keys) as robot:
        robot.stop_node(node)


def watch(
    port: Annotated[str, typer.Argument(metavar="NODE.PORT", help="What to watch.")],
    rate: Annotated[float, typer.Option(min=0.01, max=100.0, help="Values a second at most.")] = 5.0,
    count: Annotated[int, typer.Option(min=0, help="End after so many; 0: go on until Ctrl-C.")] = 0,
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Print what goes through a port, a line of JSON each: value, how many there were so far; of a large array its range."""
    node, dot, name = port.partition(".")
    if not (node and dot and name):
        raise typer.BadParameter(f"got {port!r}; expected NODE.PORT", param_hint="NODE.PORT")
    with the_robot(connect_to, keys) as robot, contextlib.suppress(KeyboardInterrupt):
        for number, event in enumerate(robot.watch_port(node, name, rate=rate), 1):
            told = {"value": event.value, "count": event.count} | ({"summary": event.summary} if event.summary else {})
            print(json.dumps(told), flush=True)
            if number == count:
                break


def values(option: str, texts: list[str] | None) -> dict[str, Any]:
    """NAME=VALUE, each value as JSON or as the text that it is."""
    found: dict[str, Any] = {}
    for text in texts or []:
        name, sign, value = text.partition("=")
        if not (name and sign):
            raise typer.BadParameter(f"got {text!r}; expected NAME=VALUE", param_hint=option)
        try:
            found[name] = json.loads(value)
        except json.JSONDecodeError:
            found[name] = value
    return found
