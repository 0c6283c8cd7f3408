"""The plant as a process: the world, the virtual bus inside it, and what time means.

``lockstep``: the world steps one host period when Sync comes on the first channel, then the drives answer. HoldTime keeps it
standing. Where neither has come for 0.5 s of wall time the world runs free, at wall speed, so that watchdogs fire as they
would on a robot; the next Sync or HoldTime ends that. Before the first Sync time stands at zero, whenever the host starts.

``wall``: the world steps every millisecond by absolute deadlines, and frames are answered after the step before which they
came; on a bus that keeps bit timing they are answered when they have come, else each answer would be a cycle late. An overrun
skips whole steps and keeps phase: simulated time then lags.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import gc
import signal
import sys
import time
from collections.abc import Callable, Sequence
from typing import TextIO

import numpy as np
import numpy.typing as npt

from hal.can import faults
from hal.can.faults import Fault
from hal.can.hub import Hub
from hal.can.timing import BusTiming
from hal.joint import JointCommand
from hal.plant import scene
from hal.plant.bullet import own_stdout
from hal.plant.bus_node import BusNode
from hal.plant.drive_node import STEP_NS
from hal.plant.scene import Scene
from hal.plant.world import World
from hal.realtime import RealTime, sleep_until
from handrail.config import ConfigError
from handrail.robot import library as robots
from handrail.robot.description import RobotDescription
from handrail.runtime import Runtime
from handrail.topics import Publisher

TRUTH_STEPS = 20
"""Ground truth goes out every so many steps: 50 Hz of simulated time. A multiple of those after which `World.go_on` stops."""
SILENCE_S = 0.5
"""wall time of listening without Sync or HoldTime after which a lock-step world runs free"""
_PATIENCE_S = 0.2
"""the longest wait, so that SIGTERM is heard"""
_PRIORITY, _CPUS = 70, (0,)  # below the daemon's, on the other core
_MOST_STEPS_AT_ONCE = 50
_BUS_TURN_NS = 200_000
"""wall clock, a bus with bit timing: frames that have ended reach the others so often; waking for each would cost half a core"""

_warm: set[tuple[str, ...]] = set()
"""robots and kinds of objects that `warm_up` has had"""


class _WallBusClock:
    """The bus's clock between two steps on the wall clock: simulated time, which goes on with the wall for one step."""

    def __init__(self, world: World):
        self._world, self._steps, self._since = world, -1, 0

    def __call__(self) -> int:
        now = time.monotonic_ns()
        if self._world.steps != self._steps:
            self._steps, self._since = self._world.steps, now
        return self._world.time_ns + min(now - self._since, STEP_NS - 1)


