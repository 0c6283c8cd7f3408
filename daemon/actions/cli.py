"""`handrail behaviour ...`: run a behaviour on the robot that is up, and tell how each step ended."""

from __future__ import annotations

import os
import sys
import time
from contextlib import closing
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from handrail.behaviour_file import SOME_ARM, BehaviourFile, Part, files, find
from handrail.config import ConfigError
from handrail.messages import (
    NOT_READY,
    ActionEvent,
    CancelAction,
    CheckIn,
    DaemonStatus,
    Enable,
    GetRobot,
    RobotInfo,
    StartBehaviour,
    WholeBody,
)
from handrail.robot import library as robots
from handrail.runtime import Runtime
from handrail.topics import Caller, RefusedError, Subscriber, Unreachable

app = typer.Typer(help="Behaviours: chains of actions.", no_args_is_help=True, add_completion=False)
_BEHAVIOUR = typer.Argument(
    help="A name that `list` tells, or a YAML file (docs/compliant_motion.md).", metavar="BEHAVIOUR"
)
_CHECK_IN_S, _SILENCE_S = 0.25, 5.0
_ANSWER_S, _MAKING_S = 10.0, 300.0
"""for the answer to a start, which the server may load libraries for; for the controllers of whole-body steps"""
_LARGEST = 1 << 18
"""numbers that a command may have: the mailbox's room"""


@app.callback()
def _behaviour() -> None:
    """Chains of actions that the control loop runs by itself."""


@app.command("list")
def list_() -> None:
    """The behaviours that are known by name: the workspace's, then those that Handrail brings."""
    wrong = 0
    for name, file in files().items():
        try:
            print(f"{name:20} {', '.join(step.name for step in BehaviourFile(file, SOME_ARM).steps)}")
        except ConfigError as error:
            wrong = 1
            print(f"{name:20} {error}")
    raise typer.Exit(wrong)


@app.command()
def check(
    behaviour: Annotated[str, _BEHAVIOUR],
    robot: Annotated[
        str, typer.Option(help="Try it on this robot, too: its joints, frames, limits, compound tasks.")
    ] = "",
    arm: Annotated[str, typer.Option(help="The arm that does it, as of `run`; with --robot.")] = "",
) -> None:
    """Read a behaviour, and say what is wrong with it. No robot need be up."""
    try:
        found = BehaviourFile(find(behaviour), SOME_ARM)
        if robot:
            _try_on(find(behaviour), robot, arm)
    except (ValueError, RefusedError) as error:
        sys.exit(f"handrail behaviour check: {error}")
    print(", ".join(step.name for step in found.steps))


@app.command()
def run(
    behaviour: Annotated[str, _BEHAVIOUR],
    arm: Annotated[str, typer.Option(help="The arm that does it, where the file names no frame and no joints.")] = "",
    enable: Annotated[bool, typer.Option("--enable", help="Enable the robot first: its brakes open.")] = False,
    runtime: Annotated[
        Path | None,
        typer.Option(help="The robot's runtime folder.", show_default="$HANDRAIL_RUNTIME, else this user's"),
    ] = None,
) -> None:
    """Run it on the robot that is up and enabled, with a line a step. Ctrl-C cancels it.

    Exit status 0: it ended by `done`, or where a step leads to `end`.
    """
    try:
        file, place = find(behaviour), Runtime.at(runtime, make=False)
        if not (place.folder / "daemon.call").exists():
            place.robot_up()
        with closing(Caller(place.endpoint("daemon.call"), timeout_s=2.0)) as caller:
            robot = caller.call(GetRobot())
            good = _run(BehaviourFile(file, _part(robot, arm)), robot, caller, place, enable)
    except (OSError, ValueError, RefusedError) as error:
        sys.exit(f"handrail behaviour run: {error}")
    raise typer.Exit(0 if good else 1)


