"""Whole-body control against TSID, placo and pin-pink, in turns in one run: ``handrail bench wbc``.

TALOS' upper body, 17 joints on a fixed base; 1, 3, 5, 10 and 15 tasks, one a level, the posture last; from a state to torques. Each
peer runs in a virtual environment of its own (made under the user's cache on first use, ~1.3 GB, from PyPI: their pinocchios
exclude each other), as a process that is asked in turns with ours for the same states. Ours keeps the tasks in strict order; the
peers weigh them; pin-pink computes velocities only.

Three sets of states: unrelated ones with torque bounds that are never reached; a path sampled at 1 kHz, and unrelated states, with
bounds so low that at least 30 % of the states have an active one.
"""

from __future__ import annotations

import contextlib
import gc
import json
import os
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from benchmarks.peers import environment
from benchmarks.rows import Row, against
from daemon.wbc.constraints import JointLimits
from daemon.wbc.hierarchy import WholeBody
from daemon.wbc.model import WholeBodyModel
from daemon.wbc.tasks import COM, SE3, CartPos, JPos, QuaternionOrientation, Task
from handrail.robot import library as robots

Array = NDArray[np.float64]

PEERS = {
    "tsid": ("tsid==1.7.1", "pin==3.4.0", "cmeel-urdfdom==4.0.1", "cmeel-tinyxml2==10.0.0"),
    "placo": ("placo==0.10.2",),
    "pink": ("pin-pink==4.4.0", "daqp==0.11.0"),
}
LEFT, RIGHT = "wrist_left_ft_tool_link", "wrist_right_ft_tool_link"
_FIFTEEN = [
    ("com", ""), ("pos", LEFT), ("pos", RIGHT), ("ori", LEFT), ("ori", RIGHT), ("ori", "torso_2_link"), ("ori", "head_1_link"),
    ("pos", "arm_left_4_link"), ("pos", "arm_right_4_link"), ("se3", "arm_left_5_link"), ("se3", "arm_right_5_link"),
    ("pos", "arm_left_2_link"), ("pos", "arm_right_2_link"), ("se3", "head_1_link"), ("posture", ""),
]  # fmt: skip
TASKS = {
    1: [("posture", "")],
    3: [("se3", LEFT), ("se3", RIGHT), ("posture", "")],
    5: [("pos", LEFT), ("pos", RIGHT), ("ori", LEFT), ("ori", RIGHT), ("posture", "")],
    10: [*_FIFTEEN[:9], ("posture", "")],
    15: _FIFTEEN,
}
AGREEING = 4
"""tasks whose errors TSID means as we do: it takes a pose's from the logarithm of the whole of it"""
_COMMON = {AGREEING: [("com", ""), ("ori", LEFT), ("ori", RIGHT), ("posture", "")]}
_KP = 100.0
_STATES, _CHUNK, _ROUNDS = 400, 50, 8
_AMPLE = 10.0
_TIGHT = (0.9, 0.8, 0.7, 0.6, 0.5, 0.45, 0.4, 0.35, 0.3, 0.25, 0.2)
"""of the rated torque: bounds that are never reached, and from which the first is taken that enough states reach"""
_ENOUGH = 0.3
_CASES = (("random", False), ("path", True), ("random", True))
"""states, and whether at bounds"""
_GOALS = {"tsid": 0.95, "placo": 0.6, "pink": 0.6}
_GOAL_AT_BOUNDS = 1.3
_EXACT, _AGREES = 1e-9, 1e-5
"""(m|rad)/s²; N·m, beside the 1e-8 that TSID adds to its program's diagonal"""


