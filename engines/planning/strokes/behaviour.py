"""Which arm, where to grasp and from which posture: choices for a whole behaviour, ranked by how much of it they can do.

"Each solution is ranked first by the percentage of the desired motion that is feasible and then ranked according to the joint-angle
cost" (SURROGATE, §III-E.1). Samples are arms, places of the arc around the template's joint, and the arm's posture branches there;
the motion is the tool's goals at every depth over the whole arc.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from engines.planning import constraints
from engines.planning.constraints import Constraint
from engines.planning.strokes.assessment import Assessor
from engines.planning.strokes.branch import Branch, BranchSearch, Probes, expected_force
from engines.planning.strokes.tip_solver import TipSolver
from engines.planning.strokes.visit import Visit
from engines.planning.waiting import go_on

Array = NDArray[np.float64]
Kept = NDArray[np.bool_]

_APART = 0.15
"""rad: postures at the same place that are nearer to each other are one branch"""
_JUDGED = 10
"""samples of an arm whose clearances are computed: those that reach most, then the cheapest"""


@dataclass(frozen=True)
class Choice:
    """One way to do a behaviour."""

    trajectory: str
    arm: str
    arc: float | None
    """rad about the template's joint, the arc's centre; None: there is no arc"""
    share: float
    """of the motion that is feasible, 0 to 1"""
    cost: float
    """rad, from where the arm's joints are to the posture in which the behaviour begins (Euclidean)"""
    lacks: str
    """the constraint that most of the rest misses, and with whom; empty where nothing is missed"""
    posture: Array
    """(m,) rad of the arm's joints, in which it begins"""


class BehaviourSearch:
    """Choices of one arm for one trajectory."""

    def __init__(self, visit: Visit, solver: TipSolver, assessor: Assessor, cancelled: Callable[[], bool]):
        self._visit, self._solver, self._assessor, self._cancelled = visit, solver, assessor, cancelled
        self._search = BranchSearch(visit, solver, assessor, cancelled)

    def choices(self, arcs: Array, starts: Array) -> list[Choice]:
        """For every arc, the best first: by share, then by cost. Raises Cancelled."""
        reached = [(*self._reached(branch), branch) for branch in self._branches(arcs, starts)]
        reached.sort(key=lambda one: (-one[1].mean(), self._cost(one[0])))
        found: dict[float, Choice] = {}
        for number, (probes, kept, branch) in enumerate(reached):
            if number >= _JUDGED and branch.arc in found:
                continue
            choice = self._choice(probes, kept, branch, judged=number < _JUDGED)
            best = found.get(branch.arc)
            if best is None or (-choice.share, choice.cost) < (-best.share, best.cost):
                found[branch.arc] = choice
        return sorted(found.values(), key=lambda choice: (-choice.share, choice.cost))

    def _branches(self, arcs: Array, starts: Array) -> Iterator[Branch]:
        for arc in arcs:
            known: list[Array] = []
            for start in starts:
                go_on(self._cancelled)
                branch = self._search.middle(float(arc), start)
                if all(np.abs(branch.contact - other).max() > _APART for other in known):
                    known.append(branch.contact)
                    yield branch

    def _cost(self, probes: Probes) -> float:
        return float(np.linalg.norm(probes.begin - self._assessor.start))

    def _reached(self, branch: Branch) -> tuple[Probes, Kept]:
        """The tool's goals, and which of them (k,) are met within limits, by a strong enough arm, without a jump."""
        go_on(self._cancelled)
        probes = self._search.probes(branch)
        measures = {
            constraints.REACH: probes.residual,
            constraints.TILT: probes.tilt,
            constraints.LIMIT_MARGIN: self._assessor.limit_room(probes.q),
            constraints.JOINT_STEP: probes.step,
        }
        return probes, np.logical_and.reduce([_kept(constraint, values) for constraint, values in measures.items()])

    def _choice(self, probes: Probes, kept: Kept, branch: Branch, *, judged: bool) -> Choice:
        """With what costs more to measure: torque, and who is near."""
        go_on(self._cancelled)
        missed: list[tuple[int, str]] = [(int((~kept).sum()), _words(probes, kept))]
        if judged and kept.any():
            rows = np.flatnonzero(kept)
            forces = np.zeros((len(probes.q), 3))
            size = expected_force(self._visit)
            for row in rows[probes.depth[rows] == 0]:
                forces[row] = self._visit.force(self._visit.contact, float(probes.angles[row]), size)
            for row in rows:
                static = self._assessor.static(probes.q[row : row + 1], forces[row : row + 1])
                weak = [constraint.name for constraint, value in static.items() if constraint.slack(value) < 0.0]
                if weak:
                    kept[row] = False
                    missed.append((1, weak[0]))
            rows = np.flatnonzero(kept)
            if len(rows):
                near = self._assessor.clearances(probes.q[rows], tool_may_touch=True)
                for constraint, found in near.items():
                    close = ~_kept(constraint, found.along)
                    missed += [(1, f"{constraint.name} ({found.pairs[row]})") for row in np.flatnonzero(close)]
                    kept[rows[close]] = False
        lacks: dict[str, int] = {}
        for count, words in missed:
            lacks[words] = lacks.get(words, 0) + count
        worst = max(lacks, key=lambda words: lacks[words])
        share = float(kept.mean())
        arc = branch.arc if self._visit.joint is not None else None
        return Choice(
            self._visit.trajectory.name, self._assessor.arm.name, arc, share, self._cost(probes),
            worst if share < 1.0 else "", probes.begin,
        )  # fmt: skip


def _kept(constraint: Constraint, values: Array) -> Kept:
    return np.array([constraint.slack(value) >= 0.0 for value in values.tolist()])


def _words(probes: Probes, kept: Kept) -> str:
    """What most of those miss that are not kept."""
    if kept.all():
        return ""
    counts = {
        constraints.REACH.name: int((~_kept(constraints.REACH, probes.residual)).sum()),
        constraints.TILT.name: int((~_kept(constraints.TILT, probes.tilt)).sum()),
        constraints.JOINT_STEP.name: int((~_kept(constraints.JOINT_STEP, probes.step)).sum()),
    }
    worst = max(counts, key=lambda name: counts[name])
    return worst if counts[worst] else constraints.LIMIT_MARGIN.name


def ranked(choices: Sequence[Choice]) -> list[Choice]:
    """Of several arms and trajectories, the best first: by share, then by cost."""
    return sorted(choices, key=lambda choice: (-round(choice.share, 3), choice.cost))
