"""The search for a motion's plan: postures at its goals and ways to them, or one spline; time along it; checks of all of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import chain, islice
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from engines import identifiers
from engines.planning import constraints
from engines.planning.along import Follow
from engines.planning.along_ways import AlongWays
from engines.planning.collision.clearances import clearances, looks
from engines.planning.collision.connect import Budget, Connector
from engines.planning.collision.sweep import Nearest, cubics
from engines.planning.endless import endless_of, nearest_turn, told_by, unwound
from engines.planning.footing import COMPOUND
from engines.planning.goals import message_of
from engines.planning.held_ways import HeldConnector
from engines.planning.ik import constraints as kinds
from engines.planning.ik.checker import LENGTH
from engines.planning.ik.constraints import Constraint
from engines.planning.ik.report import Answer
from engines.planning.ik.report import Measure as Report
from engines.planning.measures import CLEARANCE, LIMIT_MARGIN, RESIDUAL, TILT, Measure, limit_margins, torque_shares
from engines.planning.motion import Motion
from engines.planning.plan import BaseWay, Infeasible, Plan, Segment
from engines.planning.sampling import sampled
from engines.planning.timing.timing import TIP_SPEED, Knots, Limits, parametrise
from engines.planning.verifier import BETWEEN
from engines.planning.waiting import go_on
from engines.runs.retrace import hermite

if TYPE_CHECKING:
    from engines.planning.motion_planner import MotionPlanner

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

_POSTURES = 4
"""postures for a goal that are tried until one can be gone to"""
_PLACES = 6
"""places within a goal's tolerances, that are tried after those"""
_ONWARD = 3
"""postures at a key frame that the way on is looked for from"""
_STARTS = 12
"""configurations that the search for each begins from at most"""
_BUDGET = Budget(seconds=10.0, edges=1500)
"""of a way around what is there, for each posture"""
_HELD_BUDGET = Budget(seconds=10.0, edges=200)
"""the same of a way that keeps something"""
_SPARE = 5e-4
"""m of clearance that a posture at a goal has beyond what is asked for, so that the way to it may end there"""
_KNOTS = 4
"""of a spline, between two key frames"""
_SAMPLES = 40
"""of a spline's way, between two key frames"""
_BASE_SPEED = 0.05
"""m/s, a base's mean speed at most over feet that are held: balance is reckoned at a stand"""
_BETWEEN_S = 1.0
"""s between key frames, for the weights of speed in the optimisation; timing is made anew afterwards"""
PASSED = 0.005
"""m, an angle counting 0.3 m/rad, by which a key frame may be missed on a way that does not stop there"""