def _try_on(file: Path, robot: str, arm: str) -> None:
    """Whether the daemon would take it of a robot in its home posture. Raises ConfigError, ValueError, RefusedError."""
    from daemon import exchange
    from daemon.serving.robot_info import robot_info
    from daemon.serving.validation import check_behaviour, within
    from daemon.serving.whole_body_door import WholeBodyDoor

    description = robots.load(robot)
    info = robot_info(description)
    call = BehaviourFile(file, _part(info, arm)).call("check", "check", info)
    stands = np.zeros((), exchange.snapshot_dtype(description))
    stands["flags"], stands["position"] = exchange.Flag.ENABLED, description.home_position()
    stands["command"][0] = description.home_position()
    check_behaviour(call, description, exchange.frame_names(description), stands, _LARGEST)
    door = WholeBodyDoor(description)
    for number, step in enumerate(call.steps):
        if isinstance(step.motion, WholeBody):
            door.open(_MAKING_S)
            with within(f"steps[{number}]"):
                door.checked(step.motion, step.ends, stands["position"], _LARGEST)


def _part(robot: RobotInfo, arm: str) -> Part | None:
    if not arm:
        return None
    if arm not in robot.arms:
        raise ValueError(f"--arm: {arm}; expected one of {', '.join(robot.arms) or 'none: this robot has no arms'}")
    return Part(robot.tips[arm], tuple(robot.arms[arm]))


def _run(behaviour: BehaviourFile, robot: RobotInfo, caller: Caller, place: Runtime, enable: bool) -> bool:
    """Whether it ended as it may. Raises RefusedError, Unreachable, ConfigError."""
    me = f"behaviour-{os.getpid()}"
    call = behaviour.call(me, me, robot)
    with closing(Subscriber(place.endpoint("daemon.events"), ActionEvent | DaemonStatus)) as events:
        _await_status(events, enabled=False)  # the first one says that the subscription stands
        if enable:
            caller.call(Enable())
            _await_status(events, enabled=True)
        _start(caller, call)
        began: int | None = None
        next_check_in = 0.0
        while True:
            try:
                if (now := time.monotonic()) >= next_check_in:
                    next_check_in = now + _CHECK_IN_S
                    caller.call(CheckIn(owner=me))
                event = events.receive(_CHECK_IN_S)
            except KeyboardInterrupt:
                caller.call(CancelAction(id=me))
                continue
            if not isinstance(event, ActionEvent) or event.id != me:
                continue
            began = event.time_ns if began is None else began
            print(_line(event, began), flush=True)
            if event.state == "ended":
                return behaviour.expected(event.step, event.outcome)


def _start(caller: Caller, call: StartBehaviour) -> None:
    """Once the controllers of its whole-body steps are made. Raises RefusedError, Unreachable."""
    gives_up = time.monotonic() + _MAKING_S
    while True:
        try:
            caller.call(call, timeout_s=_ANSWER_S)
            return
        except RefusedError as error:  # asked again at once: the daemon waits a while for them each time
            if error.refusal.value != NOT_READY or time.monotonic() > gives_up:
                raise


def _await_status(events: Subscriber, *, enabled: bool) -> None:
    """The next status, or with `enabled` the first of an enabled robot. Raises Unreachable."""
    gives_up = time.monotonic() + _SILENCE_S
    while (left := gives_up - time.monotonic()) > 0:
        status = events.receive(left)
        if isinstance(status, DaemonStatus) and (status.enabled or not enabled):
            return
    raise Unreachable(
        f"the daemon has not said in {_SILENCE_S:g} s that {'the robot is enabled' if enabled else 'it is up'}"
    )


def _line(event: ActionEvent, began: int) -> str:
    words = [f"{(event.time_ns - began) * 1e-9:8.3f} s", event.step]
    if event.state != "running":
        words.append(event.outcome or event.state)
    return "  ".join([*words, *([f"({event.detail})"] if event.detail else [])])
