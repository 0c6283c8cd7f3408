"""`handrail can fault ...`: laying faults on the virtual bus, and taking them back."""

from __future__ import annotations

import difflib
import fnmatch
import sys
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Annotated, Any, get_args

import msgspec
import typer

from hal.can.cli_options import RuntimeFolder
from hal.can.control import HubControl
from hal.can.faults import Fault, Kind, read
from handrail.config import ConfigError
from handrail.runtime import Runtime

KINDS = get_args(Kind)

app = typer.Typer(help="Faults on the virtual bus.", no_args_is_help=True, add_completion=False)


@app.callback()
def _group() -> None:
    """Faults on the virtual bus: dropped, late, corrupt frames, a babbling node, a cut cable, and more.

    A fault stays until it has run its time or count, or is cleared; not until this command ends.
    """


@contextmanager
def _hub(verb: str, runtime: Path | None) -> Iterator[HubControl]:
    """The hub's ear; what goes wrong becomes one line and exit status 1."""
    try:
        with closing(HubControl(Runtime.at(runtime, make=False).bus, timeout_s=1.0)) as hub:
            yield hub
    except (ValueError, OSError, ConfigError) as error:
        sys.exit(f"handrail can fault {verb}: {error}")


@app.command()
def add(
    kind: Annotated[str | None, typer.Argument(help=f"One of {', '.join(KINDS)}.")] = None,
    file: Annotated[
        Path | None, typer.Option("--file", help="All faults of a YAML file instead.", dir_okay=False)
    ] = None,
    channel: Annotated[
        str | None, typer.Option("--channel", "-c", help="Only on this one.", show_default="all")
    ] = None,
    node: Annotated[
        str | None,
        typer.Option(
            "--node",
            "-n",
            help="Only of this sender: a joint, a device, `daemon`, or a pattern.",
            show_default="all",
        ),
    ] = None,
    can_id: Annotated[
        str | None, typer.Option("--id", help="Only this identifier, in hex.", show_default="all")
    ] = None,
    mask: Annotated[str, typer.Option(help="Bits of the identifier that must agree, in hex.")] = "1FFFFFFF",
    after: Annotated[float, typer.Option(min=0.0, help="s of the bus's clock until it begins.")] = 0.0,
    duration: Annotated[
        float | None, typer.Option(help="s of the bus's clock that it lasts.", show_default="until cleared")
    ] = None,
    count: Annotated[int | None, typer.Option(min=1, help="Ends after so many frames.", show_default="never")] = None,
    probability: Annotated[float, typer.Option(help="Of a matching frame to be hit.")] = 1.0,
    delay: Annotated[float, typer.Option(min=0.0, help="s, of kind delay.")] = 0.005,
    seed: Annotated[int, typer.Option(help="Of this fault's random numbers.")] = 0,
    even_if_absent: Annotated[
        bool, typer.Option("--even-if-absent", help="Lay it for a --node that is yet to join the bus.")
    ] = False,
    runtime: RuntimeFolder = None,
) -> None:
    """Lay a fault on the bus, and print its number.

    Example: handrail can fault add drop --node arm_right_3_joint --probability 0.3 --duration 2
    Exit status 0: it is on the bus; 1: there is no bus, no such fault, or no such node.
    """
    with _hub("add", runtime) as hub:
        if (kind is None) == (file is None):
            raise ValueError(f"a kind or --file FILE is needed, and not both; kinds are {', '.join(KINDS)}")
        if file is not None:
            faults = read(file)
        else:
            given: dict[str, Any] = {
                "kind": kind, "channel": channel, "node": node, "can_id": _hex("--id", can_id), "mask": _hex("--mask", mask),
                "after": after, "duration": duration, "count": count, "probability": probability, "delay": delay, "seed": seed,
            }  # fmt: skip
            if kind not in KINDS:
                raise ValueError(f"kind {kind!r}; expected one of {', '.join(KINDS)}")
            try:
                faults = [msgspec.convert(given, Fault)]
            except msgspec.ValidationError as error:
                raise ValueError(_by_option(str(error))) from error
        if not even_if_absent:
            _check_nodes(faults, sorted({node.name for node in hub.report().nodes}))
        for fault in faults:
            number = hub.add(fault)
            print(f"fault {number}: {fault.kind}" if file else number)


def _check_nodes(faults: Iterable[Fault], nodes: list[str]) -> None:
    """Raises ValueError for a fault of a node that is not on the bus: it would do nothing, and nobody would notice."""
    for fault in faults:
        if fault.node is not None and not fnmatch.filter(nodes, fault.node):
            near = difflib.get_close_matches(fault.node, nodes, 3) or nodes[:8]
            more = ", ..." if len(near) < len(nodes) else ""
            raise ValueError(
                f"--node {fault.node}: not on the bus now; expected one of {', '.join(near)}{more} (`handrail can stats` lists "
                f"them), or --even-if-absent for one that is yet to join"
            )


def _hex(option: str, text: str | None) -> int | None:
    try:
        return None if text is None else int(text, 16)
    except ValueError as error:
        raise ValueError(f"{option} {text!r}; expected a hexadecimal number, e.g. 203") from error


def _by_option(said: str) -> str:
    """A validation error's words, its field named as the option is."""
    problem, _, field = said.partition(" - at `$.")
    return f"--{field.rstrip('`').replace('can_id', 'id')}: {problem}" if field else problem


@app.command("list")
def list_faults(
    as_json: Annotated[bool, typer.Option("--json", help="As JSON: number, fault, hits.")] = False,
    runtime: RuntimeFolder = None,
) -> None:
    """The faults on the bus, and how many frames each has hit."""
    with _hub("list", runtime) as hub:
        report = hub.report()
    if as_json:
        rows = [{"number": n, "fault": fault, "hits": report.hits.get(n, 0)} for n, fault in report.faults.items()]
        print(msgspec.json.format(msgspec.json.encode(rows)).decode())
    elif not report.faults:
        print("no faults")
    else:
        from rich.console import Console

        from hal.can.bus_table import fault_table

        Console().print(fault_table(report))


@app.command()
def clear(
    number: Annotated[
        int | None, typer.Argument(help="The fault's number (`fault list`).", show_default="all of them")
    ] = None,
    runtime: RuntimeFolder = None,
) -> None:
    """Take back one fault, or all. Exit status 0: done; 1: there is no bus, or no such fault."""
    with _hub("clear", runtime) as hub:
        count = hub.clear(number)
    print(f"{count} cleared")
