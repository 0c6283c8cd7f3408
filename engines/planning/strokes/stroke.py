"""Which way to the object, and through all its waypoints: the legs of one stroke."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from engines.planning.plan import Infeasible
from engines.planning.strokes.assessment import Assessor
from engines.planning.strokes.branch import Branch, BranchSearch
from engines.planning.strokes.path import Leg, PathBuilder
from engines.planning.strokes.tip_solver import TipSolver, starts
from engines.planning.strokes.visit import Visit

Array = NDArray[np.float64]

ARCS, STARTS, _TRIES = 8, 10, 4
"""arc centres around the joint, postures to start from at each, branches to build a way on before giving up"""
_BESIDE = 0.02
"""m: so close to the circle on which the trajectory runs the tool counts as being at the object"""


class Stroke:
    """One visit of one arm from where it is."""

    def __init__(
        self,
        visit: Visit,
        solver: TipSolver,
        assessor: Assessor,
        home: Array,
        cancelled: Callable[[], bool],
        progress: Callable[[str], None],
    ):
        """`home` (m,) rad: a posture of the arm to search from."""
        self._visit, self._solver, self._assessor, self._home = visit, solver, assessor, home
        self._cancelled, self._progress = cancelled, progress

    def legs(self, arc: float | None, entry_shift: float) -> tuple[list[Leg], dict[str, float]]:
        """The legs, and the plan's outputs. The first way that keeps all constraints; else the first one's failure is raised."""
        first: Infeasible | None = None
        for attempt in self._attempts(arc, entry_shift):
            try:
                return attempt()
            except Infeasible as problem:
                first = first or problem
        raise first or Infeasible("way", 0.0, "m", detail="was not found")

    def _attempts(
        self, arc: float | None, entry_shift: float
    ) -> Iterator[Callable[[], tuple[list[Leg], dict[str, float]]]]:
        if arc is not None and (angle := self._beside(arc)) is not None:
            yield lambda: self._on_from_the_object(arc, angle, entry_shift)
        self._progress("arc and posture")
        solver, start = self._solver, self._assessor.start
        # A first stroke looks for the best posture, a later one for the one that the arm is in.
        near = [self._home, start] if arc is None else [start, self._home]
        arcs = self._visit.arc_centres(ARCS) if arc is None else np.array([arc])
        search = BranchSearch(self._visit, solver, self._assessor, self._cancelled)
        for branch in search.ranked(arcs, starts(near, solver.lower, solver.upper, STARTS))[:_TRIES]:
            yield lambda branch=branch: self._in_from_afar(branch, entry_shift)  # type: ignore[misc]

    def _beside(self, arc: float) -> float | None:
        """The tool's angle about the joint when it is at the standoff or deeper, by the arc; None when it is elsewhere."""
        visit = self._visit
        if visit.joint is None:
            return None
        angle, radius, depth, tilt = visit.local(*self._solver.tip(self._assessor.start))
        _, wanted, standoff, _ = visit.local(*visit.tip(visit.standoff, arc))
        angle = arc + (angle - arc + np.pi) % (2 * np.pi) - np.pi
        on_circle = abs(radius - wanted) < _BESIDE and standoff - _BESIDE < depth < _BESIDE and tilt < 0.2
        return angle if on_circle and abs(angle - arc) < visit.span / 2 + 0.3 else None

    def _inside(self) -> bool:
        """Whether the tool stands in the object, wherever around the joint: an earlier stroke was interrupted."""
        visit = self._visit
        if visit.joint is None:
            return False
        _, radius, depth, tilt = visit.local(*self._solver.tip(self._assessor.start))
        _, wanted, standoff, _ = visit.local(*visit.tip(visit.standoff, 0.0))
        return abs(radius - wanted) < 2 * _BESIDE and standoff + _BESIDE < depth < 3 * _BESIDE and tilt < 0.5

    def _on_from_the_object(self, arc: float, angle: float, entry_shift: float) -> tuple[list[Leg], dict[str, float]]:
        """A later stroke: the posture that the arm has is the reference, which keeps the branch."""
        entry = self._visit.entry_angle(arc, entry_shift)
        builder = PathBuilder(self._visit, self._solver, self._assessor, self._assessor.start, self._cancelled)
        self._progress("way back to the entry")
        builder.begin_return(angle, entry)
        done = self._visit.index(self._visit.standoff) + 1
        return self._through(builder, done, arc, entry)

    def _in_from_afar(self, branch: Branch, entry_shift: float) -> tuple[list[Leg], dict[str, float]]:
        if branch.failure is not None:
            raise branch.failure
        entry = self._visit.entry_angle(branch.arc, entry_shift)
        inside = self._inside()
        posture = self._assessor.start if inside else branch.posture
        builder = PathBuilder(self._visit, self._solver, self._assessor, posture, self._cancelled)
        if inside:
            self._progress("way out of the object")
            builder.begin_retreat(branch.posture)
        builder.angle = entry
        done = 0
        first = self._visit.trajectory.waypoints[0]
        if first.approach == "free":
            self._progress(f"way to {first.name}")
            builder.begin_free(branch, entry)
            done = 1
        return self._through(builder, done, branch.arc, entry)

    def _through(self, builder: PathBuilder, done: int, arc: float, entry: float) -> tuple[list[Leg], dict[str, float]]:
        """The waypoints that are left after the first `done`."""
        end = arc + self._visit.span / 2
        for waypoint in self._visit.trajectory.waypoints[done:]:
            self._progress(f"way to {waypoint.name}")
            builder.go(waypoint, end)
        outputs = {"entry_angle": entry, "end_angle": end, "arc_centre": arc} if self._visit.entry else {}
        return builder.legs, outputs
