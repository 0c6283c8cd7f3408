"""`handrail engine --connect ADDRESS`: an engine on another machine than the robot's, through its link (docs/deployment.md)."""

from __future__ import annotations

import logging
import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from engines.uplink import Uplink
from handrail.client import DEFAULT_ADDRESS, RefusedError, Unreachable
from handrail.link import keys as link_keys
from handrail.link.session import Session
from handrail.messages import FetchCalls, GetRobot, RobotInfo
from handrail.robot_option import ConnectTo, Keys, fail
from handrail.runtime import Runtime, memory_folder
from handrail.sole_holder import HeldElsewhere

_FIND_S = 10.0


def engine(
    *,
    address: ConnectTo = DEFAULT_ADDRESS,
    name: Annotated[str, typer.Option(help="Refuse to be another engine than this one.")] = "",
    robot: Annotated[str, typer.Option(help="The robot's folder here, if it is not in the library.")] = "",
    clouds: Annotated[bool, typer.Option(help="Have what the robot's cameras see, for plans that keep clear.")] = True,
    runtime: Annotated[str, typer.Option(help="Folder for sockets and journal (default: one in memory).")] = "",
    code: Annotated[Path | None, typer.Option(help="Folder where deployed code is kept (default: with them).")] = None,
    keys: Keys = None,
) -> None:
    """Run an engine of a robot that is up elsewhere, until Ctrl-C. Programs are deployed to it and run on it as on the robot's own.

    This machine's key must be in the robot's allowed/engines: the name of its file is the engine's. Where the link is cut the robot
    stops what the engine moves, and the run pauses; the engine comes back by itself.
    """
    logging.basicConfig(stream=sys.stderr, level=logging.INFO, format="engine: %(message)s")
    try:
        session = Session(address, link_keys.for_client(keys))
    except (link_keys.KeysError, ValueError) as problem:
        fail(str(problem))
    try:
        session.wait_connected(_FIND_S)
        known_as = session.call(FetchCalls()).engine
        if name and name != known_as:
            fail(f"the robot knows this machine's key as the engine {known_as}; expected {name}")
        _run(session, known_as, robot, _folder(runtime, known_as), code, clouds=clouds)
    except (RefusedError, Unreachable, ValueError) as problem:
        fail(str(problem) if str(problem).startswith(address) else f"{address}: {problem}")
    except HeldElsewhere as held:
        fail(f"another engine has its folder here already (process {held.process}): choose --runtime")
    finally:
        session.close()


def _folder(chosen: str, name: str) -> Runtime:
    """Where the engine's own processes meet. Raises ValueError."""
    runtime = Runtime.at(chosen or memory_folder() / f"handrail-{os.getuid()}-{name}")
    if runtime.robot.exists():
        raise ValueError(f"--runtime {runtime.folder}: a robot is up there; expected a folder of the engine's own")
    return runtime


def _run(session: Session, name: str, robot: str, runtime: Runtime, code: Path | None, *, clouds: bool) -> None:
    from engines.engine import Engine, serve
    from engines.planning.planners import Planners
    from engines.tip_poses import tip_poses
    from handrail.robot import library as robots

    there: RobotInfo = session.call(GetRobot())
    description = robots.load(robot or there.name)
    same = {
        "name": (description.name, there.name),
        "joints": (list(description.joints), there.joints),
        "lower limits": (description.lower.tolist(), there.lower),
        "upper limits": (description.upper.tolist(), there.upper),
        "velocity limits": (description.velocity_limit.tolist(), there.velocity_limit),
        "tips": ({arm: each.tip for arm, each in description.arms.items()}, there.tips),
    }
    for what, (here, expected) in same.items():
        if here != expected:
            raise ValueError(f"the robot's {what} here: {here}; expected what the robot has: {expected}")
    uplink = Uplink(runtime, session, name, clouds=clouds)
    try:
        made = Engine(
            runtime, description, Planners(description), tip_poses(description), name=name, code=code, away=True
        )
        uplink.attend()
        serve(made, name)
    finally:
        uplink.close()
