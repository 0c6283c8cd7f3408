"""`handrail pair`: let another machine's client in, by a code that this robot shows."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Literal

import typer
from rich.console import Console

from handrail.link import keys as link_keys
from handrail.link import pairing
from handrail.robot_option import fail

_out = Console()


def pair(
    code: Annotated[str, typer.Argument(help="With --connect: the code that the robot shows.")] = "",
    *,
    connect: Annotated[
        str,
        typer.Option(
            "--connect", metavar="HOST", help="On the other machine: the robot's host, or its link's address."
        ),
    ] = "",
    role: Annotated[
        Literal["operator", "developer", "engine", "observer"],
        typer.Option(help="On the robot: what the other may (docs/deployment.md)."),
    ] = "operator",
    name: Annotated[
        str, typer.Option(help="What the robot is to call the other machine (default: by its host's name).")
    ] = "",
    bind: Annotated[str, typer.Option(help="On the robot: the address to listen on; *: every interface.")] = "*",
    port: Annotated[int, typer.Option(min=1, max=65533, help="On the robot: the link's port.")] = 47800,
    keys: Annotated[Path | None, typer.Option(help="Folder of keys, if not this user's own.")] = None,
) -> None:
    """On the robot: show a code, and let in the one machine at which it is typed. There: handrail pair --connect HOST CODE.

    The code counts once, for two minutes and three tries. Exit status 0: paired; 1: not.
    """
    try:
        if connect:
            _join(connect, code, name, keys)
        elif code:
            fail(
                f"code: got {code!r} without --connect; expected handrail pair --connect HOST {code}, or handrail pair alone"
            )
        else:
            _let_in(role, name, bind, port, keys)
    except (pairing.PairingError, link_keys.KeysError) as problem:
        fail(str(problem))


def _join(address: str, code: str, name: str, keys: Path | None) -> None:
    if not code:
        fail("code: got none; expected the eight digits that handrail pair shows on the robot")
    accepted = pairing.pair(pairing.endpoint_of(address), code, keys, name=name or pairing.own_name())
    _out.print(
        f"paired: the robot calls this client {accepted.name}, and takes it for {_a(accepted.role)}'s", highlight=False
    )


def _a(role: str) -> str:
    return f"{'a' if role == 'developer' else 'an'} {role}"


def _let_in(role: link_keys.Role, name: str, bind: str, port: int, keys: Path | None) -> None:
    if name and not re.fullmatch(pairing.NAME, name):
        fail(f"name: got {name!r}; expected letters, digits, '_', '.' and '-', at most 64")
    desk = pairing.Desk(link_keys.for_gate(keys), role, name)
    _out.print(f"\n    {desk.code}\n", style="bold", highlight=False)
    minutes = pairing.LASTS_S / 60
    _out.print(f"Type it at the other machine within {minutes:g} minutes:", highlight=False)
    _out.print(f"    handrail pair --connect {pairing.own_name()}:{port} {desk.code}", highlight=False, soft_wrap=True)
    try:
        desk.serve(f"tcp://{bind}:{port + pairing.PORT_OFFSET}")
    except KeyboardInterrupt:
        fail("ended: nobody was let in")
    if desk.paired is None:
        fail("three wrong tries: nobody was let in" if desk.tries <= 0 else "nobody came in time: nobody was let in")
    else:
        _out.print(
            f"paired: {desk.paired.name} is {_a(desk.paired.role)} from now on ({desk.paired.file})", highlight=False
        )
