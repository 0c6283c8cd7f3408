"""Whether a whole timed plan, stroke or motion, keeps what it must: looked at ten times as densely as its knots, before it may be
returned.

Shares nothing with planners but the robot's model, its bodies, and by what rule feet share a load: curves are evaluated in
their power basis, bodies that come too near are found by coal's broad phase with a security margin, constraints are measured by
`ik.checker`, torques by pinocchio's inverse dynamics, of a robot on its feet under the forces that its momentum asks for, which the
ground must be able to give. A
mistake in a path, a spline, a profile or a certificate shows here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from engines.planning.collision.broad_phase import BroadPhase
from engines.planning.collision.margins import Margins
from engines.planning.collision.world import World
from engines.planning.ik.checker import ANGLE, LENGTH, Checker
from engines.planning.ik.constraints import Constraint
from engines.planning.ik.report import Measure
from engines.planning.plan import Infeasible
from engines.planning.timing.contact_forces import borne, figures
from engines.planning.timing.timing import Limits
from engines.planning.waiting import go_on, never
from handrail.robot.description import Foot

Array = NDArray[np.float64]
Names = tuple[tuple[str, str], ...]

DENSITY = 10
"""looks at each stretch between knots"""
NEAR = 1e-3
"""m, by what a clearance may be missed if nothing else is said"""
BETWEEN = 20.0
"""times as much as at an instant (0.1 mm, 1 mrad) a constraint may be missed by that holds for longer"""
_SHARE = 1e-3
"""of a limit on velocity, acceleration or torque, by what it may be passed"""
MOVED = 0.005
"""rad (m): bodies and constraints are not looked at anew before some joint has moved by this since the last look"""
_OUT = 1e-4
"""rad (m), by what a joint's limit may be passed"""
_GROUND = 1e-4
"""N, N/N, m by what feet may pass what the ground can give: forces at a limit are on it"""
_SAME = 1e-6
"""rad/s² between two pieces: torques at their knot are the same"""
_REST, _GAP = 1e-6, 1e-6
"""rad/s at both ends of a segment, rad between segments"""


class Stretch(Protocol):
    """A segment: cubic Hermite pieces between knots, as `plan.Segment`."""

    @property
    def name(self) -> str: ...
    @property
    def times(self) -> Array: ...
    @property
    def positions(self) -> Array: ...
    @property
    def velocities(self) -> Array: ...


class Motion(Protocol):
    """What can be verified, as `plan.Plan`: segments that follow each other."""

    @property
    def joints(self) -> tuple[str, ...]: ...
    @property
    def start(self) -> Array: ...
    @property
    def segments(self) -> Sequence[Stretch]: ...


@dataclass(frozen=True)
class Violation:
    """A figure that is out of bounds, where it is worst."""

    segment: str
    time: float
    """s from the segment's beginning"""
    measure: Measure

    def __str__(self) -> str:
        return f"{self.segment}, {self.time:.3g} s: {self.measure}"

    def error(self) -> Infeasible:
        """As planners fail."""
        m = self.measure
        words = f"({m.what}) is {m.value:.3g} {m.unit} at {self.time:.3g} s, {m.bound} allowed"
        return Infeasible(m.constraint, m.by, m.unit, self.segment, words)


@dataclass(frozen=True)
class _Looks:
    """A segment seen at many times: (k,) s, (k, m) rad, rad/s, rad/s²."""

    times: Array
    positions: Array
    velocities: Array
    accelerations: Array


