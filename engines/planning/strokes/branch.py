"""Which arc about the template's joint, and which posture branch of the arm, for a whole stroke.

Every arc centre is tried from every start; the tip's goals at several angles and depths are solved outwards from the arc's middle,
so that all of them lie on one branch, and the least slack over all constraints ranks it. Cheap measures come first: a branch that
can no longer beat the best is given up before its clearances are computed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from engines.planning import constraints
from engines.planning.constraints import Constraint
from engines.planning.plan import Infeasible
from engines.planning.strokes.assessment import Assessor
from engines.planning.strokes.tip_solver import Reach, TipSolver
from engines.planning.strokes.visit import Visit
from engines.planning.waiting import go_on

Array = NDArray[np.float64]

_GOOD_ENOUGH = 0.38
"""merit at which the search ends: every constraint is kept with over a third of its scale to spare"""
_PROBE_SPACING = np.deg2rad(15.0)
_CONTACT_FORCE = 0.5
"""of the path force's limit: what pushing is expected to take"""


@dataclass(frozen=True)
class Branch:
    """One arc with one posture branch."""

    arc: float
    """rad about the template's joint, the arc's centre"""
    posture: Array
    """(m,) rad, the reference that keeps solutions on the branch"""
    contact: Array
    """(m,) rad at the arc's centre, the tool at the contact"""
    merit: float
    failure: Infeasible | None
    """the constraint that is missed most, None when all are kept"""


@dataclass(frozen=True)
class Probes:
    """Goals of the tool over an arc at every depth, k of them, and an arm's postures there."""

    q: Array
    """(k, m) rad"""
    residual: Array
    """(k,) m"""
    tilt: Array
    """(k,) rad"""
    step: Array
    """(k,) rad, the joints' largest from the goal before, or from the same angle's contact"""
    angles: Array
    """(k,) rad about the template's joint"""
    depth: NDArray[np.int64]
    """(k,) which station of the visit; 0: the contact"""
    begin: Array
    """(m,) rad, at the standoff by the arc's beginning"""


def expected_force(visit: Visit) -> float:
    """N that the object is expected to resist with along its joint."""
    limits = [w.path_force[1] for w in visit.trajectory.waypoints if w.path_force is not None]
    return _CONTACT_FORCE * max(limits, default=0.0)


class BranchSearch:
    """Ranks branches for a visit."""

    def __init__(self, visit: Visit, solver: TipSolver, assessor: Assessor, cancelled: Callable[[], bool]):
        self._visit, self._solver, self._assessor, self._cancelled = visit, solver, assessor, cancelled

    def ranked(self, arcs: Array, starts: Array) -> list[Branch]:
        """Branches, best first. Raises Cancelled."""
        middles = [self.middle(arc, start) for arc in arcs for start in starts]
        middles.sort(key=lambda branch: -branch.merit)
        if middles[0].merit < 0.0:
            return middles[:1]
        found: list[Branch] = []
        for middle in middles:
            best = max((branch.merit for branch in found), default=-np.inf)
            if best >= _GOOD_ENOUGH or middle.merit <= best:
                break
            branch = self._whole(middle, best)
            if branch is not None:
                found.append(branch)
        return sorted(found, key=lambda branch: -branch.merit)

    def middle(self, arc: float, start: Array) -> Branch:
        """The branch judged by its posture at the arc's centre alone: no worse than the whole of it."""
        go_on(self._cancelled)
        reach = self._solver.solve(start, *self._visit.tip(self._visit.contact, arc), start)
        measures = self._reach_measures(reach)
        where = f"at {self._visit.contact.name}"
        merit = constraints.merit(measures)
        return Branch(float(arc), start, reach.q[0], merit, constraints.worst(measures, where))

    def _reach_measures(self, *reaches: Reach) -> dict[Constraint, float]:
        q = np.vstack([reach.q for reach in reaches])
        return {
            self._assessor.leeway.reach: max(float(reach.residual.max()) for reach in reaches),
            self._assessor.leeway.tilt: max(float(reach.tilt.max()) for reach in reaches),
            constraints.LIMIT_MARGIN: self._assessor.limit_margin(q),
        }

    def _whole(self, middle: Branch, best: float) -> Branch | None:
        """The branch judged over its whole arc and all depths; None as soon as it can't beat `best`."""
        go_on(self._cancelled)
        measures: dict[Constraint, float] = {}
        detail: dict[Constraint, str] = {}
        for part, words in self._measured(middle):
            measures.update(part)
            detail.update(words)
            if constraints.merit(measures) <= best:
                return None
        merit = constraints.merit(measures)
        failure = constraints.worst(measures, "over the arc", detail)
        return Branch(middle.arc, middle.posture, middle.contact, merit, failure)

    def probes(self, middle: Branch) -> Probes:
        """The tool's goals of the whole behaviour, and the postures of a branch at them."""
        contact, deeper, angles = self._probes(middle)
        stations = [contact, *deeper]
        q = np.array([reach.q for reach in stations])
        step = np.zeros(q.shape[:2])
        step[0, 1:] = np.abs(np.diff(contact.q, axis=0)).max(axis=1, initial=0.0)
        step[1:] = np.abs(q[1:] - q[0]).max(axis=2)
        begin = next(k for k, one in enumerate(self._visit.stations) if one.name == self._visit.standoff.name)
        return Probes(
            q.reshape(-1, q.shape[2]),
            np.concatenate([reach.residual for reach in stations]),
            np.concatenate([reach.tilt for reach in stations]),
            step.reshape(-1),
            np.tile(angles, len(stations)),
            np.repeat(np.arange(len(stations)), len(angles)),
            q[begin, 0],
        )

    def _measured(self, middle: Branch) -> Iterator[tuple[dict[Constraint, float], dict[Constraint, str]]]:
        contact, deeper, angles = self._probes(middle)
        steps = [np.abs(np.diff(contact.q, axis=0)).max(initial=0.0)]
        steps += [np.abs(reach.q - contact.q).max() for reach in deeper]
        yield {**self._reach_measures(contact, *deeper), constraints.JOINT_STEP: float(max(steps))}, {}
        size = expected_force(self._visit)
        forces = np.array([self._visit.force(self._visit.contact, angle, size) for angle in angles])
        yield self._assessor.static(contact.q, forces), {}
        q = np.vstack([contact.q, *(reach.q for reach in deeper)])
        found = self._assessor.clearances(q, tool_may_touch=True)
        yield {c: one.distance for c, one in found.items()}, {c: one.between for c, one in found.items()}

    def _probes(self, middle: Branch) -> tuple[Reach, list[Reach], Array]:
        """Solutions at the contact over the arc's angles, at every other station from there, and the angles."""
        visit, solver = self._visit, self._solver
        half = max(1, int(np.ceil(visit.span / 2 / _PROBE_SPACING))) if visit.span > 0.0 else 0
        angles = middle.arc + np.linspace(-visit.span / 2, visit.span / 2, 2 * half + 1)
        goals = visit.tips(visit.contact, angles)
        up = solver.track(middle.contact, goals.positions[half:], goals.axes[half:], middle.posture)
        down = solver.track(middle.contact, goals.positions[half::-1], goals.axes[half::-1], middle.posture)
        contact = Reach(
            np.vstack([down.q[:0:-1], up.q]),
            np.concatenate([down.residual[:0:-1], up.residual]),
            np.concatenate([down.tilt[:0:-1], up.tilt]),
        )
        deeper = []
        for station in visit.stations[1:]:
            goals = visit.tips(station, angles)
            deeper.append(solver.solve_each(contact.q, goals.positions, goals.axes, middle.posture))
        return contact, deeper, angles
