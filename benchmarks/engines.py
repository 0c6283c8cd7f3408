"""What an engine adds between one motion and the next, and how long programs take to load: ``handrail bench engines``. 2 minutes.

The engine is a process as it is on a robot; a stand-in for the daemon, on the same ZeroMQ bus with the same messages, tells that an
action has ended as the loop's end condition would, and takes the time until it has accepted the next state's action. py_trees ticks
the same chain over that bus, at the rate that it is given, in a process of its own. Other figures of engines have their own
functions in `MEASURED`: add one that returns rows.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from benchmarks import nodes
from benchmarks.deploying import deploying
from benchmarks.peers import environment
from benchmarks.rows import Row
from engines.programs import program
from engines.programs.statechart import Chart
from handrail import messages as m
from handrail.demo.children import Children
from handrail.robot import library as robots
from handrail.runtime import Runtime, memory_folder
from handrail.topics import Caller, Publisher, Service

ROBOT = "talos_upper"
MOTIONS, TURNS = 150, 3
TICK_MS = 10.0
P50_MS, P99_MS = 3.0, 10.0
DEPLOYED = 300
"""states"""
STATES, LOAD_S = 1000, 2.0
_PEER = ("py-trees==2.6.0",)
_LASTS_S, _TELLS_S = 0.02, 0.02
_START_S, _PATIENCE_S = 180.0, 120.0
_CHAIN = """\
title: One motion after the other
resources: {{arm: {{kind: arm}}}}
variables: {{n: 1}}
states:
  one: &motion
    do: control
    with: {{compound: hand, arm: arm, references: [], duration: 1}}
    transitions:
      - {{event: done.invoke.one, cond: n < {motions}, target: other, set: {{n: n + 1}}}}
      - {{event: done.invoke.one, target: good}}
      - {{event: error.execution, target: bad}}
  other:
    <<: *motion
    transitions:
      - {{event: done.invoke.other, cond: n < {motions}, target: one, set: {{n: n + 1}}}}
      - {{event: done.invoke.other, target: good}}
      - {{event: error.execution, target: bad}}
  good: {{final: true, outcome: succeeded}}
  bad: {{final: true, outcome: failed, detail: "{{failure}}"}}
"""


def rows() -> list[Row]:
    """All of them."""
    return [row for measured in MEASURED for row in measured()]


def reaction() -> list[Row]:
    """From the end of one state's motion to the acceptance of the next state's action: ours, and py_trees'."""
    with tempfile.TemporaryDirectory(dir=memory_folder(), prefix="handrail-bench-") as folder:
        workspace = Path(folder) / "workspace" / "rtc_programs"
        workspace.mkdir(parents=True)
        (workspace / "chain.yaml").write_text(_CHAIN.format(motions=MOTIONS))
        with _Daemon(Runtime.at(Path(folder) / "run")) as daemon, _engine(daemon.runtime, workspace.parent) as engine:
            ours: list[float] = []
            theirs: list[float] = []
            for _ in range(TURNS):
                ours += daemon.gaps_of(lambda: _run_chain(engine))
                theirs += daemon.gaps_of(lambda: _run_tree(daemon))
    found = []
    for percent, most in ((50, P50_MS), (99, P99_MS)):
        value, peer = (float(np.percentile(gaps, percent)) * 1e3 for gaps in (ours, theirs))
        found.append(
            Row(name=f"end of a motion to the next one accepted, p{percent}", value=round(value, 2), unit="ms",
                goal=f"≤ {most:g}", holds=value <= most, peer=f"py_trees at {1e3 / TICK_MS:g} Hz", peer_value=round(peer, 2),
                ratio=round(value / peer, 3))
        )  # fmt: skip
    return found