class Verifier:
    """Verifies plans in one world; keeps its memory. Not for several threads at once."""

    def __init__(self, world: World, *, margins: Margins | None = None, near: float = NEAR):
        """`margins` of clearance (None: the defaults), which may be missed by `near` m."""
        self._world, self._mechanism, self._missed = world, world.mechanism, near
        self._model = world.mechanism.model
        self._data, self._scratch = self._model.createData(), world.geometry.createData()
        self._floors = (margins or Margins()).floors(world)
        self._broad = BroadPhase(world, self._floors - near)
        self._checker = Checker(world.mechanism)

    def forget(self) -> None:
        """As if it had not verified anything yet."""
        self._broad.forget()
        self._world.forget(self._scratch)

    def violations(
        self, plan: Motion, limits: Limits, at: Array, *, constraints: Sequence[Constraint] = (),
        touching: Mapping[str, Names] | None = None, torque: Array | None = None,
        feet: Sequence[Foot] = (), cancelled: Callable[[], bool] | None = None,
    ) -> list[Violation]:  # fmt: skip
        """All that a plan misses, each figure once, at the time when it is worst; by segments, the worst of each kind first.

        :param limits: of the plan's joints, (m,) each
        :param at: (nq,) of the world's mechanism, where joints that the plan does not move stand
        :param constraints: in their windows, s from the plan's beginning
        :param touching: segment → pairs of names (wildcards) that may touch in it, besides those that the world allows
        :param torque: (m,) N·m that the plan's joints have against gravity and inertia; None: not looked at
        :param feet: that a robot stands on, whose mechanism is seen from the first one's sole; none: what stands still bears all
        :param cancelled: asked often; Cancelled is raised soon after it says True
        :raises ValueError: joints that the mechanism does not have, arrays of wrong shapes
        """
        going = cancelled or never
        at = self._mechanism.check_configuration("at", at)
        rows = [self._mechanism.row(joint) for joint in plan.joints]
        found = list(self._joined(plan))
        if found:
            return found
        begin = 0.0
        for segment in plan.segments:
            looks = _looks(segment)
            found += _worst(segment.name, self._of_joints(plan.joints, rows, looks, limits))
            wanted = _apart(looks.positions)
            times = looks.times[wanted]
            q = np.repeat(at[None], len(times), axis=0)
            q[:, self._mechanism.coordinate[rows]] = looks.positions[wanted]
            floors = self._floors.copy()
            if names := (touching or {}).get(segment.name):
                floors[self._world.touching(*names)] = -np.inf
            found += _worst(segment.name, self._of_bodies(times, q, floors, going))
            if torque is not None:
                found += _worst(segment.name, self._of_dynamics(plan.joints, rows, looks, at, torque, feet))
            if constraints:
                found += _worst(segment.name, self._of_constraints(constraints, begin, times, q, going))
            begin += float(segment.times[-1])
        return found

    def loads(self, plan: Motion, at: Array, torque: Array, feet: Sequence[Foot]) -> list[Violation]:
        """What a plan misses of its joints' torques and of what the ground can bear alone, as `violations` tells it."""
        rows = [self._mechanism.row(joint) for joint in plan.joints]
        found = list(self._joined(plan))
        for segment in () if found else plan.segments:
            found += _worst(segment.name, self._of_dynamics(plan.joints, rows, _looks(segment), at, torque, feet))
        return found

    def _joined(self, plan: Motion) -> Iterator[Violation]:
        """What is wrong with the arrays themselves: nothing else can be said then."""
        before, width = np.asarray(plan.start, dtype=float), len(plan.joints)
        for segment in plan.segments:
            shape = (len(segment.times), width)
            if segment.positions.shape != shape or segment.velocities.shape != shape or shape[0] < 2:
                raise ValueError(
                    f"{segment.name}: got positions {segment.positions.shape}, velocities {segment.velocities.shape}; "
                    f"expected {shape}, two rows or more"
                )
            arrays = {"times": segment.times, "positions": segment.positions, "velocities": segment.velocities}
            for name, values in arrays.items():
                if not np.isfinite(values).all():
                    yield Violation(segment.name, 0.0, Measure("finite numbers", name, np.nan, -np.inf, np.inf, ""))
                    return
            steps = np.diff(segment.times)
            if segment.times[0] != 0.0 or not (steps > 0.0).all():
                yield Violation(
                    segment.name, 0.0, Measure("times increase from 0", "step", float(steps.min()), 0.0, np.inf, "s")
                )
                return
            gap = np.abs(segment.positions[0] - before)
            if (worst := float(gap.max())) > _GAP:
                what = plan.joints[int(gap.argmax())]
                yield Violation(segment.name, 0.0, Measure("begins where it is", what, worst, 0.0, 0.0, "rad"))
            for row, when in ((0, 0.0), (-1, float(segment.times[-1]))):
                rate = np.abs(segment.velocities[row])
                if (worst := float(rate.max())) > _REST:
                    what = plan.joints[int(rate.argmax())]
                    yield Violation(segment.name, when, Measure("rest at both ends", what, worst, 0.0, 0.0, "rad/s"))
            before = segment.positions[-1]

    def _of_joints(
        self, joints: tuple[str, ...], rows: list[int], looks: _Looks, limits: Limits
    ) -> Iterator[tuple[float, Measure, float]]:
        """(s, figure, by how much it may be out) of positions, velocities and accelerations."""
        for column, (joint, row) in enumerate(zip(joints, rows, strict=True)):
            unit = self._mechanism.unit_of(row)
            low, high = float(self._mechanism.lower[row]), float(self._mechanism.upper[row])
            for look in (int(looks.positions[:, column].argmin()), int(looks.positions[:, column].argmax())):
                value = float(looks.positions[look, column])
                yield float(looks.times[look]), Measure("joint limits", joint, value, low, high, unit), _OUT
            for name, values, bound, rate in (
                ("velocity limits", looks.velocities, limits.velocity, "/s"),
                ("acceleration limits", looks.accelerations, limits.acceleration, "/s²"),
            ):
                look, most = int(np.abs(values[:, column]).argmax()), float(bound[column])
                measure = Measure(name, joint, float(values[look, column]), -most, most, unit + rate)
                yield float(looks.times[look]), measure, _SHARE * most

    def _of_bodies(
        self, times: Array, q: Array, floors: Array, cancelled: Callable[[], bool]
    ) -> Iterator[tuple[float, Measure, float]]:
        world, scratch = self._world, self._scratch
        self._broad.only(floors > -np.inf)
        for time, configuration in zip(times.tolist(), q, strict=True):
            go_on(cancelled)
            if not self._broad.met(configuration):
                continue
            pin.computeDistances(self._model, self._data, world.geometry, scratch, configuration)
            for pair, (found, floor) in enumerate(zip(scratch.distanceResults, floors.tolist(), strict=True)):
                if found.min_distance < floor - self._missed:
                    distance = float(found.min_distance)
                    yield time, Measure("clearance", world.between(pair), distance, floor, np.inf, "m"), self._missed

    def _of_dynamics(
        self, joints: tuple[str, ...], rows: list[int], looks: _Looks, at: Array, torque: Array,
        feet: Sequence[Foot],
    ) -> Iterator[tuple[float, Measure, float]]:  # fmt: skip
        """At both ends and in the middle of each piece, over which accelerations are linear."""
        q, v, a = at.copy(), np.zeros(self._model.nv), np.zeros(self._model.nv)
        pieces = np.arange(len(looks.times)).reshape(-1, DENSITY + 1)
        ends, begins = pieces[:, DENSITY], pieces[1:, 0]
        jumps = np.abs(looks.accelerations[begins] - looks.accelerations[ends[:-1]]).max(axis=1) > _SAME
        seen = np.concatenate([pieces[:, 0], pieces[:, DENSITY // 2], ends[np.append(jumps, True)]])
        needed, bears = np.empty((len(seen), len(rows))), list[list[pin.Force]]()
        columns = self._mechanism.coordinate[rows]
        for row, k in enumerate(seen.tolist()):
            q[columns], v[rows], a[rows] = looks.positions[k], looks.velocities[k], looks.accelerations[k]
            torques, forces = self._inverse_dynamics(q, v, a, feet)
            needed[row] = torques[rows]
            bears.append(forces)
        for column, joint in enumerate(joints):
            look, most = int(np.abs(needed[:, column]).argmax()), float(torque[column])
            measure = Measure("torque limits", joint, float(needed[look, column]), -most, most, "N·m")
            yield float(looks.times[seen[look]]), measure, _SHARE * most
        for k, forces in zip(seen.tolist(), bears, strict=True):
            for measure in figures(feet, forces):
                yield float(looks.times[k]), measure, _GROUND

    def _inverse_dynamics(self, q: Array, v: Array, a: Array, feet: Sequence[Foot]) -> tuple[Array, list[pin.Force]]:
        """(nv,) N·m, by what the momentum's change asks of the ground, and that as forces on the feet, on their own axes."""
        model, data = self._model, self._data
        if not feet:
            return np.asarray(pin.rnea(model, data, q, v, a)), []
        pin.computeCentroidalMomentumTimeVariation(model, data, q, v, a)
        pin.updateFramePlacements(model, data)
        change = pin.SE3(np.eye(3), data.com[0]).act(data.dhg)
        held, weight = model.inertias[0], -model.gravity.linear
        whole = change.vector.copy()
        for mass, place in ((data.mass[0], data.com[0]), (held.mass, held.lever)):
            whole += np.concatenate([mass * weight, np.cross(place, mass * weight)])
        frames = [model.frames[self._mechanism.frame_id(foot.link)] for foot in feet]
        soles = [pin.SE3(data.oMi[each.parentJoint] * each.placement) for each in frames]
        forces = borne(feet, soles, pin.Force(whole))
        outside = pin.StdVec_Force()
        outside.extend([pin.Force.Zero() for _ in range(model.njoints)])
        for each, force in zip(frames[1:], forces[1:], strict=True):
            outside[each.parentJoint] += each.placement.act(force)
        return np.asarray(pin.rnea(model, data, q, v, a, outside)), forces

    def _of_constraints(
        self, constraints: Sequence[Constraint], begin: float, times: Array, q: Array, cancelled: Callable[[], bool]
    ) -> Iterator[tuple[float, Measure, float]]:
        for time, configuration in zip(times.tolist(), q, strict=True):
            now = [c for c in constraints if c.window[0] - 1e-9 <= begin + time <= c.window[1] + 1e-9]
            if now:
                go_on(cancelled)
            for constraint in now:
                loose = BETWEEN if constraint.window[1] > constraint.window[0] else 1.0
                for measure in self._checker.measures([constraint], configuration):
                    yield time, measure, loose * (ANGLE if measure.unit == "rad" else LENGTH)


def _looks(segment: Stretch) -> _Looks:
    h = np.diff(segment.times)[:, None, None]
    p, v = segment.positions, segment.velocities
    p0, p1, v0, v1 = (rows[:, None, :] for rows in (p[:-1], p[1:], v[:-1], v[1:]))
    slope = (p1 - p0) / h
    square, cube = (3.0 * slope - 2.0 * v0 - v1) / h, (v0 + v1 - 2.0 * slope) / h**2
    t = np.linspace(0.0, 1.0, DENSITY + 1)[None, :, None] * h
    width = p.shape[1]
    return _Looks(
        (segment.times[:-1, None] + t[:, :, 0]).reshape(-1),
        (p0 + t * (v0 + t * (square + t * cube))).reshape(-1, width),
        (v0 + t * (2.0 * square + 3.0 * t * cube)).reshape(-1, width),
        (2.0 * square + 6.0 * t * cube).reshape(-1, width),
    )


def _apart(positions: Array) -> NDArray[np.intp]:
    """Rows about MOVED from one another as the joint that moves most goes, however slowly; both ends."""
    steps = np.cumsum(np.abs(np.diff(positions, axis=0)).max(axis=1, initial=0.0))
    wanted = np.searchsorted(steps, np.arange(1, int(steps[-1] / MOVED) + 1) * MOVED, side="right")
    return np.unique(np.concatenate([[0], wanted, [len(positions) - 1]]))


def _worst(segment: str, measured: Iterator[tuple[float, Measure, float]]) -> list[Violation]:
    """Of each figure that is out by more than it may the worst, the worst first."""
    kept: dict[tuple[str, str], Violation] = {}
    for time, measure, allowed in measured:
        key = (measure.constraint, measure.what)
        if not measure.by <= allowed and (key not in kept or measure.by > kept[key].measure.by):
            kept[key] = Violation(segment, time, measure)
    return sorted(kept.values(), key=lambda one: -one.measure.by)
