"""Reaches (`reach`); inverse kinematics against Drake (SNOPT), placo, pin-pink, in turns in one run: ``handrail bench planning``.

All of TALOS on a free base but for head and grippers, 34 degrees of freedom: both feet where they are, the centre of mass over
them, the right hand at a pose, joints within limits, nearest to half sitting. 200 poses that configurations have. Once as one
configuration (ours from up to 5 starts, Drake from one), once as a trajectory of five knots that ends there (both from up to two
starts: standing still; then straight to a configuration at the goal, which each finds by itself from up to three).
Success is judged alike for all, by the checker: 1 mm and 10 mrad, at every knot. Each peer runs in a virtual environment of its own
(made under the user's cache on first use, from PyPI), as a process that is asked in turns with ours; of the peers' time only
solving counts, of ours everything from the question to the checked answer.
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

from benchmarks import reach
from benchmarks.peers import environment
from benchmarks.rows import Row, against
from engines.planning.ik.constraints import Balance, Constraint, Pose
from engines.planning.ik.mechanism import Mechanism
from engines.planning.ik.report import Measure
from engines.planning.ik.solver import Solver
from engines.planning.ik.spline import Spline
from engines.planning.ik.trajectory import TrajectorySolver
from handrail.messages import Pose as PoseMessage
from handrail.robot import library as robots

Array = NDArray[np.float64]

PEERS = {"drake": ("drake==1.51.1",), "placo": ("placo==0.10.2",), "pink": ("pin-pink==4.4.0", "daqp==0.11.0")}
HAND, FEET = "gripper_right_base_link", ("left_sole_link", "right_sole_link")
_HOME = {
    "leg_{}_3_joint": -0.411354, "leg_{}_4_joint": 0.859395, "leg_{}_5_joint": -0.448041, "arm_{}_4_joint": -0.525366,
    "arm_left_1_joint": 0.25847, "arm_right_1_joint": -0.25847, "arm_left_2_joint": 0.173046, "arm_right_2_joint": -0.173046,
}  # fmt: skip
_TARGETS, _CHUNK, _SEED = 200, 10, 2026
_LENGTH, _ANGLE = 1e-3, 1e-2
"""m, rad: what the judge lets pass"""
_KNOTS = (0.0, 0.5, 1.0, 1.5, 2.0)
_SMOOTH = (0.05, 0.01)
"""weights of squared velocities and accelerations"""


class Problem:
    """The robot and the targets, the same for all; as files for the peers."""

    def __init__(self, folder: Path, targets: int = _TARGETS):
        urdf = folder / "talos.urdf"
        _bare(robots.load("talos").urdf, urdf)
        self.mechanism = mechanism = Mechanism.from_urdf(str(urdf), free_base=True)
        angles = {name.format(side): value for name, value in _HOME.items() for side in ("left", "right")}
        self.home = mechanism.configuration(np.array([angles.get(joint, 0.0) for joint in mechanism.joints]))
        self._data = mechanism.model.createData()
        self.home[2] -= self._frame(self.home, FEET[0]).translation[2]
        feet = [self._frame(self.home, foot) for foot in FEET]
        middle = (feet[0].translation + feet[1].translation)[:2] / 2
        half = np.array([0.06, abs(feet[0].translation[1] - feet[1].translation[1]) / 2 + 0.02])
        self.low, self.high = middle - half, middle + half
        self.targets = self._reachable(targets)
        corners = [(self.low[0], self.low[1], 0.0), (self.high[0], self.low[1], 0.0)]
        corners += [(self.high[0], self.high[1], 0.0), (self.low[0], self.high[1], 0.0)]
        self.always: list[Constraint] = [
            Pose(frame=name, target=_message(foot)) for name, foot in zip(FEET, feet, strict=True)
        ]
        self.always.append(Balance(contacts={"": corners}))
        spline = Spline(np.array(_KNOTS))
        over = np.eye(len(_KNOTS)) + _SMOOTH[0] * spline.velocity.T @ spline.velocity
        over += _SMOOTH[1] * spline.acceleration.T @ spline.acceleration
        base = pin.XYZQUATToSE3(self.home[:7])
        content = {
            "urdf": str(urdf), "joints": mechanism.joints, "home": self.home[mechanism.q_rows].tolist(),
            "base_position": base.translation.tolist(), "base_rotation": base.rotation.tolist(), "hand": HAND,
            "feet": [{"frame": name, **_plain(foot)} for name, foot in zip(FEET, feet, strict=True)],
            "support": [self.low.tolist(), self.high.tolist()], "targets": [_plain(target) for target in self.targets],
            "smooth": over[1:, 1:].tolist(),
        }  # fmt: skip
        (folder / "problem.json").write_text(json.dumps(content))

    def _frame(self, q: Array, name: str) -> pin.SE3:
        pin.framesForwardKinematics(self.mechanism.model, self._data, q)
        return pin.SE3(self._data.oMf[self.mechanism.frame_id(name)])

    def _reachable(self, count: int) -> list[pin.SE3]:
        """Hand poses of random postures of arm and torso that keep the centre of mass over the feet."""
        generator, mechanism = np.random.default_rng(_SEED), self.mechanism
        moved = [j for j in mechanism.joints if j.startswith(("torso", "arm_right"))]
        rows = [mechanism.row(joint) for joint in moved]
        middle, half = ((mechanism.upper[rows] + s * mechanism.lower[rows]) / 2 for s in (1, -1))
        found: list[pin.SE3] = []
        while len(found) < count:
            q = self.home.copy()
            q[mechanism.coordinate[rows]] = middle + 0.7 * half * generator.uniform(-1.0, 1.0, len(rows))
            com = pin.centerOfMass(mechanism.model, self._data, q)[:2]
            if (com > self.low + 0.005).all() and (com < self.high - 0.005).all():
                found.append(self._frame(q, HAND))
        return found

    def goal(self, number: int, when: float | None = None) -> Pose:
        """The hand's pose; in a trajectory at its end."""
        window = {} if when is None else {"window": (when, when)}
        return Pose(frame=HAND, target=_message(self.targets[number]), **window)  # type: ignore[arg-type]

    def kept(self, solver: Solver, number: int, configurations: list[Array]) -> bool:
        """Whether all configurations keep what always holds, and the last one the goal."""
        for place, q in enumerate(configurations):
            last = place == len(configurations) - 1
            constraints = [*self.always, self.goal(number)] if last else self.always
            if not np.isfinite(q).all() or any(map(_too_much, solver.checker.measures(constraints, q))):
                return False
        return True

    def configuration(self, pose: list[list[float]], joints: list[float]) -> Array:
        """A peer's answer."""
        matrix = np.array(pose)
        return self.mechanism.configuration(np.array(joints), pin.SE3(matrix[:3, :3], matrix[:3, 3]))