def loading() -> list[Row]:
    """A long program from its file to a statechart that runs: processor time of this process."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "long.yaml"
        file.write_text(long_program(STATES))
        began = time.process_time()
        found = program.read(file)
        read = time.process_time()
        Chart(found, {**found.variables, "arm": "left"}, _no_activity)
        built = time.process_time()
    return [
        Row(name=f"a program of {STATES} states read and checked", value=round(read - began, 2), unit="s",
            goal=f"≤ {LOAD_S:g}", holds=read - began <= LOAD_S),
        Row(name="the same made a statechart, too", value=round(built - began, 2), unit="s", goal=f"≤ {LOAD_S:g}",
            holds=built - began <= LOAD_S),
    ]  # fmt: skip


def one_line() -> list[Row]:
    """A line of a 100 KB program on its way to the engine."""
    text = long_program(DEPLOYED)
    return deploying(ROBOT, text, text.replace("title: Step 100\n", "title: Step 100, once more\n"))


MEASURED: tuple[Callable[[], list[Row]], ...] = (loading, reaction, one_line, nodes.rows)


def long_program(states: int) -> str:
    """A chain of prompts, three ways out of each."""
    lines = ["title: Long", "variables: {n: 0, why: ''}", "states:"]
    for k in range(states - 2):
        following = f"s{k + 1}" if k < states - 3 else "done"
        lines += [
            f"  s{k}:",
            f"    title: Step {k}",
            "    do: prompt",
            f'    with: {{text: "step {k} of {{n}}", options: [go, stay]}}',
            "    transitions:",
            f"      - {{event: done.invoke.s{k}, cond: _event.data.answer == 'go', target: {following}, set: {{n: n + 1}}}}",
            f"      - {{event: done.invoke.s{k}, target: failed}}",
            "      - {event: error.execution, target: failed, set: {why: failure}}",
        ]
    lines += ["  done: {final: true, outcome: succeeded}", "  failed: {final: true, outcome: failed, detail: '{why}'}"]
    return "\n".join(lines) + "\n"


def _no_activity(state: object, values: object) -> Any:
    raise AssertionError("nothing is run here")


@contextmanager
def _engine(runtime: Runtime, workspace: Path) -> Iterator[Caller]:
    before = os.environ.get("HANDRAIL_WORKSPACE")
    os.environ["HANDRAIL_WORKSPACE"] = str(workspace)
    command = [sys.executable, "-m", "engines.engine", "--robot", ROBOT, "--runtime", str(runtime.folder)]
    try:
        with (
            Children(runtime.folder / "logs") as children,
            closing(Caller(runtime.endpoint("engine.call"), timeout_s=30.0)) as engine,
        ):
            children.start("engine", command).wait_for("engine ready", _START_S)
            yield engine
    finally:
        os.environ.pop("HANDRAIL_WORKSPACE")
        if before is not None:
            os.environ["HANDRAIL_WORKSPACE"] = before


def _run_chain(engine: Caller) -> None:
    arm = next(iter(robots.load(ROBOT).arms))
    deployed = engine.call(m.Deploy(program="chain", bindings={"arm": arm}))
    engine.call(m.Run(deployment=deployed.id))
    gives_up = time.monotonic() + _PATIENCE_S
    while (run := engine.call(m.GetEngine()).run).status in ("ready", "running"):
        if time.monotonic() > gives_up:
            raise TimeoutError(f"the chain has not ended within {_PATIENCE_S:g} s: {run}")
        time.sleep(0.2)
    if run.status != "succeeded":
        raise RuntimeError(f"the chain has {run.status}: {run.detail}")


def _run_tree(daemon: _Daemon) -> None:
    folder = environment("py_trees", _PEER)
    packages = next((folder / "lib").glob("python*/site-packages"))
    script = str(Path(__file__).with_name("engines_peer.py"))
    motion = daemon.motion.decode()
    subprocess.run(
        [sys.executable, script, str(daemon.runtime.folder), motion, str(MOTIONS), str(TICK_MS)],
        check=True, env={**os.environ, "PYTHONPATH": os.pathsep.join([*sys.path, str(packages)])}, timeout=_PATIENCE_S,
    )  # fmt: skip


class _Daemon:
    """Stands in for daemon and loop: each action ends by itself soon after it was accepted."""

    def __init__(self, runtime: Runtime):
        self.runtime = runtime
        self.motion = b""
        """JSON of the last motion that came"""
        self._joints = len(robots.load(ROBOT).joints)
        self._gaps: list[float] = []
        self._action, self._due, self._ended = "", 0.0, 0.0
        self._epoch = 0
        self._ending, self._ready = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> _Daemon:
        self._thread.start()
        self._ready.wait()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join()

    def gaps_of(self, work: Callable[[], None]) -> list[float]:
        """s each between the end of one action and the acceptance of the next, while some work goes on."""
        self._gaps, self._ended = [], 0.0
        work()
        return self._gaps

    def _serve(self) -> None:
        service = Service(self.runtime.endpoint("daemon.call"), m.DaemonCall, self._answer)
        publisher = Publisher(self.runtime.endpoint("daemon.events"))
        self._ready.set()
        tells = time.perf_counter()
        while not self._ending.is_set():
            next_ = min(tells, self._due) if self._action else tells
            service.poll(max(0.0, next_ - time.perf_counter()))
            now = time.perf_counter()
            if self._action and now >= self._due:
                publisher.send(self._event(self._action))
                self._action, self._ended = "", time.perf_counter()
            if now >= tells:
                publisher.send(self._state())
                tells = now + _TELLS_S
        service.close()
        publisher.close()

    def _answer(self, call: Any) -> Any:
        if isinstance(call, m.TakeLease):
            self._epoch += 1
            return m.Lease(part=call.part, owner=call.owner, epoch=self._epoch, sequence=0)
        if isinstance(call, m.StartAction):
            now = time.perf_counter()
            if self._ended:
                self._gaps.append(now - self._ended)
            self._action, self._due = call.id, now + _LASTS_S
            self.motion = msgspec.json.encode(call.motion)
        return None

    def _state(self) -> m.RobotState:
        at = [0.0] * self._joints
        return m.RobotState(
            time_ns=time.perf_counter_ns(), cycle=0, position=at, velocity=at, torque=at, command=at
        )  # fmt: skip

    def _event(self, action: str) -> m.ActionEvent:
        at = [0.0] * self._joints
        return m.ActionEvent(
            id=action, state="ended", outcome="done", time_ns=time.perf_counter_ns(), cycle=0, position=at, command=at
        )  # fmt: skip
