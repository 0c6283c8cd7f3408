"""From a visit's waypoints to joint paths: legs that follow each other without a gap, each checked against the constraints."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from affordance_templates.template import ResolvedWaypoint
from engines.planning import constraints
from engines.planning.collision.bodies import Clearance, nearer
from engines.planning.constraints import Constraint
from engines.planning.plan import Infeasible
from engines.planning.strokes.assessment import Assessor
from engines.planning.strokes.branch import Branch, expected_force
from engines.planning.strokes.tip_solver import Reach, TipSolver
from engines.planning.strokes.visit import TipPath, Visit
from engines.planning.timing.timing import TIP_SPEED
from engines.planning.waiting import go_on

Array = NDArray[np.float64]

_LINE_SPACING = 0.01
"""m between goals on a line"""
_ARC_SPACING = np.deg2rad(4.0)


@dataclass(frozen=True)
class Leg:
    """The joint path of one segment."""

    name: str
    path: Array
    """(k, m) rad"""
    duration: float
    """s, at least"""
    waypoint: ResolvedWaypoint | None
    """None: a leg that no waypoint asks for (back to the standoff, return)"""
    near: Clearance
    """at every row of the path: from the object (the tool left out where it may touch) and of the robot from itself"""
    reach: Reach
    """how well the tool's tip meets its goals at the path's rows, or at the last one where that is all that has a goal"""
    forces: Array
    """(k, 3) N, expected to act on the tip at the path's rows"""
    may_touch: bool
    """whether the tool may touch the object"""
    goal: tuple[Array, Array]
    """(3,) m and (3,): where the tip is to be at its end, and where it is to point"""


