"""`handrail deploy` and `handrail deployments`: code on its way to the robot's engines, and what they have."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from datetime import datetime
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from engines.releases.check import NODES
from engines.releases.closure import bundle_here, bundle_of
from handrail.client import DEFAULT_ADDRESS, RefusedError, Unreachable, connect
from handrail.config import ConfigError
from handrail.link.keys import KeysError
from handrail.messages import Release, Releases
from handrail.robot_option import ConnectTo, Keys

app = typer.Typer(
    help="Which code the robot's engines have: list, show, roll back.", no_args_is_help=True, add_completion=False
)
_out = Console()
_err = Console(stderr=True)
Engine = Annotated[str, typer.Option(help="The engine's name, if not the first.")]
Note = Annotated[str, typer.Option(help="What for: it is kept with the release.")]


def deploy(
    program: Annotated[str, typer.Argument(help="Its name in the workspace or the library, or its file.")],
    *,
    engine: Engine = "",
    note: Note = "",
    robot: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Bring a program, with the nodes, behaviours, templates and scenes that it needs, to an engine.

    Only what the engine lacks travels. It is checked whole for that robot before anything is replaced; a deployment that was cut
    goes on where it was when it is asked for again. Needs a developer's key. Exit status 1: refused; 3: no answer.
    """
    with _telling(), connect(robot, keys) as client:
        bundle = bundle_of(program)
        before = sum(client.traffic)
        release = client.send_bundle(bundle, engine=engine, note=note, progress=_progress)
        crossed = sum(client.traffic) - before
        if release.already:
            _out.print(f"{release.program}: nothing has changed since release {release.number}", highlight=False)
            return
        _out.print(f"release {release.number}: {release.program}, {crossed} bytes over the link", highlight=False)
        for path in release.changed:
            _out.print(f"  {path}", highlight=False)


def _progress(sent: int, known: int) -> None:
    if sent and _err.is_terminal:
        _err.print(f"{sent} of {known} pieces", highlight=False)


@app.command("list")
def list_(robot: ConnectTo = DEFAULT_ADDRESS, keys: Keys = None) -> None:
    """Which engine has and runs which program, and whether it is what is here."""
    with _telling(), connect(robot, keys) as client:
        table = Table("engine", "program", "release", "by", "since", "here", "runs", box=None)
        for engine in client.engines():
            if not engine.up:
                table.add_row(engine.name, "", "", "", "", "", "does not answer")
                continue
            found = client.releases(engine.name)
            for program in found.programs.keys() | ({engine.program} - {""}):
                runs = engine.status if engine.program == program else ""
                table.add_row(engine.name, program, *_since(program, found), escape(_here(program, found)), runs)
            if not found.programs and not engine.program:
                table.add_row(engine.name, "nothing was deployed, nothing has run")
        _out.print(table)


def _since(program: str, found: Releases) -> tuple[str, str, str]:
    """Release, who, when."""
    if program not in found.programs:
        return "the robot's own", "", ""
    release = next((each for each in reversed(found.releases) if each.bundle == found.programs[program]), None)
    return (str(release.number), release.by, _time(release)) if release else ("before those kept", "", "")


def _here(program: str, found: Releases) -> str:
    """What of a deployed program, or node, is another one here."""
    bundle = found.programs.get(program)
    if bundle is None:
        return ""
    try:
        own = bundle_here(program)
    except (ConfigError, ValueError, OSError):
        check = "handrail node test" if program.startswith(NODES) else "handrail program check"
        return f"unsound here: {check} says why"
    if own is None:
        return "not here"
    if own.address == bundle:
        return "the same"
    other = [path for path, address in own.manifest.addresses().items() if found.files.get(path) != address]
    return f"differs: {', '.join(other) or 'the robot has more'}"


@app.command()
def show(engine: Engine = "", robot: ConnectTo = DEFAULT_ADDRESS, keys: Keys = None) -> None:
    """An engine's releases, oldest first: the last one is in force, the others can be gone back to."""
    with _telling(), connect(robot, keys) as client:
        table = Table("release", "program", "by", "since", "changed", "note", box=None)
        for release in client.releases(engine).releases:
            changed = escape("\n".join(release.changed))
            table.add_row(
                str(release.number), release.program, escape(release.by), _time(release), changed, escape(release.note)
            )
        _out.print(table)


@app.command()
def rollback(
    release: Annotated[int, typer.Argument(help="Its number; none: the one before that in force.")] = 0,
    *,
    engine: Engine = "",
    note: Note = "",
    robot: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Bring back the code of an earlier release, as a new one. Needs a developer's key."""
    with _telling(), connect(robot, keys) as client:
        new = client.roll_back(release, engine=engine, note=note)
        _out.print(f"release {new.number}: {new.note}", highlight=False)
        for path in new.changed:
            _out.print(f"  {path}", highlight=False)


def _time(release: Release) -> str:
    return datetime.fromtimestamp(release.at_ns / 1e9).astimezone().strftime("%Y-%m-%d %H:%M:%S")


@contextlib.contextmanager
def _telling() -> Iterator[None]:
    """What can't be done, in a line, and the status that says it."""
    try:
        yield
    except (ConfigError, RefusedError, ValueError, KeysError, OSError) as problem:
        _err.print(str(problem), style="red", markup=False, highlight=False, soft_wrap=True)
        raise typer.Exit(3 if isinstance(problem, Unreachable) else 1) from problem