class Problem:
    """The robot, the states and the tasks' references, the same for all; as files for the peers."""

    def __init__(self, folder: Path):
        self.folder = folder
        description = robots.load("talos_upper")
        self.urdf = _bare(description.urdf, folder / "talos.urdf", locked="head_2_joint")
        self.model = pin.buildModelFromUrdf(str(self.urdf))
        home = dict(zip(description.joints, description.home_position(), strict=True))
        self.home = np.array([home[name] for name in self.model.names[1:]])
        rng = np.random.default_rng(0)
        low, high = self.model.lowerPositionLimit + 0.01, self.model.upperPositionLimit - 0.01
        n = self.model.nv
        q = np.clip(self.home + 0.1 * rng.standard_normal((_STATES, n)), low, high)
        random = np.stack((q, 0.2 * rng.standard_normal((_STATES, n))))
        t, hz = np.arange(_STATES)[:, None] * 1e-3, rng.uniform(0.3, 1.2, n)
        phase = rng.uniform(0.0, 2 * np.pi, n) + 2 * np.pi * hz * t
        path = np.stack((self.home + 0.15 * np.sin(phase), 0.15 * 2 * np.pi * hz * np.cos(phase)))
        path[0] = np.clip(path[0], low, high)
        self.states: dict[str, Array] = {"random": random, "path": path}
        for name, states in self.states.items():
            np.save(folder / f"{name}.npy", states)
        self.tasks = {
            count: [self._reference(kind, frame) for kind, frame in tasks]
            for count, tasks in {**TASKS, **_COMMON}.items()
        }
        (folder / "problem.json").write_text(
            json.dumps(
                {
                    "urdf": str(self.urdf), "home": self.home.tolist(), "joints": list(self.model.names[1:]),
                    "torque": self.model.effortLimit.tolist(), "states": list(self.states), "tasks": self.tasks,
                }
            )
        )  # fmt: skip

    def _reference(self, kind: str, frame: str) -> dict[str, Any]:
        """Near where the task's frame is at home."""
        data = self.model.createData()
        pin.framesForwardKinematics(self.model, data, self.home)
        if kind == "posture":
            return {"kind": kind}
        if kind == "com":
            return {
                "kind": kind,
                "position": (pin.centerOfMass(self.model, data, self.home) + np.array([0, 0.01, 0])).tolist(),
            }
        pose = data.oMf[self.model.getFrameId(frame)]
        position = pose.translation + np.array([0.02, 0.0, 0.02])
        return {"kind": kind, "frame": frame, "position": position.tolist(), "rotation": pose.rotation.tolist()}

    def ours(self, count: int, torque: float) -> tuple[WholeBodyModel, WholeBody]:
        """Our controller for so many tasks, one a level."""
        model = WholeBodyModel(self.model)
        model.update(self.home, np.zeros(model.nv))
        levels: list[list[Task]] = []
        for number, task in enumerate(self.tasks[count]):
            name, kind, frame = f"{number}", task["kind"], task.get("frame", "")
            made: Task
            if kind == "posture":
                made = JPos(name=name, stiffness=_KP)
            elif kind == "com":
                made = COM(name=name, stiffness=_KP)
            elif kind == "pos":
                made = CartPos(name=name, frame=frame, stiffness=_KP)
            elif kind == "ori":
                made = QuaternionOrientation(name=name, frame=frame, stiffness=_KP)
            else:
                made = SE3(name=name, frame=frame, stiffness=_KP)
            levels.append([made])
        body = WholeBody(model, levels, [JointLimits(position=False, velocity=False, torque=torque)])
        for number, task in enumerate(self.tasks[count]):
            if "position" in task:
                body[f"{number}"].pose(task["position"], np.array(task["rotation"]) if "rotation" in task else None)
        body.warm_up()
        return model, body


def _bare(source: Path, target: Path, locked: str) -> Path:
    """A URDF without looks and shapes, which no peer is to load, and with one joint locked."""
    tree = ET.parse(source)
    root = tree.getroot()
    for link in root.iter("link"):
        for tag in ("visual", "collision"):
            for element in link.findall(tag):
                link.remove(element)
    for joint in root.findall("joint"):
        if joint.get("name") == locked:
            joint.set("type", "fixed")
    tree.write(target)
    return target


