"""What commands about the robot that is up share: where it is, whose keys are shown, and words where it is not there or says no."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from handrail.client import Client, RefusedError, Unreachable, connect
from handrail.link.keys import KeysError

ConnectTo = Annotated[str, typer.Option("--connect", envvar="HANDRAIL_ADDRESS", help="Address of the robot's link.")]
Keys = Annotated[Path | None, typer.Option(help="Folder of keys, if not this user's own.")]
_err = Console(stderr=True)


@contextlib.contextmanager
def the_robot(address: str, keys: Path | None) -> Iterator[Client]:
    """A robot's client; what it refuses, and that it is not there, ends the command with 1 and words."""
    try:
        with connect(address, keys) as robot:
            yield robot
            return
    except RefusedError as refused:
        fail(str(refused))
    except (Unreachable, KeysError) as problem:
        fail(str(problem) if str(problem).startswith(address) else f"{address}: {problem}")
    except ValueError as problem:  # of what was typed, which says so itself
        fail(str(problem))


def fail(text: str) -> None:
    """End the command with 1 and these words."""
    _err.print(text, style="red", markup=False, highlight=False, soft_wrap=True)
    raise typer.Exit(1)
