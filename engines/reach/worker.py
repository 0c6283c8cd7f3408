"""The process that finds out what can be reached, beside the engine: `python -m engines.reach.worker ROBOT DESCRIPTOR`.

Of each trajectory that is asked about it knows the newest question only: what was asked in between is dropped. What is near or not
reached is looked for from elsewhere once nothing is waiting, and given up as soon as something is. It ends with its engine.
"""

from __future__ import annotations

import logging
import os
import select
import signal
import socket
import sys
from pathlib import Path

import numpy as np

from affordance_templates import catalogue
from affordance_templates.instance import Instance
from affordance_templates.template_file import Template
from engines.nodes.wire import Wire
from engines.planning.planners import Planners
from engines.reach.reachability import Question, Reachability
from engines.reach.wire import Ask, Told
from handrail import workspace
from handrail.messages import InstanceState
from handrail.robot import library as robots
from handrail.usage import show_as

_NICE = 5
"""what moves the robot goes first"""

About = tuple[str, str, str]


class _Instances:
    """Instances as they were told, each the same object until it changes: what was made of it is kept by that."""

    def __init__(self) -> None:
        self._known: dict[str, tuple[InstanceState, Instance]] = {}
        self._templates: dict[tuple[str, str, str], Template] = {}

    def of(self, ask: Ask) -> list[Instance]:
        """Raises ValueError, ConfigError among it."""
        known = {state.name: self._instance(state, ask.deployed) for state in ask.instances}
        self._known = known
        return [instance for _, instance in known.values()]

    def _instance(self, state: InstanceState, deployed: str) -> tuple[InstanceState, Instance]:
        before = self._known.get(state.name)
        if before is not None and before[0] == state:
            return before
        template = self._template(state, deployed)
        parameters = template.values(state.parameters)
        return state, Instance(
            state.name, template, state.pose_in_world, parameters, dict(state.joint_state), state.version
        )

    def _template(self, state: InstanceState, deployed: str) -> Template:
        key = (deployed, state.template, state.template_hash)
        if key not in self._templates:
            with workspace.pinned(Path(deployed) if deployed else None):
                template = catalogue.load(state.template)
            if template.hash != state.template_hash:
                raise ValueError(f"template {state.template} was edited since {state.name} was placed: place it anew")
            self._templates[key] = template
        return self._templates[key]


class Worker:
    """Answers questions until the engine is gone."""

    def __init__(self, reach: Reachability, wire: Wire):
        self._reach, self._wire = reach, wire
        self._instances = _Instances()
        self._waiting: dict[About, Ask] = {}
        self._unsettled: dict[About, Ask] = {}

    def serve(self) -> None:
        """Raises EOFError when the other end is gone."""
        while True:
            self._take(wait=not self._waiting and not self._unsettled)
            queue, settle = (self._waiting, False) if self._waiting else (self._unsettled, True)
            if not queue:
                continue
            about = next(iter(queue))
            ask = queue.pop(about)
            told = self._answer(ask, settle=settle)
            if told is None:  # called off by what has come meanwhile
                self._unsettled.setdefault(about, ask)
                continue
            if not told.settled:
                self._unsettled[about] = ask
            self._wire.send(told)

    def _take(self, *, wait: bool) -> None:
        """What has come, of each kind the newest."""
        while True:
            while (ask := self._wire.arrived()) is not None:
                self._waiting[ask.about] = ask
                self._unsettled.pop(ask.about, None)
                wait = False
            if not self._comes(wait=wait):
                return
            self._wire.read()

    def _comes(self, *, wait: bool = False) -> bool:
        return bool(select.select([self._wire.socket], [], [], None if wait else 0.0)[0])

    def _answer(self, ask: Ask, *, settle: bool) -> Told | None:
        """None where settling was called off."""
        version = next((state.version for state in ask.instances if state.name == ask.instance), 0)
        try:
            question = Question(
                instance=ask.instance,
                trajectory=ask.trajectory,
                arm=ask.arm,
                clearance=ask.clearance,
                instances=self._instances.of(ask),
                position=np.array(ask.position),
                base=ask.base,
            )
            if settle:
                found = self._reach.settle(question, self._comes)
                return None if found is None else Told(ask.number, version, found, settled=True)
            found = self._reach.quick(question)
        except ValueError as problem:  # ConfigError among it
            return Told(ask.number, version, [], settled=True, problem=str(problem))
        except Exception as crash:
            # One question that finds a defect must not end those about other instances.
            logging.exception("reachability of %s", ask.about)
            words = f"the engine's own error: {type(crash).__name__}: {crash}"
            return Told(ask.number, version, [], settled=True, problem=words)
        return Told(ask.number, version, found, settled=all(each.state == "reached" for each in found))


def main(arguments: list[str]) -> int:
    """Serve one engine."""
    robot, descriptor = arguments
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the engine's
    show_as("reachability")
    os.nice(_NICE)
    wire = Wire(socket.socket(fileno=int(descriptor)), Ask)
    try:
        description = robots.load(robot)
        Worker(Reachability(Planners(description), description), wire).serve()
    except (EOFError, BrokenPipeError, ConnectionResetError):
        return 0
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
