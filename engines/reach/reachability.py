"""Which waypoints of a trajectory an arm can reach, fast enough to be told while the instance is dragged.

A waypoint is reached where there is a posture with room to all limits, near one where there is only one without. Each is looked for
from where it was found last, then from the waypoint before it: of an instance that is dragged that is a step or two of the solver.
What is near or not found that way may be found from elsewhere, which takes longer (`settle`). A stroke may enter anywhere about its
joint: what is told is of the arc on which most of it is reached, and another one is looked at as long as that is not all.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

from affordance_templates.binding import bind
from affordance_templates.instance import Instance
from engines.planning import constraints as bounds
from engines.planning.along import touching
from engines.planning.collision.obstacles import obstacles_of
from engines.planning.collision.world import World
from engines.planning.ik import constraints as kinds
from engines.planning.ik.constraints import Constraint
from engines.planning.ik.report import Answer, Measure
from engines.planning.motion import Motion
from engines.planning.motion_planner import MotionPlanner
from engines.planning.plan import Infeasible
from engines.planning.planners import Planners
from engines.planning.strokes.stroke import ARCS
from engines.planning.strokes.visit import Visit
from handrail.messages import Base, KeyFrame, PlanMotion, WaypointReach
from handrail.robot.description import RobotDescription

Array = NDArray[np.float64]

ROOM = {"rad": 0.1, "m": 0.02}
"""to a joint's limits, that is enough"""
CLEAR = 0.02
"""m beyond the clearance that is asked for, that is enough"""
_GOAL, _LIMITS, _CLEARANCE = "goal", "joint limits", "clearance"
_STARTS, _ROUNDS = 4, 4
"""configurations that a round begins from; rounds until a waypoint counts as not reached"""
_WORLDS = 4
_SETTLED_ARCS = 2
"""places of a stroke that are looked into from elsewhere, those that look best"""


@dataclass(frozen=True)
class Question:
    """Of one instance's trajectory and one arm, in a world."""

    instance: str
    trajectory: str
    arm: str
    clearance: float
    """m"""
    instances: Sequence[Instance]
    position: Array
    """(n,) rad, of all joints: those that don't belong to the arm stay there"""
    base: Base | None = None


@dataclass(frozen=True)
class _Arc:
    """A place of a stroke."""

    centre: float | None
    """rad about the entry's joint; None: not a stroke, there is but one place"""
    angles: tuple[float, ...]
    """rad, by which each waypoint is turned about that joint"""


@dataclass(frozen=True)
class _Waypoint:
    """One waypoint's question, for the solver."""

    name: str
    goals: Sequence[Constraint]
    stands: Sequence[Constraint]
    world: World
    moving: tuple[str, ...]
    clearance: float

    def constraints(self, margins: dict[str, tuple[str, ...]], *, roomy: bool) -> list[Constraint]:
        """All that a posture must keep; `roomy`: with room to every limit. `margins`: unit → joints."""
        clear = self.clearance + (CLEAR if roomy else 0.0)
        limits = [
            kinds.JointLimits(margin=ROOM[unit] if roomy else bounds.LIMIT_MARGIN.bound, joints=joints, name=_LIMITS)
            for unit, joints in margins.items()
        ]
        return [*self.goals, kinds.Clearance(scene=self.world, at_least=clear, name=_CLEARANCE), *limits, *self.stands]


