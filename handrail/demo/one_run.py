"""One run of the demo: the whole stack started, the valve turned by the program, the plant's ground truth judged."""

from __future__ import annotations

import contextlib
import math
import shutil
import socket
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from handrail.client import Client, RefusedError, Unreachable, connect
from handrail.demo.children import Child, ChildDied, Children
from handrail.demo.judge import Judge
from handrail.demo.operator import ScriptedOperator
from handrail.demo.progress import Show
from handrail.demo.report import Row
from handrail.demo.scenario import OBJECT, Scenario
from handrail.demo.verdict import SETTLE_S, Verdict, judge
from handrail.engines import FIRST
from handrail.link.keys import KeysError
from handrail.messages import DaemonStatus, GroundTruth, LogLine, RunState
from handrail.runtime import Runtime, memory_folder

ROBOT = "talos_upper"
RECORDING = "recording.mcap"
PROGRAM = "turn_valve"
INSTANCE, TEMPLATE, ARM = "wheel_1", "wheel", "right"
BINDINGS = {"arm": ARM, "valve": INSTANCE}

_START_S = 600.0
"""wall; the first start on a machine compiles kernels, on a busy one for three minutes"""
_ENABLE_S = 30.0
_LOOK_S = 0.2
_TROUBLE = frozenset({"fault", "fault_reaction_active", "quick_stop_active"})
_OVER = frozenset({"succeeded", "failed", "stopped"})


@dataclass(frozen=True)
class Options:
    """What the runs of one call of the demo have in common."""

    clock: str
    view: bool
    timeout_s: float
    """wall, for the program"""


@dataclass
class Outcome:
    """What one run showed."""

    row: Row
    before: GroundTruth | None = None
    after: GroundTruth | None = None
    recording: Path | None = None


@dataclass
class _Seen:
    """What the robot said of itself during a run."""

    run: RunState | None = None
    status: DaemonStatus | None = None
    trouble: set[str] = field(default_factory=set)
    """joints whose drive was in a fault or quick stop, or had an error"""

    def note(self, event: RunState | DaemonStatus) -> None:
        if isinstance(event, RunState):
            self.run = event
            return
        self.status = event
        self.trouble |= {drive.joint for drive in event.drives if drive.state in _TROUBLE or drive.error}


def run(scenario: Scenario, options: Options, out: Path, show: Show) -> Outcome:
    """Run the demo once, leaving scene, recording and logs in `out`. What goes wrong is in the row's problems."""
    folder = Path(tempfile.mkdtemp(prefix="hr", dir=memory_folder()))  # short: Unix sockets live in it
    try:
        with Children(out / "logs") as children:
            attempt = _Attempt(scenario, options, out, show, Runtime.at(folder), children)
            try:
                attempt.carry_out()
            except (ChildDied, KeysError, Unreachable, RefusedError, TimeoutError) as problem:
                attempt.problems.append(str(problem))
            finally:
                attempt.close()
            return attempt.outcome()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