def _too_much(measure: Measure) -> bool:
    return not measure.by <= (_ANGLE if measure.unit == "rad" else _LENGTH)


def _message(placement: pin.SE3) -> PoseMessage:
    position, turn = placement.translation.tolist(), pin.Quaternion(placement.rotation).coeffs().tolist()
    return PoseMessage(position=tuple(position), orientation=tuple(turn))


def _plain(placement: pin.SE3) -> dict[str, Any]:
    return {"position": placement.translation.tolist(), "rotation": placement.rotation.tolist()}


def _bare(source: Path, target: Path) -> None:
    """A URDF without looks and shapes, which no peer is to load, and with head and grippers fixed."""
    tree = ET.parse(source)
    root = tree.getroot()
    for element in list(root):
        if element.tag not in ("link", "joint"):
            root.remove(element)
    for link in root.iter("link"):
        for tag in ("visual", "collision"):
            for element in link.findall(tag):
                link.remove(element)
    for joint in root.findall("joint"):
        for tag in ("mimic", "dynamics", "safety_controller", "calibration"):
            for element in joint.findall(tag):
                joint.remove(element)
        if not joint.get("name", "").startswith(("leg_", "arm_", "torso_")):
            joint.set("type", "fixed")
    tree.write(target)


class Peer:
    """A peer's process. Where it dies, it is `gone`: a note says so, and it has no rows from then on."""

    def __init__(self, name: str, folder: Path):
        self.name, self.gone = name, False
        script = Path(__file__).with_name("planning_peers.py")
        variables = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
        variables |= {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL")}
        self._process = subprocess.Popen(
            [environment(name, PEERS[name]) / "bin" / "python", script, name, folder],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=variables, text=True,
        )  # fmt: skip

    def answers(self, knots: int, first: int, last: int) -> list[dict[str, Any]]:
        """Seconds and configurations for targets first to last; none where it is gone."""
        if self.gone:
            return []
        assert self._process.stdin and self._process.stdout
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.write(json.dumps({"knots": knots, "from": first, "to": last}) + "\n")
            self._process.stdin.flush()
        answer = self._process.stdout.readline()
        if not answer:
            self.gone = True
            print(f"planning: {self.name} ended with {self._process.wait()}: no rows against it", file=sys.stderr)
            return []
        found: list[dict[str, Any]] = json.loads(answer)
        return found

    def close(self) -> None:
        """End it."""
        self._process.kill()
        self._process.wait()


def _measured(
    problem: Problem, solver: Solver, peers: list[Peer], knots: int
) -> tuple[dict[str, list[float]], dict[str, list[bool]]]:
    """Name → milliseconds of each target, and whether its answer is one."""
    trajectories = TrajectorySolver(solver)
    times: dict[str, list[float]] = {name: [] for name in ("ours", *(peer.name for peer in peers))}
    kept: dict[str, list[bool]] = {name: [] for name in times}
    for first in range(
        -_CHUNK, len(problem.targets), _CHUNK
    ):  # the first round finds everyone cold, and does not count
        chosen = range(max(first, 0), max(first, 0) + _CHUNK)
        answers: list[tuple[str, int, float, list[Array]]] = []
        gc.collect()
        for number in chosen:
            begin = time.perf_counter()
            if knots == 1:
                configurations = [solver.solve([*problem.always, problem.goal(number)], problem.home, starts=5).q]
            else:
                goal = problem.goal(number, _KNOTS[-1])
                found = trajectories.solve(
                    [*problem.always, goal],
                    problem.home,
                    _KNOTS,
                    velocity=_SMOOTH[0],
                    acceleration=_SMOOTH[1],
                    starts=2,
                )
                configurations = list(found.at(found.times[1:]))
            answers.append(("ours", number, time.perf_counter() - begin, configurations))
        for peer in peers:
            for number, one in zip(chosen, peer.answers(knots, chosen[0], chosen[-1] + 1), strict=False):
                answers.append(
                    (peer.name, number, one["seconds"], [problem.configuration(*found) for found in one["found"]])
                )
        if first >= 0:
            for name, number, seconds, configurations in answers:
                times[name].append(1e3 * seconds)
                kept[name].append(problem.kept(solver, number, configurations))
    return times, kept


def rows() -> list[Row]:
    """Times and successes of whole reaches, of one configuration, and of five knots. About five minutes."""
    found: list[Row] = reach.rows()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        problem = Problem(folder)
        solver = Solver(problem.mechanism)
        others: list[Peer] = []
        try:
            for peer in PEERS:
                try:
                    others.append(Peer(peer, folder))
                except (subprocess.CalledProcessError, OSError) as error:
                    found.append(_missing(peer, str(error)))
            for knots in (1, len(_KNOTS)):
                chosen = [one for one in others if not one.gone and (knots == 1 or one.name == "drake")]
                found += _case(problem, solver, chosen, knots)
        finally:
            for one in others:
                one.close()
    return found


def _case(problem: Problem, solver: Solver, peers: list[Peer], knots: int) -> list[Row]:
    times, kept = _measured(problem, solver, peers, knots)
    what = "one configuration" if knots == 1 else f"{knots} knots"
    mine, share = times["ours"], 100.0 * float(np.mean(kept["ours"]))
    found = [Row(name=f"{what}, p90", value=round(float(np.percentile(mine, 90)), 2), unit="ms", goal="—", holds=True)]
    if knots == 1:
        found.append(Row(name=f"{what}, success", value=share, unit="%", goal="≥ 99.5 %", holds=share >= 99.5))
    for peer in peers:
        if peer.gone:
            found.append(_missing(peer.name, "it ended"))
            continue
        theirs, their_share = float(np.median(times[peer.name])), 100.0 * float(np.mean(kept[peer.name]))
        if peer.name == "drake":
            most, margin = (0.08, 0.0) if knots == 1 else (0.06, 5.0)
            found.append(against(f"{what}, median", float(np.median(mine)), "ms", peer.name, theirs, at_most=most))
        else:
            margin = 0.0
            found.append(_beside(f"{what}, median", float(np.median(mine)), "ms", peer.name, theirs, "—", True))
        goal = f"≥ its {f'+ {margin:g}' if margin else ''}".rstrip()
        holds = share >= min(their_share + margin, 100.0)
        found.append(_beside(f"{what}, success", share, "%", peer.name, their_share, goal, holds))
    return found


def _beside(name: str, value: float, unit: str, peer: str, its: float, goal: str, holds: bool) -> Row:
    ratio = round(value / its, 4) if its else None
    return Row(
        name=name, value=round(value, 3), unit=unit, goal=goal, holds=holds, peer=peer, peer_value=round(its, 3), ratio=ratio
    )  # fmt: skip


def _missing(peer: str, why: str) -> Row:
    """A peer that could not be measured: its goals are not met."""
    print(f"planning: no rows against {peer}: {why}", file=sys.stderr)
    return Row(name=f"{peer} could not be measured", value=0.0, unit="", goal="measured", holds=False, peer=peer)
