"""`handrail jog` and `handrail home`: joints sent somewhere by hand, and the way back to one of the robot's postures."""

from __future__ import annotations

import contextlib
import math
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from handrail.client import DEFAULT_ADDRESS, Client, RefusedError, Unreachable, connect
from handrail.link.keys import KeysError
from handrail.robot_option import ConnectTo, Keys

_NUMBER = re.compile(r"(?P<sign>[+-])?(?P<size>\d+(\.\d*)?|\.\d+)(?P<unit>deg|°|rad|m)?")

NUMBERS = {"ignore_unknown_options": True}
"""of a command's context, so that -0.1 is a number and no option"""


def jog(
    joint: Annotated[str, typer.Argument(help="One of the robot's joints.")],
    where: Annotated[
        list[str], typer.Argument(help="+5deg or -0.1: by so much; to 0.3 or to 20deg: there. rad, or m.")
    ],
    speed: Annotated[float, typer.Option(min=0.01, max=1.0, help="Share of the joint's velocity limit.")] = 0.1,
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Move one joint. Nobody looks ahead but the daemon's guard; Ctrl-C stops it.

    Exit status 0: it is there.
    """
    with _robot("jog", connect_to, keys) as robot:
        by, value = asked(where)
        there = robot.jog({joint: value}, by=by, speed=speed)
        print(f"{joint}: {there[joint]:.4f}")


vars(jog)["context_settings"] = NUMBERS


def home(
    posture: Annotated[str, typer.Argument(help="One of the robot's postures.")] = "ready",
    arm: Annotated[str, typer.Option(help="Only this arm's joints; none: all of the robot's.")] = "",
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Bring the robot to a posture: planned clear of itself and of all instances, then executed. Ctrl-C stops it."""
    with _robot("home", connect_to, keys) as robot:
        plan = robot.home(posture, arm)
        print(f"{posture}: there after {plan.duration:.1f} s of planned motion ({plan.id})")


def asked(words: list[str]) -> tuple[bool, float]:
    """(whether by so much, rad or m) of what a person typed. Raises ValueError."""
    absolute = words[0] == "to" and len(words) == 2
    found = _NUMBER.fullmatch(words[-1]) if absolute or len(words) == 1 else None
    if found is None or not (absolute or found["sign"]):
        raise ValueError(f"got {' '.join(words)!r}; expected +5deg, -0.1, to 0.3 or to 20deg")
    size = float(found["size"]) * (-1.0 if found["sign"] == "-" else 1.0)
    return not absolute, math.radians(size) if found["unit"] in ("deg", "°") else size


@contextlib.contextmanager
def _robot(verb: str, connect_to: str, keys: Path | None) -> Iterator[Client]:
    try:
        with connect(connect_to, keys) as robot:
            try:
                yield robot
            except KeyboardInterrupt:
                with contextlib.suppress(RefusedError):  # it has just ended, or is still being planned
                    robot.stop_run()
                robot.cancel_planning()
                sys.exit(f"handrail {verb}: stopped")
    except (RefusedError, Unreachable, KeysError, ValueError) as problem:
        sys.exit(f"handrail {verb}: {problem}")