class Reachability:
    """Of one robot. Remembers where each waypoint was found; one question at a time."""

    def __init__(self, planners: Planners, description: RobotDescription):
        self._planners, self._description = planners, description
        self._found: dict[tuple[object, ...], dict[str, tuple[WaypointReach, Array]]] = {}
        """instance, trajectory, arm, arc, who plans → waypoint → what was told of it and the posture (nq,)"""
        self._chosen: dict[tuple[str, str, str], int] = {}
        """instance, trajectory, arm → the arc that is told of, where there are several"""
        self._quick = 0
        """how often it was asked"""
        self._worlds: dict[tuple[object, ...], World] = {}
        self._may_touch: dict[tuple[int, str, str], Sequence[tuple[str, str]]] = {}

    def quick(self, question: Question) -> list[WaypointReach]:
        """From what was found last. Raises ValueError naming field, value and expectation."""
        arcs = self._arcs(question)
        self._quick += 1
        chosen = self._chosen.get(_about(question), 0) % len(arcs)
        told = self._quick_on(question, arcs[chosen])
        if len(arcs) > 1 and _score(told) < len(told):  # one other at a time
            other = (chosen + 1 + self._quick % (len(arcs) - 1)) % len(arcs)
            tried = self._quick_on(question, arcs[other])
            if _score(tried) > _score(told):
                chosen, told = other, tried
        self._chosen[_about(question)] = chosen
        return told

    def _quick_on(self, question: Question, arc: _Arc) -> list[WaypointReach]:
        planner, waypoints, here = self._read(question, arc)
        key = _key(question, arc, planner)
        before = self._found.get(key, {})
        found: dict[str, tuple[WaypointReach, Array]] = {}
        for number, waypoint in enumerate(waypoints):
            told, start = before.get(waypoint.name, (None, here))
            best = self._try(planner, waypoint, start, roomy_first=told is None or told.state == "reached")
            turn = self._quick % len(waypoints) == number  # one at a time: what is not reached costs most
            if best[0].state == "not" and start is not here and turn:
                best = _better(best, self._try(planner, waypoint, here, roomy_first=False))
            found[waypoint.name] = best
            here = best[1] if best[0].state != "not" else here
        self._found[key] = found
        return _with_angles(arc, [told for told, _ in found.values()])

    def settle(self, question: Question, cancelled: Callable[[], bool]) -> list[WaypointReach] | None:
        """After `quick`, of the same question: what is near or not reached is looked for from elsewhere, too.

        None when it was cancelled. Raises ValueError.
        """
        arcs = self._arcs(question)
        if len(arcs) == 1:
            return self._settle_on(question, arcs[0], cancelled)
        told = self._quick_on(question, arcs[self._chosen.get(_about(question), 0) % len(arcs)])
        if _score(told) >= len(told):
            return told
        scores: list[tuple[float, int]] = []
        for number, arc in enumerate(arcs):
            if cancelled():
                return None
            scores.append((_score(self._quick_on(question, arc)), number))
        best: tuple[float, int, list[WaypointReach]] | None = None
        for _, number in sorted(scores, key=lambda one: (-one[0], one[1]))[:_SETTLED_ARCS]:
            settled = self._settle_on(question, arcs[number], cancelled)
            if settled is None:
                return None
            if best is None or _score(settled) > best[0]:
                best = _score(settled), number, settled
            if best[0] >= len(settled):
                break
        assert best is not None
        self._chosen[_about(question)] = best[1]
        return best[2]

    def _settle_on(self, question: Question, arc: _Arc, cancelled: Callable[[], bool]) -> list[WaypointReach] | None:
        planner, waypoints, _ = self._read(question, arc)
        found = self._found[_key(question, arc, planner)]
        for number, waypoint in enumerate(waypoints):
            for seed in range(_ROUNDS):
                told, posture = found[waypoint.name]
                if told.state == "reached":
                    break
                if cancelled():
                    return None
                starts = [found[other.name][1] for other in waypoints[max(0, number - 1) : number + 2]]
                start = starts[seed] if seed < len(starts) else posture
                tried = self._try(
                    planner, waypoint, start, roomy_first=told.state == "near", starts=_STARTS, seed=seed + 1
                )
                found[waypoint.name] = _better((told, posture), tried)
            told, posture = found[waypoint.name]
            if told.state == "not":
                found[waypoint.name] = self._why(planner, waypoint, posture), posture
        return _with_angles(arc, [found[waypoint.name][0] for waypoint in waypoints])

    def forget(self) -> None:
        """As if nothing had been asked yet."""
        self._found.clear()
        self._chosen.clear()

    # ------------------------------------------------------------------------------------------------------- the question

    def _arcs(self, question: Question) -> list[_Arc]:
        """Where a trajectory may be gone along: one without an entry in one place, a stroke about its joint in several."""
        instance = _instance(question)
        found = instance.resolve().trajectories.get(question.trajectory)
        if found is None or found.entry is None:
            return [_Arc(None, ())]
        visit, arcs, why = Visit(instance, question.trajectory), list[_Arc](), ""
        for centre in visit.arc_centres(ARCS).tolist():
            try:
                arcs.append(_Arc(centre, tuple(visit.angles(centre))))
            except Infeasible as problem:
                why = str(problem)
        if not arcs:
            raise ValueError(f"trajectory: {question.trajectory} has no place about its joint: {why}")
        return arcs

    def _read(self, question: Question, arc: _Arc) -> tuple[MotionPlanner, list[_Waypoint], Array]:
        """Who solves it, each waypoint's question, and the posture (nq,) in which the robot is."""
        instance = _instance(question)
        found = instance.resolve().trajectories.get(question.trajectory)
        hands = {} if found is None or not question.arm else {found.hand: question.arm}
        bound = bind(instance, question.trajectory, self._description, hands)
        assert found is not None
        if arc.angles:
            visit = Visit(instance, question.trajectory)
            carried = [
                replace(waypoint, tip_in_world=visit.carried(waypoint.tip_in_world, angle))
                for waypoint, angle in zip(bound.waypoints, arc.angles, strict=True)
            ]
            bound = replace(bound, waypoints=tuple(carried))
        planner, there = self._planners.of(question.base)
        *through, last = (waypoint.goal() for waypoint in bound.waypoints)
        call = PlanMotion(
            goals=[last],
            through=[KeyFrame(goals=[each]) for each in through],
            arm=bound.arm.name,
            clearance=question.clearance,
        )
        motion = planner.read(call, question.instances, question.position, there)
        waypoints = [
            _Waypoint(
                name=waypoint.waypoint.name,
                goals=[replace(goal, name=_GOAL) for goal in goals],
                stands=motion.stands,
                world=self._world(planner, motion, "" if waypoint.waypoint.approach == "free" else instance.name),
                moving=motion.moving,
                clearance=question.clearance,
            )
            for waypoint, goals in zip(bound.waypoints, (*motion.through, motion.goals), strict=True)
        ]
        return planner, waypoints, planner.configuration("position", question.position)

    def _world(self, planner: MotionPlanner, motion: Motion, touched: str) -> World:
        """In which the arm's tool may touch an instance (empty: none); kept as long as the same things stand around."""
        solids = [solid for instance in motion.obstacles for solid in obstacles_of(instance)]
        key = (id(planner), motion.moving, touched, tuple(map(id, solids)))  # alive: the world holds them
        world = self._worlds.pop(key, None)
        if world is None:
            may_touch = self._touching(planner, self._description.arms[motion.arm].tool, touched) if touched else ()
            allowed = (*self._description.allowed_collision_pairs, *may_touch)
            world = World(planner.mechanism, solids, allowed, moving=motion.moving)
        self._worlds[key] = world
        if len(self._worlds) > _WORLDS:
            del self._worlds[next(iter(self._worlds))]
        return world

    def _touching(self, planner: MotionPlanner, tool: str, instance: str) -> Sequence[tuple[str, str]]:
        key = (id(planner), tool, instance)
        if key not in self._may_touch:
            self._may_touch[key] = tuple(touching(planner.mechanism, tool, instance))
        return self._may_touch[key]

    # --------------------------------------------------------------------------------------------------------- the answer

    def _try(
        self, planner: MotionPlanner, waypoint: _Waypoint, start: Array, *, roomy_first: bool, starts: int = 1, seed: int = 0
    ) -> tuple[WaypointReach, Array]:  # fmt: skip
        """What is found from there: with room if that is looked for first and found, else as near to the limits as it must."""
        margins = _units(planner, waypoint.moving)
        solver = planner.solver
        if roomy_first:
            asked = waypoint.constraints(margins, roomy=True)
            answer = solver.solve(asked, start, start=start, moving=waypoint.moving, starts=starts, seed=seed)
            if answer.feasible:
                return WaypointReach(name=waypoint.name, state="reached"), answer.q
            start = answer.q
        asked = waypoint.constraints(margins, roomy=False)
        answer = solver.solve(asked, start, start=start, moving=waypoint.moving, starts=starts, seed=seed)
        if not answer.feasible:
            return _missed(waypoint.name, answer), answer.q
        return self._near(planner, waypoint, answer.q, margins), answer.q

    def _why(self, planner: MotionPlanner, waypoint: _Waypoint, start: Array) -> WaypointReach:
        """What stands in the way of what is not reached: its place and direction themselves, or what it would meet there."""
        solver, margins = planner.solver, _units(planner, waypoint.moving)
        asked = waypoint.constraints(margins, roomy=False)
        alone = [one for one in asked if not isinstance(one, kinds.Clearance)]
        answer = solver.solve(alone, start, start=start, moving=waypoint.moving, starts=_STARTS)
        if answer.feasible:
            answer = replace(answer, violations=solver.checker.violations(asked, answer.q))
        return _missed(waypoint.name, answer)

    def _near(
        self, planner: MotionPlanner, waypoint: _Waypoint, q: Array, margins: dict[str, tuple[str, ...]]
    ) -> WaypointReach:
        """Which limit a posture is nearest to, if it is near any."""
        asked = waypoint.constraints(margins, roomy=True)
        least, at = 1.0, None
        for measure in planner.solver.checker.measures(asked, q):
            match measure.constraint:
                case "joint limits":
                    room = ROOM[measure.unit]
                    left = room + min(measure.value - measure.lower, measure.upper - measure.value)
                case "clearance":
                    room, left = CLEAR, measure.value - waypoint.clearance
                case _:
                    continue
            if left / room < least - 1e-3:
                least, at = left / room, (measure, left)
        if at is None:
            return WaypointReach(name=waypoint.name, state="reached")
        measure, left = at
        return _told(waypoint.name, "near", measure.constraint, measure, max(0.0, left))


