"""`handrail enable` and `handrail disable`: the robot that is up, taken into operation and out of it."""

from __future__ import annotations

from typing import Annotated

import typer

from handrail.client import DEFAULT_ADDRESS
from handrail.robot_option import ConnectTo, Keys, fail, the_robot


def enable(
    timeout: Annotated[float, typer.Option(min=0.1, max=60.0, help="s that its drives may take.")] = 10.0,
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
) -> None:
    """Take every drive into operation: brakes open, and the robot holds where it is. Limbs that were left out come back, too.

    Refused while the stop is latched (`handrail stop --clear`). Exit status 0: it holds; 1: refused, or not all got there.
    """
    with the_robot(connect_to, keys) as robot:
        try:
            robot.enable(timeout)
        except TimeoutError as late:
            fail(str(late))
        print("enabled: it holds where it is")


def disable(connect_to: ConnectTo = DEFAULT_ADDRESS, keys: Keys = None) -> None:
    """Take every drive out of operation: the brakes close. What was running ends."""
    with the_robot(connect_to, keys) as robot:
        robot.disable()
        print("disabled: its brakes close")