class PathBuilder:
    """Appends checked legs. `q`, `tip` and `angle` say where the way has come to."""

    def __init__(
        self, visit: Visit, solver: TipSolver, assessor: Assessor, posture: Array, cancelled: Callable[[], bool]
    ):
        self._visit, self._solver, self._assessor = visit, solver, assessor
        self._posture, self._cancelled = posture, cancelled
        self.legs: list[Leg] = []
        self.q = assessor.start
        self.angle = 0.0

    @property
    def tip(self) -> tuple[Array, Array]:
        return self._solver.tip(self.q)

    # ------------------------------------------------------------------------------------------------------------ entering

    def begin_free(self, branch: Branch, entry: float) -> None:
        """The free waypoint before the contact, its posture found backwards from the branch's contact."""
        visit = self._visit
        first = visit.trajectory.waypoints[0]
        back = [visit.turned(visit.contact, branch.arc, entry, _ARC_SPACING)]
        here = visit.tip(visit.contact, entry)
        depth = visit.index(visit.contact)
        for waypoint in reversed(visit.trajectory.waypoints[:depth]):
            there = visit.tip(waypoint, entry)
            back.append(visit.straight(here, there, _LINE_SPACING))
            here = there
        goals = TipPath(np.vstack([part.positions for part in back]), np.vstack([part.axes for part in back]))
        reach = self._solver.track(branch.contact, goals.positions, goals.axes, self._posture)
        self._refuse(
            {self._assessor.leeway.reach: float(reach.residual[-1]), self._assessor.leeway.tilt: float(reach.tilt[-1])},
            first.name,
        )
        self.angle = entry
        self._free(first, Reach(reach.q[-1:], reach.residual[-1:], reach.tilt[-1:]), here)

    def begin_retreat(self, posture: Array) -> None:
        """From inside the object, where an interrupted stroke left the tool: straight back to the standoff. `posture` (m,) rad is
        the reference for what follows."""
        visit = self._visit
        away = visit.tip(visit.standoff, visit.local(*self.tip)[0])
        self._follow("retreat", visit.straight(self.tip, away, _LINE_SPACING), 0.5, None, may_touch=True)
        self._posture = posture

    def begin_return(self, angle: float, entry: float) -> None:
        """From beside the object: straight back to the standoff where the tool is deeper, then along the circle to the entry."""
        visit = self._visit
        away = visit.tip(visit.standoff, angle)
        if visit.local(*self.tip)[2] > visit.local(*away)[2] + _LINE_SPACING:
            self._follow("retreat", visit.straight(self.tip, away, _LINE_SPACING), 0.5, None, may_touch=True)
        circle = visit.turned(visit.standoff, angle, entry, _ARC_SPACING)
        fade = np.linspace(1.0, 0.0, len(circle))[:, None]  # the way begins where the tip is, not where it should be
        positions = circle.positions + fade * (self.tip[0] - circle.positions[0])
        self._follow("return", TipPath(positions, circle.axes), visit.standoff.duration, None, may_touch=False)
        self.angle = entry

    # ----------------------------------------------------------------------------------------------------------- waypoints

    def go(self, waypoint: ResolvedWaypoint, arc_end: float) -> None:
        """The next waypoint. Raises Infeasible, Cancelled."""
        visit = self._visit
        may_touch = visit.may_touch(waypoint)
        match waypoint.approach:
            case "free":
                goal = visit.tip(waypoint, self.angle)
                reach = self._solver.solve(self.q, *goal, self._posture)
                measures = {
                    self._assessor.leeway.reach: float(reach.residual[0]),
                    self._assessor.leeway.tilt: float(reach.tilt[0]),
                }
                self._refuse(measures, waypoint.name)
                self._free(waypoint, reach, goal)
            case "straight":
                goals = visit.straight(self.tip, visit.tip(waypoint, self.angle), _LINE_SPACING)
                self._follow(waypoint.name, goals, waypoint.duration, waypoint, may_touch=may_touch)
            case "along":
                end = arc_end if waypoint.to == "arc_end" else self.angle + float(waypoint.to)
                goals = visit.turned(waypoint, self.angle, end, _ARC_SPACING)
                self._follow(waypoint.name, goals, waypoint.duration, waypoint, may_touch=may_touch)
                self.angle = end

    def _free(self, waypoint: ResolvedWaypoint, reach: Reach, goal: tuple[Array, Array]) -> None:
        """Anyhow to the one posture of `reach`."""
        go_on(self._cancelled)
        there = reach.q[0]
        try:
            path = self._assessor.way(self.q, there, self._cancelled)
        except Infeasible:
            ways = {
                "where the robot stands": self.q[None],
                "there": there[None],
                "straight there": np.linspace(self.q, there, 40),
            }
            for words, q in ways.items():
                distances, between = _distances(self._assessor.clearances(q, tool_may_touch=False))
                self._refuse(distances, f"{waypoint.name}, no free way, {words}", between)
            raise
        tips = self._solver.tips(path)[0]
        length = float(np.linalg.norm(np.diff(tips, axis=0), axis=1).sum())
        duration = max(waypoint.duration, length / TIP_SPEED)
        self._append(waypoint.name, path, duration, waypoint, reach, np.zeros((len(path), 3)), goal, may_touch=False)

    def _follow(
        self, name: str, goals: TipPath, duration: float, waypoint: ResolvedWaypoint | None, *, may_touch: bool
    ) -> None:
        go_on(self._cancelled)
        reach: Reach = self._solver.track(self.q, goals.positions, goals.axes, self._posture)
        path = reach.q
        path[0] = self.q
        measures: dict[Constraint, float] = {
            self._assessor.leeway.reach: float(reach.residual.max()),
            self._assessor.leeway.tilt: float(reach.tilt.max()),
            constraints.JOINT_STEP: float(np.abs(np.diff(path, axis=0)).max()),
        }
        pushing = waypoint is not None and waypoint.path_force is not None
        ahead = np.diff(goals.positions, axis=0, append=goals.positions[-1:])
        ahead[-1] = ahead[-2] if len(ahead) > 1 else 0.0
        lengths = np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-9)
        forces = -expected_force(self._visit) * ahead / lengths if pushing else np.zeros_like(ahead)
        measures.update(self._assessor.static(path, forces))
        self._refuse(measures, name)
        end = (goals.positions[-1], goals.axes[-1])
        self._append(name, path, duration, waypoint, reach, forces, end, may_touch=may_touch)

    def _append(
        self, name: str, path: Array, duration: float, waypoint: ResolvedWaypoint | None, reach: Reach, forces: Array,
        goal: tuple[Array, Array], *, may_touch: bool,
    ) -> None:  # fmt: skip
        go_on(self._cancelled)
        found = self._assessor.clearances(path, tool_may_touch=may_touch)
        distances, between = _distances(found)
        self._refuse({**distances, constraints.LIMIT_MARGIN: self._assessor.limit_margin(path)}, name, between)
        if (met := self._assessor.between(path, tool_may_touch=may_touch)) is not None:
            self._refuse({met[0]: met[1].distance}, name, {met[0]: met[1].between})
        near = functools.reduce(nearer, found.values())
        self.legs.append(Leg(name, path, duration, waypoint, near, reach, forces, may_touch, goal))
        self.q = path[-1]

    @staticmethod
    def _refuse(measures: constraints.Measures, where: str, detail: Mapping[Constraint, str] | None = None) -> None:
        failure = constraints.worst(measures, where, detail)
        if failure is not None:
            raise failure


def _distances(found: dict[Constraint, Clearance]) -> tuple[dict[Constraint, float], dict[Constraint, str]]:
    return {c: one.distance for c, one in found.items()}, {c: one.between for c, one in found.items()}