class MotionSearch:
    """One question's, of one planner, which lends what it measures and solves with."""

    def __init__(
        self, planner: MotionPlanner, motion: Motion, start: Array, cancelled: Callable[[], bool],
        progress: Callable[[str], None],
    ):  # fmt: skip
        mechanism = self._mechanism = planner.mechanism
        motion = unwound(motion, mechanism, start)
        self._planner, self._motion, self._start = planner, motion, start
        self._cancelled, self._progress = cancelled, progress
        self._data = mechanism.model.createData()
        self._reached = motion.goals
        self._rows: Integers = mechanism.coordinate[[mechanism.row(joint) for joint in motion.moving]]
        self._lower, self._upper = (
            limit[[mechanism.row(joint) for joint in motion.moving]] for limit in (mechanism.lower, mechanism.upper)
        )
        self._scene = scene = planner.scene(motion)
        self._connector = Connector(scene.world, margins=scene.margins, cancelled=cancelled, sweep=scene.sweep)
        told = {joint for one in (*motion.goals, *chain.from_iterable(motion.through)) for joint in told_by(one)}
        self._endless = endless_of(mechanism, [joint for joint in motion.moving if joint not in told])
        free = tuple(joint for joint in motion.moving if joint not in told)
        self._always: list[Constraint] = [
            kinds.Clearance(
                scene=scene.world,
                at_least=scene.margins.objects + _SPARE,
                itself=scene.margins.itself + _SPARE,
                name="clearance",
            )
        ]
        if free:
            margin = constraints.LIMIT_MARGIN.bound
            self._always.append(kinds.JointLimits(margin=margin, joints=free, name="margin to the joint limits"))
        self._always += motion.stands
        self._ways_of: Connector | HeldConnector = self._connector
        self._budget = _BUDGET
        self._held = bool(motion.keep) or motion.closed
        if self._held:
            held = [*motion.keep, *(one for one in self._always if not isinstance(one, kinds.Clearance))]
            floors = scene.margins.floors(scene.world)
            self._budget = _HELD_BUDGET
            self._ways_of = HeldConnector(planner.solver, scene.sweep, floors, held, cancelled=cancelled)

    def plan(self) -> Plan:
        """See MotionPlanner.plan."""
        self._leavable()
        motion = self._motion
        limits = self._planner.limits_of(motion.moving, self._start)
        first: Infeasible | None = None
        for name, paths in self._ways():
            try:
                return self._timed(paths, limits, name)
            except Infeasible as problem:
                first = first or problem
        raise first or Infeasible("way", 0.0, "rad", "goals", "was not found")

    def relaxed(self) -> tuple[Motion, tuple[Report, ...]] | None:
        """The question with goals that are as wide as they must be for a posture, and by how much each is wider.

        None where none may give way, or all are kept in some posture.
        """
        motion = self._motion
        if not any(goal.priority for goal in motion.goals):
            return None
        self._progress("posture where goals give way")
        answer = self._planner.solver.solve(
            [*motion.goals, *self._always], self._start, moving=motion.moving, starts=_STARTS, relax=True
        )
        if not answer.feasible or not answer.given:
            return None
        goals = [replace(one, priority=0) for one in answer.granted[: len(answer.granted) - len(self._always)]]
        seeds = [self._planner.positions(answer.q), *motion.seeds]
        return replace(motion, goals=goals, seeds=seeds), answer.given

    def _whole(self, postures: Array) -> Array:
        """(k, nq) for postures (k, m) of what moves."""
        q = np.repeat(self._start[None], len(postures), axis=0)
        q[:, self._rows] = postures
        return q

    def _leavable(self) -> None:
        """Raise Infeasible when the robot stands where no motion may begin."""
        itself, margins = self._scene.world.of_itself, self._scene.margins
        for chosen, floor in ((itself, margins.itself), (~itself, margins.objects)):
            nearest = self._connector.sweep.nearest(self._start, chosen, within=floor)
            if nearest.pair >= 0:
                raise _too_near(nearest, floor, "where the robot stands")
        for missed in self._planner.solver.checker.violations(self._motion.stands, self._start):
            words = f"({missed.what}) is {missed.value:.3g} {missed.unit}"
            raise Infeasible(missed.constraint, missed.by, missed.unit, "where the robot stands", words)

    def _ways(self) -> Iterator[tuple[str, list[Array]]]:
        """Ways to try, (k, m) each between two stops."""
        motion = self._motion
        if motion.along is not None:
            yield "along", [self._followed(motion.along)]
            return
        missed: Infeasible | None = None
        if self._held or motion.through:
            try:
                yield "spline", [self._spline()]
            except Infeasible as problem:
                missed = problem
        try:
            yield from self._stop_by_stop()
        except Infeasible as problem:
            raise (missed if self._held and missed else problem) from None
        if motion.stands and not self._held and not motion.through:  # each of those ways fell over
            yield "spline", [self._spline()]

    def _frame(self, q: Array, name: str) -> pin.SE3:
        """A frame in the world at q (nq,)."""
        mechanism = self._mechanism
        pin.forwardKinematics(mechanism.model, self._data, q)
        return pin.SE3(pin.updateFramePlacement(mechanism.model, self._data, mechanism.frame_id(name)))

    def _followed(self, follow: Follow) -> Array:
        """(k, m), the frame going with its joint. Raises Infeasible, Cancelled."""
        scene = self._scene
        ways = AlongWays(
            self._planner.solver, scene.sweep, scene.margins.floors(scene.world) - LENGTH,
            [*self._motion.keep, *self._always], follow.asked.joint, cancelled=self._cancelled, progress=self._progress,
        )  # fmt: skip
        places = list(follow.goals(self._frame(self._start, follow.frame)))
        self._reached = places[-1][1]
        return np.array(ways.way(self._start, places))[:, self._rows]

    # ------------------------------------------------------------------------------------------------ ways with stops only

    def _stop_by_stop(self) -> Iterator[tuple[str, list[Array]]]:
        yield from self._onward(self._start, [])

    def _onward(self, here: Array, ways: list[Array]) -> Iterator[tuple[str, list[Array]]]:
        """Depth first, from key frame to key frame: where no way leads on from one's posture, from its next one."""
        number = len(ways)
        if number == len(self._motion.through):
            for _, way in self._to(here, self._motion.goals, "goals"):
                yield "goals", [*ways, way]
            return
        missed, led = None, False
        for there, way in islice(self._to(here, self._motion.through[number], f"through[{number}]"), _ONWARD):
            try:
                for found in self._onward(there, [*ways, way]):
                    led = True
                    yield found
            except Infeasible as problem:
                missed = missed or problem
        if missed is not None and not led:
            raise missed

    def _to(self, here: Array, goals: Sequence[Constraint], where: str) -> Iterator[tuple[Array, Array]]:
        """Postures at goals (nq,), each with the way there; at least one, or Infeasible is raised."""
        blocked: Infeasible | None = None
        found = False
        for answer in self._postures(here, goals, where):
            self._progress(f"way to {where}")
            try:
                way = self._ways_of.way(here, answer.q, budget=self._budget, progress=self._progress)
            except Infeasible as problem:
                blocked = blocked or problem
                continue
            found = True
            yield answer.q, way[:, self._rows]
        if not found and blocked is not None:
            raise Infeasible(blocked.constraint, blocked.by, blocked.unit, f"way to {where}", blocked.detail)

    def _postures(self, here: Array, goals: Sequence[Constraint], where: str) -> Iterator[Answer]:
        """Postures at goals, the one that is found nearest first. Raises Infeasible when there is none."""
        self._progress(f"posture at {where}")
        goals = [*goals, *self._motion.keep]
        wanted = [*goals, *self._always]
        known: list[Array] = []
        moving = self._motion.moving
        generator = np.random.default_rng(0)
        seeds = [self._planner.configuration("seed", seed) for seed in self._motion.seeds]
        for number in range(_POSTURES + _PLACES + len(seeds)):
            go_on(self._cancelled)
            if number >= _POSTURES + len(seeds):
                places = sampled(goals, generator)
                if not places:
                    break
                wanted = [*places, *self._always]
            start = seeds[number] if number < len(seeds) else None
            if number > len(seeds):
                drawn = generator.uniform(np.maximum(self._lower, -np.pi), np.minimum(self._upper, np.pi))
                start = here.copy()
                start[self._rows] = drawn
            if start is not None:
                others = np.ones(len(start), bool)
                others[self._rows] = False
                start[others] = here[others]
            starts = _STARTS if not known else 2
            answer = self._planner.solver.solve(
                wanted, here, start=here if start is None else start, moving=moving, starts=starts
            )
            answer = replace(answer, q=nearest_turn(answer.q, here, self._endless))
            if answer.feasible and all(np.abs(answer.q - one).max() > 0.05 for one in known):
                known.append(answer.q)
                yield answer
            elif not answer.feasible and not known and number >= len(seeds):
                answer.require(where)

    # --------------------------------------------------------------------------------------- ways that keep something on them

    def _spline(self) -> Array:
        """(k, m), one smooth way through all key frames that keeps what is to be kept. Raises Infeasible, Cancelled."""
        self._progress("way as a whole")
        motion = self._motion
        stops = len(motion.through) + 1
        end = stops * _BETWEEN_S
        held: list[Constraint] = [replace(one, window=(0.0, end)) for one in motion.keep]
        for number, goals in enumerate((*motion.through, motion.goals), 1):
            at = number * _BETWEEN_S
            held += [replace(one, window=(at, at)) for one in goals]
        times = np.linspace(0.0, end, _KNOTS * stops + 1)
        found = self._planner.trajectories.solve(
            [*held, *(replace(one, window=(0.0, end)) for one in self._always)], self._start, times.tolist(), moving=motion.moving,
            most_knots=3 * len(times), cancelled=self._cancelled,
        ).require("on the way")  # fmt: skip
        way = found.at(np.linspace(0.0, end, _SAMPLES * stops + 1))[:, self._rows]
        way[0] = self._start[self._rows]
        return way

    # ------------------------------------------------------------------------------------------------------ time and checks

    def _timed(self, ways: list[Array], limits: Limits, name: str) -> Plan:
        """A plan of segments through the ways, verified. Raises Infeasible, Cancelled."""
        self._progress("time, and a check of all of it")
        motion = self._motion
        whole = name != "goals"
        reached = [self._reached] if whole else [*motion.through, motion.goals]
        names = (
            [name if name == "along" else "goals"]
            if whole
            else [*(f"through {n}" for n in range(1, len(ways))), "goals"]
        )
        lengths = np.array([max(float(np.abs(np.diff(way, axis=0)).sum(axis=0).max()), 1e-9) for way in ways])
        torque = self._planner.torque_limit(motion.moving)
        segments = []
        for way, share, goals, where in zip(ways, lengths / lengths.sum(), reached, names, strict=True):
            go_on(self._cancelled)
            knots = parametrise(way, limits, max(float(share) * motion.duration, self._watched(way)), where=where)
            self._certain(knots, where)
            measures = (*self._kept(knots, limits, torque), *self._met(goals, knots))
            base = self._base(knots) if motion.closed else None
            segments.append(
                Segment(where, knots.times, knots.positions, knots.velocities, measures=measures, base=base)
            )
        ends = np.cumsum([segment.duration for segment in segments])
        worst = {
            figure: min(each.values.min() for one in segments for each in one.measures if each.name == figure)
            for figure in (CLEARANCE, LIMIT_MARGIN)
        }
        plan = Plan(
            id=identifiers.new("plan", 12),
            label=motion.label,
            arm=motion.arm,
            joints=motion.moving,
            segments=tuple(segments),
            made_from=motion.made_from,
            start=self._start[self._rows],
            clearance=float(worst[CLEARANCE]),
            limit_margin=float(worst[LIMIT_MARGIN]),
        )
        held = [replace(one, window=(0.0, float(ends[-1]))) for one in (*motion.keep, *motion.stands)]
        for goals, end in zip(reached, ends.tolist(), strict=True):
            held += [replace(one, window=(end, end)) for one in goals]
        found = self._scene.verifier.violations(
            plan,
            limits,
            self._start,
            constraints=held,
            torque=torque,
            feet=self._planner.feet,
            cancelled=self._cancelled,
        )
        if found:
            raise found[0].error()
        if motion.along is not None:
            self._stays(motion.along, segments[0])
        if motion.closed:
            end = self._frame(self._whole(segments[-1].positions[-1:])[0], self._planner.base_frame)
            plan = replace(plan, compound=COMPOUND, base_at_end=message_of(motion.root_in_world * end))
        return replace(plan, key_times=self._passes(segments[0]) if whole else tuple(ends[:-1].tolist()))

    def _certain(self, knots: Knots, where: str) -> None:
        """Raise Infeasible unless the motion between the knots, a cubic through them, keeps clear all along."""
        rates = np.zeros((len(knots.times), self._mechanism.nq))
        rates[:, self._rows] = knots.velocities
        motion = cubics(knots.times, self._whole(knots.positions), rates)
        floors = self._scene.margins.floors(self._scene.world)
        meeting = self._connector.sweep.meeting(motion, floors - LENGTH, self._cancelled)
        go_on(self._cancelled)
        if meeting is not None:
            raise _too_near(meeting, float(floors[meeting.pair]), where)

    def _base(self, knots: Knots) -> BaseWay:
        """Where the base is in the world at each knot."""
        places = [
            self._motion.root_in_world * self._frame(q, self._planner.base_frame) for q in self._whole(knots.positions)
        ]
        positions = np.array([place.translation for place in places])
        velocities = CubicSpline(knots.times, positions, bc_type="clamped")(knots.times, 1)
        velocities[[0, -1]] = 0.0
        return BaseWay(positions, velocities)

    def _kept(self, knots: Knots, limits: Limits, torque: Array) -> tuple[Measure, ...]:
        """Clearance, margin to the joint limits and share of `torque` (m,) N·m along knots."""
        joints, times = self._motion.moving, looks(knots.times, knots.positions)
        way = hermite(knots.times, knots.positions, knots.velocities, times)
        assert limits.torque is not None
        rates = np.gradient(knots.velocities, knots.times, axis=0)
        needed = limits.torque.whole(knots.positions, knots.velocities, rates)
        return (
            clearances(self._scene.sweep, times, self._whole(way), self._cancelled),
            limit_margins(joints, times, way, self._lower, self._upper),
            torque_shares(joints, knots.times, needed, torque),
        )

    def _met(self, goals: Sequence[Constraint], knots: Knots) -> tuple[Measure, ...]:
        """How well goals are met at the last knot: by how much the worst of them is missed, in m and in rad."""
        missed = self._planner.solver.checker.measures(goals, self._whole(knots.positions[-1:])[0])
        units = {RESIDUAL: "m", TILT: "rad"}
        end = knots.times[-1:]
        found = {name: [m.by for m in missed if m.unit == unit] for name, unit in units.items()}
        return tuple(Measure(name, end, np.array([max(by)])) for name, by in found.items() if by)

    def _watched(self, way: Array) -> float:
        """s that a way takes at least: so that people can watch the tool, and balance on feet is a matter of where one is."""
        motion, planner = self._motion, self._planner
        slow = [(planner.tip_of(motion.arm), TIP_SPEED)] if motion.arm else []
        slow += [(planner.base_frame, _BASE_SPEED)] if motion.closed else []
        rows = self._whole(way[:: max(1, len(way) // 20)])
        seconds = [0.0]
        for frame, speed in slow:
            places = np.array([self._frame(q, frame).translation for q in rows])
            seconds.append(float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum()) / speed)
        return max(seconds)

    def _stays(self, follow: Follow, segment: Segment) -> None:
        """Raise Infeasible where the frame leaves the way that the joint leads it on, also between what was solved for."""
        start = self._frame(self._start, follow.frame)
        off = [follow.missed(start, self._frame(q, follow.frame)) for q in self._whole(segment.positions)]
        if max(off) > BETWEEN * LENGTH:
            where = f"{segment.times[int(np.argmax(off))]:.3g} s"
            raise Infeasible(f"along {follow.asked.joint} ({follow.frame})", max(off), "m", segment.name, f"at {where}")

    def _passes(self, segment: Segment) -> tuple[float, ...]:
        """s at which a segment comes by every key frame, in their order. Raises Infeasible unless it is within PASSED then."""
        times = looks(segment.times, segment.positions)
        q = self._whole(hermite(segment.times, segment.positions, segment.velocities, times))
        first, passed = 0, list[float]()
        for number, goals in enumerate(self._motion.through):
            missed = [self._planner.solver.checker.measures(goals, one) for one in q[first:]]
            sizes = [max((m.size for m in measures), default=0.0) for measures in missed]
            best = int(np.argmin(sizes))
            if sizes[best] > PASSED:
                worst = max(missed[best], key=lambda m: m.size)
                words = f"({worst.what}) is {worst.value:.3g} {worst.unit}"
                raise Infeasible(worst.constraint, worst.by, worst.unit, f"through[{number}]", words)
            first += best
            passed.append(float(times[first]))
        return tuple(passed)


def _too_near(nearest: Nearest, floor: float, where: str) -> Infeasible:
    words = f"({nearest.between}) is {nearest.distance:.3g} m, at least {floor:g} allowed"
    return Infeasible("clearance", max(floor - nearest.distance, 0.0), "m", where, words)