class Peer:
    """A peer's process. Where it dies, it is `gone`: a note says so, and it has no rows from then on."""

    def __init__(self, name: str, problem: Problem):
        self.name, self.gone = name, False
        script = Path(__file__).with_name("wbc_peers.py")
        variables = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
        variables |= {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL")}
        self._process = subprocess.Popen(
            [environment(name, PEERS[name]) / "bin" / "python", script, name, problem.folder],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=variables, text=True,
        )  # fmt: skip

    def times(self, tasks: int, states: str, torque: float, first: int, last: int) -> list[float]:
        """Microseconds of each state; infinite where it is gone."""
        request = {"tasks": tasks, "states": states, "torque": torque, "from": first, "to": last}
        return self._ask(request) or [float("inf")] * (last - first)

    def torques(self, tasks: int, last: int, *, hard: bool = False) -> Array:
        """(last, n) N·m of the first unrelated states, no bound active; (0,) where it is gone. `hard`: the posture last."""
        ask = {
            "tasks": tasks,
            "states": "random",
            "torque": _AMPLE,
            "from": 0,
            "to": last,
            "torques": True,
            "hard": hard,
        }
        return np.array(self._ask(ask))

    def _ask(self, request: dict[str, Any]) -> list[Any]:
        if self.gone:
            return []
        assert self._process.stdin and self._process.stdout
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
        answer = self._process.stdout.readline()
        if not answer:
            self.gone = True
            print(
                f"wbc: {self.name} ended with {self._process.wait()}: no rows against it from here on", file=sys.stderr
            )
            return []
        found: list[Any] = json.loads(answer)
        return found

    def close(self) -> None:
        """End it."""
        self._process.kill()
        self._process.wait()


def peers(problem: Problem) -> list[Peer]:
    """Those that there are; a note about each that can't be had."""
    found = []
    for name in PEERS:
        try:
            found.append(Peer(name, problem))
        except (subprocess.CalledProcessError, OSError) as error:
            print(f"wbc: no rows against {name}: its environment can't be made: {error}", file=sys.stderr)
    return found


def times(problem: Problem, model: WholeBodyModel, body: WholeBody, states: str, first: int, last: int) -> list[float]:
    """Microseconds of each state, ours."""
    q, v = problem.states[states]
    found = []
    clock = time.perf_counter
    for i in range(first, last):
        begin = clock()
        model.update(q[i], v[i])
        body.solve()
        found.append((clock() - begin) * 1e6)
    return found


def _case(problem: Problem, others: list[Peer], count: int, states: str, torque: float) -> dict[str, Array]:
    """Name → microseconds of each state: the least of some rounds, in which all take turns."""
    model, body = problem.ours(count, torque)
    best = {name: np.full(_STATES, np.inf) for name in ("ours", *(peer.name for peer in others))}
    gc.collect()
    gc.disable()
    try:
        for chunk in range(0, _STATES, _CHUNK):
            span = slice(chunk, chunk + _CHUNK)
            for _ in range(_ROUNDS + 1):  # each one's first round finds it cold, and is never the least
                mine = times(problem, model, body, states, chunk, chunk + _CHUNK)
                best["ours"][span] = np.minimum(best["ours"][span], mine)
                for peer in others:
                    theirs = peer.times(count, states, torque, chunk, chunk + _CHUNK)
                    best[peer.name][span] = np.minimum(best[peer.name][span], theirs)
    finally:
        gc.enable()
    return {name: values for name, values in best.items() if np.isfinite(values).all()}


def tight(problem: Problem, count: int, states: str) -> tuple[float, float]:
    """(share of the rated torque, share of the states that then have an active bound): the first that is enough."""
    share = 0.0
    for torque in _TIGHT:
        model, body = problem.ours(count, torque)
        q, v = problem.states[states]
        active = 0
        for i in range(_STATES):
            model.update(q[i], v[i])
            active += body.solve().active > 0
        share = active / _STATES
        if share >= _ENOUGH:
            break
    return torque, share


def largest_residual(problem: Problem, count: int) -> float:
    """m/s², rad/s²: of all levels above the last that nothing stands in the way of, over all states."""
    model, body = problem.ours(count, _AMPLE)
    most = 0.0
    for q, v in zip(*problem.states["random"], strict=True):
        model.update(q, v)
        body.solve()
        for level in range(count - 1):
            if body.exact(level):
                most = max(most, float(np.abs(body.residual(f"{level}")).max()))
    return most


def torque_difference(problem: Problem, peer: Peer) -> float | None:
    """N·m, the largest between our torques and TSID's for the posture alone, where strict and weighted are the same."""
    theirs = peer.torques(1, 50)
    if not len(theirs):
        return None
    model, body = problem.ours(1, _AMPLE)
    most = 0.0
    for q, v, torque in zip(*problem.states["random"][:, :50], theirs, strict=True):
        model.update(q, v)
        most = max(most, float(np.abs(body.solve().torque - torque).max()))
    return most


def acceleration_difference(problem: Problem, peer: Peer) -> float | None:
    """m/s², rad/s²: the largest between ours and TSID's of the centre of mass and both hands' turning, the posture after them.

    Only these: what is left to the posture is nearest in the mass metric here and in the joints' own there.
    """
    theirs = peer.torques(AGREEING, 50, hard=True)
    if not len(theirs):
        return None
    controller, body = problem.ours(AGREEING, _AMPLE)
    model, data, most = problem.model, problem.model.createData(), 0.0
    for q, v, torque in zip(*problem.states["random"][:, :50], theirs, strict=True):
        controller.update(q, v)
        ours = body.solve().torque.copy()
        apart = pin.aba(model, data, q, v, torque).copy() - pin.aba(model, data, q, v, ours)
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        turning = [
            pin.getFrameJacobian(model, data, model.getFrameId(frame), pin.LOCAL_WORLD_ALIGNED)[3:]
            for frame in (LEFT, RIGHT)
        ]
        for jacobian in (pin.jacobianCenterOfMass(model, data, q), *turning):
            most = max(most, float(np.abs(jacobian @ apart).max()))
    return most


def rows() -> list[Row]:
    """Two rows (p50, p90) for each number of tasks, set of states and peer, and how exact the levels are. About a minute."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        problem = Problem(Path(folder))
        others = peers(problem)
        try:
            for peer in (peer for peer in others if peer.name == "tsid"):
                most = torque_difference(problem, peer)
                if most is not None:
                    holds = most <= _AGREES
                    found.append(
                        Row(
                            name="posture alone, torques less TSID's",
                            value=most,
                            unit="N·m",
                            goal=f"≤ {_AGREES:g}",
                            holds=holds,
                        )
                    )
                far = acceleration_difference(problem, peer)
                if far is not None:
                    what = "centre of mass and hands before the posture, accelerations less TSID's"
                    found.append(
                        Row(name=what, value=far, unit="(m|rad)/s²", goal=f"≤ {_EXACT:g}", holds=far <= _EXACT)
                    )
            for count in TASKS:
                for states, at_bounds in _CASES:
                    torque, share = tight(problem, count, states) if at_bounds else (_AMPLE, 0.0)
                    about = {"random": "unrelated states", "path": "a path"}[states]
                    about = f"{about}, {share:.0%} at bounds" if at_bounds else "no bound active"
                    chosen = [peer for peer in others if not peer.gone and (not at_bounds or peer.name == "tsid")]
                    measured = _case(problem, chosen, count, states, torque)
                    for name, values in measured.items():
                        if name == "ours":
                            continue
                        goal = _GOAL_AT_BOUNDS if at_bounds else _GOALS[name]
                        for percent in (50, 90):
                            mine, theirs = (float(np.percentile(x, percent)) for x in (measured["ours"], values))
                            label = f"{count} tasks, {about}, p{percent}"
                            found.append(against(label, mine, "µs", name, theirs, at_most=goal))
                if count > 1:
                    value = largest_residual(problem, count)
                    label = f"{count} tasks, what levels are missed by"
                    found.append(
                        Row(name=label, value=value, unit="(m|rad)/s²", goal=f"≤ {_EXACT:g}", holds=value <= _EXACT)
                    )
        finally:
            for peer in others:
                peer.close()
    return found