class _Attempt:
    def __init__(
        self, scenario: Scenario, options: Options, out: Path, show: Show, runtime: Runtime, children: Children
    ):
        self._scenario, self._options, self._out, self._show = scenario, options, out, show
        self._runtime, self._children = runtime, children
        self._open = contextlib.ExitStack()
        self._seen = _Seen()
        self._judge: Judge | None = None
        self._operator: ScriptedOperator | None = None
        self._before: GroundTruth | None = None
        self._after: GroundTruth | None = None
        self._start_up_s = 0.0
        self._times: tuple[float, float, float, float] | None = None
        """plant's and wall time when the program began, and when it ended"""
        self.problems: list[str] = []

    def carry_out(self) -> None:
        """From nothing to a program that has ended and a valve that stands still. Raises ChildDied, Unreachable, RefusedError,
        TimeoutError."""
        began = time.monotonic()
        robot, client = self._start()
        self._judge = self._keep(Judge(self._runtime, OBJECT))
        self._enable(client)
        self._start_up_s = time.monotonic() - began
        self._before = self._judge.snapshot(5.0)
        view = self._options.view
        window = self._children.start("tablet", _handrail("tablet", "--connect", client.address)) if view else None
        self._operator = self._keep(ScriptedOperator(client))
        self._turn(client, robot)
        if window and window.process.poll():
            self._show.note(f"the operator's window did not stay open\n{window.last_words()}")
        self._after = self._judge.snapshot(2.0)

    def _start(self) -> tuple[Child, Client]:
        self._show.phase("starting plant, daemon, engine and link")
        scene = self._out / "scene.yaml"
        scene.write_text(self._scenario.scene(), encoding="utf-8")
        port = free_ports()
        where = ["--runtime", str(self._runtime.folder), "--port", str(port)]
        where += ["--record", str((self._out / RECORDING).absolute())]
        if not self._options.view:
            where.append("--no-camera")  # nobody looks
        command = _handrail("up", ROBOT, "--scene", str(scene.absolute()), "--clock", self._options.clock, *where)
        robot = self._children.start("robot", command, on_line=self._show_start)
        robot.wait_for("All up", _START_S)
        return robot, self._keep(connect(f"tcp://127.0.0.1:{port}", timeout_s=10.0))

    def _show_start(self, line: str) -> None:
        if line and self._times is None:
            self._show.scene.phase = line

    def _enable(self, client: Client) -> None:
        self._show.phase("enabling the robot")
        client.enable(_ENABLE_S)

    def _turn(self, client: Client, robot: Child) -> None:
        assert self._judge is not None
        events = self._keep(client.events(RunState, DaemonStatus, LogLine))
        self._show.phase(f"placing the template {TEMPLATE} as {INSTANCE} and deploying {PROGRAM} on the {ARM} arm")
        client.place_instance(INSTANCE, TEMPLATE, self._scenario.instance_in_world)
        deployment = client.deploy(PROGRAM, BINDINGS)
        start = self._judge.latest
        if start is None:
            raise TimeoutError("the plant's ground truth was not heard, so nothing could be judged")
        scene = self._show.scene
        scene.start_angle, scene.started_plant_s, scene.started_wall_s = start.angle, start.time_s, time.monotonic()
        self._times = (start.time_s, scene.started_wall_s, start.time_s, scene.started_wall_s)
        self._show.phase(f"{PROGRAM} {deployment.hash[:12]} runs; the scripted operator approves its prompts")
        client.run(deployment)
        deadline = scene.started_wall_s + self._options.timeout_s
        while not (self._seen.run and self._seen.run.status in _OVER):
            if time.monotonic() > deadline:
                raise TimeoutError(f"the program was not over after {self._options.timeout_s:g} s")
            robot.check()
            event = events.next(_LOOK_S)
            if isinstance(event, LogLine):
                if event.level == "info" and event.source != FIRST:
                    continue  # the states that it enters are shown as they are
                self._show.note(f"{event.source}: {event.text}")
            elif event is not None:
                self._seen.note(event)
            self._look()
        self._show.phase("waiting for the valve to stand still")
        self._judge.wait_until(self._times[2] + SETTLE_S + 0.1, 20.0)
        for event in events.drain():
            if not isinstance(event, LogLine):
                self._seen.note(event)
        self._seen.note(client.status())

    def _look(self) -> None:
        """Bring what is shown, and the time of the program's end, up to date."""
        assert self._judge is not None and self._times is not None
        scene = self._show.scene
        scene.truth, scene.run, scene.status = self._judge.latest, self._seen.run, self._seen.status
        if scene.truth is not None:
            self._times = (*self._times[:2], scene.truth.time_s, time.monotonic())
        self._show.update()

    def _keep(self, what):  # type: ignore[no-untyped-def]
        """Close it when the attempt is over."""
        self._open.callback(what.close)
        return what

    def close(self) -> None:
        """End what this attempt opened, and the robot, so that its recording is whole."""
        self._open.close()
        self._children.end()

    def outcome(self) -> Outcome:
        """What it has come to, judged by the ground truth alone."""
        seen, scenario = self._seen, self._scenario
        samples = self._judge.samples if self._judge else []
        began_plant, began_wall, ended_plant, ended_wall = self._times or (0.0, 0.0, 0.0, 0.0)
        status = seen.run.status if seen.run else ""
        verdict: Verdict = judge(samples, began_plant, status)
        problems = [*self.problems, *verdict.problems] if self._times else self.problems
        if seen.run and seen.run.status != "succeeded" and seen.run.detail:
            problems.append(f"the program says: {seen.run.detail}")
        if self._operator:
            problems += [f"operator: {problem}" for problem in self._operator.problems]
        believed = seen.run.data.get("turned_deg") if seen.run else None
        recording = self._out / RECORDING
        row = Row(
            seed=scenario.seed,
            turned_deg=round(verdict.turned_deg, 2),
            success=verdict.success and not self.problems,
            peak_force_n=round(verdict.peak_force_n, 2),
            misses=seen.status.loop.misses if seen.status else 0,
            real_time_factor=round((ended_plant - began_plant) / max(ended_wall - began_wall, 1e-9), 3),
            drive_faults=len(seen.trouble),
            simulated_s=round(ended_plant - began_plant, 2),
            wall_s=round(ended_wall - began_wall, 2),
            start_up_s=round(self._start_up_s, 2),
            clock=self._options.clock,
            program=seen.run.detail or status if seen.run else "",
            believed_deg=float(believed) if isinstance(believed, int | float) else None,
            prompts=len(self._operator.answered) if self._operator else 0,
            position_error_mm=round(1000 * scenario.position_error, 1),
            angle_error_deg=round(math.degrees(scenario.angle_error), 2),
            problems=problems,
        )
        return Outcome(row, self._before, self._after, recording if recording.exists() else None)


def pictures(scene: Path, truths: Mapping[Path, GroundTruth], children: Children) -> None:
    """Draw the scene as the ground truth says, a picture for each file. Raises ChildDied when one can't be made."""
    with tempfile.TemporaryDirectory() as folder:
        painters = []
        for out, truth in truths.items():
            state = Path(folder) / f"{out.stem}.json"
            state.write_bytes(msgspec.json.encode(truth))
            where = ["--robot", ROBOT, "--scene", str(scene), "--state", str(state), "--out", str(out)]
            painters.append(children.start(out.stem, [sys.executable, "-m", "hal.plant.picture", *where]))
        for painter in painters:
            if status := painter.process.wait(240):
                raise ChildDied(f"no picture {painter.name}: status {status}\n{painter.last_words()}")


def free_ports() -> int:
    """A TCP port that is free now, and so is the next one."""
    while True:
        with socket.socket() as first, socket.socket() as second:
            first.bind(("127.0.0.1", 0))
            port: int = first.getsockname()[1]
            try:
                second.bind(("127.0.0.1", port + 1))
            except (OSError, OverflowError):
                continue
            return port


def _handrail(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "handrail.cli", *arguments]