def _units(planner: MotionPlanner, joints: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Unit → the joints that are measured in it."""
    mechanism = planner.mechanism
    units = {joint: mechanism.unit_of(mechanism.row(joint)) for joint in joints}
    return {unit: tuple(joint for joint in joints if units[joint] == unit) for unit in sorted({*units.values()})}


def _missed(name: str, answer: Answer) -> WaypointReach:
    """The worst of what is missed; a place's three coordinates count as one."""
    worst = answer.violations[0]
    if worst.constraint != _GOAL:
        return _told(name, "not", worst.constraint, worst, worst.by)
    if worst.unit == "rad":
        return _told(name, "not", "direction", None, worst.by, "rad")
    off = math.hypot(*(one.by for one in answer.violations if one.constraint == _GOAL and one.unit == "m"))
    return _told(name, "not", "position", None, off, "m")


def _told(name: str, state: str, constraint: str, measure: Measure | None, by: float, unit: str = "") -> WaypointReach:
    return WaypointReach(
        name=name,
        state=state,  # type: ignore[arg-type]
        constraint=constraint,
        about=measure.what if measure is not None and constraint in (_LIMITS, _CLEARANCE) else "",
        by=round(by, 5),
        unit=measure.unit if measure is not None else unit,  # type: ignore[arg-type]
    )


def _better(one: tuple[WaypointReach, Array], other: tuple[WaypointReach, Array]) -> tuple[WaypointReach, Array]:
    """The first of two unless the other reaches more; of two that miss, what misses less, of two that are near, what is less so."""
    ranks = {"reached": 2, "near": 1, "not": 0}
    a, b = one[0], other[0]
    if ranks[a.state] != ranks[b.state]:
        return max(one, other, key=lambda each: ranks[each[0].state])
    sign = 1.0 if a.state == "near" else -1.0
    return other if sign * b.by > sign * a.by else one


def _instance(question: Question) -> Instance:
    found = next((each for each in question.instances if each.name == question.instance), None)
    if found is None:
        known = ", ".join(each.name for each in question.instances) or "none placed yet"
        raise ValueError(f"instance: got {question.instance!r}; expected one of {known}")
    return found


def _about(question: Question) -> tuple[str, str, str]:
    return question.instance, question.trajectory, question.arm


def _key(question: Question, arc: _Arc, planner: MotionPlanner) -> tuple[object, ...]:
    return *_about(question), arc.centre, id(planner)


def _with_angles(arc: _Arc, told: list[WaypointReach]) -> list[WaypointReach]:
    if not arc.angles:
        return told
    return [structs.replace(one, turned=angle) for one, angle in zip(told, arc.angles, strict=True)]


def _score(told: Sequence[WaypointReach]) -> float:
    """The more is reached the larger: as many as there are waypoints where all are, with room."""
    worth = {"reached": 1.0, "near": 0.9, "not": 0.0}
    return sum(worth[one.state] - (min(one.by, 1.0) * 1e-3 if one.state == "not" else 0.0) for one in told)