class Service:
    """Steps a world for the hosts on its bus until `stop` is called (from a signal handler, say)."""

    def __init__(self, world: World, hub: Hub, truth: Publisher | None = None, faults: Sequence[Fault] = ()):
        """faults: laid on the bus when the host's first Sync comes, so that their times count from there."""
        self.world, self.hub = world, hub
        self.skipped = 0
        """wall clock: steps that overruns skipped"""
        self.free_runs = 0
        """lock-step: how often the world ran free"""
        self._node = BusNode(world)
        hub.own_nodes(self._node.names, self._node.channels)
        self._truth, self._faults = truth, list(faults)
        self._steps_a_period = world.description.period_ns // STEP_NS
        self._stopping = False

    def stop(self) -> None:
        """Let the running loop return, within 0.2 s."""
        self._stopping = True

    def _hear(self, records: npt.NDArray[np.void]) -> tuple[int, int]:
        """Give the drives what came; how many Sync and HoldTime the host has sent."""
        heard = self._node.receive(records, self.hub.deaf()) if len(records) else (0, 0)
        # A Sync moves time in lock-step even if the bus is too full or too broken for the drives to hear it.
        syncs, holds = self.hub.heard or heard
        if syncs and self._faults:
            for fault in self._faults:
                self.hub.add_fault(fault)
            self._faults.clear()
        return syncs, holds

    def _advance(self, steps: int) -> None:
        left = steps
        while left:
            left -= self.world.go_on(left)
            if left:
                self._tell_truth()
        answers = self._node.answer()
        if len(answers) or self.hub.careful:
            self.hub.transmit(answers, self._node.senders[: len(answers)])
        if steps:  # behind the answers: for these a host waits
            self._tell_truth()
            self.world.catch_up(felt=False if steps > 1 else None)

    def _tell_truth(self) -> None:
        if self._truth is not None and self.world.steps % TRUTH_STEPS == 0:
            self._truth.send(self.world.truth())

    def run_lockstep(self) -> None:
        """Step when Sync comes; see the module's text."""
        self.hub.lockstep(self.world.description.period_ns, self._node.sync_id, self._node.hold_id)
        heard = False
        silent = 0.0
        # s that it has listened in vain. Time in which it stepped, or a busy machine did not let it run, is none of the host's:
        # what came meanwhile is heard first, else all drives' watchdogs would fire at a host that had spoken.
        free_since: float | None = None
        free_steps = 0
        wait = _PATIENCE_S
        while not self._stopping:
            asked = time.monotonic()
            records = self.hub.poll(wait)
            listened = min(time.monotonic() - asked, wait)
            syncs, holds = self._hear(records)
            if not syncs and len(replies := self._node.replies()):
                self.hub.transmit(replies, self._node.senders)
            if syncs or (holds and heard):
                heard, silent, free_since, wait = True, 0.0, None, _PATIENCE_S
                self.hub.owe_ticks(syncs)
                self._advance(syncs * self._steps_a_period)
                self.hub.tick()
            elif heard:
                now, silent = time.monotonic(), silent + listened
                if free_since is None and silent >= SILENCE_S:
                    free_since, free_steps, wait = now, 0, STEP_NS * 1e-9
                    self.free_runs += 1
                if free_since is not None:
                    due = int((now - free_since) * 1e9) // STEP_NS - free_steps
                    free_steps += due
                    if due:
                        self._advance(min(due, _MOST_STEPS_AT_ONCE))

    def run_wall(self) -> None:
        """Step every millisecond of wall time; see the module's text."""
        deadline = (time.monotonic_ns() // STEP_NS + 1) * STEP_NS
        while not self._stopping:
            while self.hub.careful and (now := time.monotonic_ns()) < deadline - 2 * _BUS_TURN_NS:
                sleep_until(now + _BUS_TURN_NS)
                if len(records := self.hub.poll(0.0)):
                    self._hear(records)
                    self._advance(0)  # a drive answers when it hears, with what it measured last
            sleep_until(deadline)
            self._hear(self.hub.poll(0.0))
            self._advance(1)
            deadline += STEP_NS
            late = time.monotonic_ns() - deadline
            if late > 0:
                missed = late // STEP_NS + 1
                self.skipped += missed
                deadline += missed * STEP_NS


def main(world_type: type[World] = World, prepare: Callable[[Service, Runtime], None] | None = None) -> None:
    """Run the plant until SIGTERM or SIGINT; prints `plant ready` when the bus can be joined.

    world_type, prepare: a world that is more than one, and what is done with the service before it runs (hal.hil).
    """
    parser = argparse.ArgumentParser(
        prog="python -m hal.plant.world",
        description="The simulated robot and its world, with the virtual CAN bus inside.",
    )
    parser.add_argument("--robot", required=True, help="robot's name or folder, e.g. talos_upper")
    parser.add_argument("--scene", required=True, help="scene's name or YAML file, e.g. valve")
    parser.add_argument("--clock", choices=("lockstep", "wall"), required=True)
    parser.add_argument("--bus-timing", action="store_true", help="frames take the time that they would on a real bus")
    parser.add_argument(
        "--let-down", action="store_true", help="the gantry lets the robot down on its feet once its drives hold it"
    )
    parser.add_argument("--faults", help="YAML file of faults of the bus; their times count from the host's first Sync")
    parser.add_argument("--runtime", help="the robot's runtime folder (default: $HANDRAIL_RUNTIME, else this user's)")
    options = parser.parse_args()
    with own_stdout() as stdout:
        try:
            robot = robots.load(options.robot)
            if options.let_down:
                if robot.base != "free" or robot.floor is None:
                    raise ValueError(f"--let-down: {robot.name} has no free base over a floor; leave it out")
                robot = dataclasses.replace(robot, support="hoist")
            world = world_type(robot, scene.load(options.scene))
            runtime = Runtime.at(options.runtime)
            channels = [BusTiming(c.name, c.bitrate, c.data_bitrate) for c in robot.channels]
            clock = _WallBusClock(world) if options.clock == "wall" else lambda: world.time_ns
            hub = Hub(runtime.bus, channels, clock=clock, timing=options.bus_timing)
            names = [channel.name for channel in robot.channels]
            script = faults.read(options.faults, channels=names) if options.faults else []
            for fault in script:
                hub.check_fault(fault)
        except (ConfigError, OSError, ValueError) as error:
            sys.exit(f"plant: {error}")
        truth = Publisher(runtime.endpoint("plant.truth"))
        service = Service(world, hub, truth, script)
        if prepare is not None:
            prepare(service, runtime)
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: service.stop())
        with contextlib.closing(hub), contextlib.closing(world), contextlib.closing(truth):
            _run(service, options.clock, stdout)


def warm_up(description: RobotDescription, objects: Scene) -> None:
    """Compile and allocate all that a step ever needs, in a world of its own, before time counts: once in a process, and not again
    in one that was forked from it."""
    what = (str(description.urdf), *sorted(type(thing).__name__ for thing in objects.objects.values()))
    if what in _warm:
        return
    _warm.add(what)
    warm = World(description, objects)
    warm.drives.control(np.zeros(len(description.joints), np.uint8))
    warm.drives.command(JointCommand(len(description.joints)))
    warm.advance(4)
    warm.devices.measure()
    warm.truth()
    warm.close()


def _run(service: Service, clock: str, stdout: TextIO) -> None:
    warm_up(service.world.description, service.world.scene)
    if clock == "wall":
        for warning in RealTime(priority=_PRIORITY, cpus=_CPUS).warnings:
            print(f"plant: {warning}", file=sys.stderr)
    else:
        gc.collect()
        gc.freeze()
    print("plant ready", file=stdout, flush=True)
    (service.run_wall if clock == "wall" else service.run_lockstep)()
    world = service.world
    peaks = ", ".join(f"{name} {force:.0f} N" for name, force in world.peak_contact_force.items()) or "no objects"
    print(
        f"plant: {world.time_ns * 1e-9:.2f} s simulated, {service.skipped} steps skipped, "
        f"{service.free_runs} free runs; peak contact: {peaks}",
        file=sys.stderr,
    )
