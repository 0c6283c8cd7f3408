"""`handrail shell`: an IPython prompt with a connected robot in it."""

from __future__ import annotations

import sys
from typing import Annotated, Any

import numpy as np
import typer

import handrail
from handrail import messages
from handrail.client import DEFAULT_ADDRESS, Client, RefusedError, Unreachable, connect
from handrail.link.keys import KeysError
from handrail.robot_option import ConnectTo, Keys

_AT_HAND = """\
  robot      the connection: robot.<Tab> lists its calls, robot.plan? tells about one
  m          handrail.messages: m.Pose, m.RunState ...
  np         numpy
"""


def shell(
    connect_to: ConnectTo = DEFAULT_ADDRESS,
    keys: Keys = None,
    command: Annotated[
        str | None, typer.Option("-c", metavar="CODE", help="Run this instead of asking, and leave.")
    ] = None,
) -> None:
    """Talk to the robot that is up in Python: every call of a script, with completion and history."""
    from IPython import start_ipython
    from traitlets.config import Config

    try:
        robot = connect(connect_to, keys)
    except (Unreachable, KeysError, ValueError) as problem:
        sys.exit(f"handrail shell: {problem}")
    with robot:
        settings = Config()
        settings.TerminalIPythonApp.display_banner = command is None
        settings.TerminalInteractiveShell.banner1 = f"{_greeting(robot)}\n\n{_AT_HAND}"
        settings.TerminalInteractiveShell.confirm_exit = False
        arguments = [] if command is None else ["--quick", "-c", command]
        names: dict[str, Any] = {"robot": robot, "m": messages, "np": np, "handrail": handrail}
        start_ipython(argv=arguments, user_ns=names, config=settings)


def _greeting(robot: Client) -> str:
    """Which robot this is, and how it is."""
    try:
        info, status = robot.robot(), robot.status()
    except (RefusedError, Unreachable) as problem:
        return f"handrail: connected to {robot.address}; {problem}"
    state = "stopped" if status.stopped else "enabled" if status.enabled else "not enabled: robot.enable()"
    return f"handrail: {info.name} at {robot.address}, {len(info.joints)} joints, {status.clock} clock, {state}"
