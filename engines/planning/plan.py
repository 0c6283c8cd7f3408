"""A plan: timed joint trajectories with the versions of all that they were made from, and why there is none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from engines.planning.measures import CLEARANCE, LIMIT_MARGIN, RESIDUAL, TILT, TORQUE_SHARE, Measure, joined
from handrail.messages import (
    ContactEnd,
    EndCondition,
    ForceEnd,
    FrameKnots,
    JointTrajectory,
    PathForce,
    PlanGave,
    PlanPreview,
    PlanSegment,
    PlanWaypoint,
    PlanWorst,
    Pose,
    PostureKnots,
    StaleCause,
    WholeBody,
)

Array = NDArray[np.float64]

_FELT = (ForceEnd, ContactEnd)
GHOST_TOLERANCE = 0.005
"""rad between the motion and straight lines through the knots that clients get"""


class Infeasible(Exception):
    """There is no plan: `constraint` is missed by `by`, in `unit`. `where` says at which part of the way, `detail` what it is."""

    def __init__(self, constraint: str, by: float, unit: str, where: str = "", detail: str = ""):
        self.constraint, self.by, self.unit, self.where, self.detail = constraint, by, unit, where, detail
        place = f"{where}: " if where else ""
        super().__init__(f"{place}{constraint} {f'{detail}, ' if detail else ''}missed by {by:.3g} {unit}")


@dataclass(frozen=True)
class BaseWay:
    """Where a base is in the world at every knot of a segment that moves it; it does not turn."""

    positions: Array
    """(k, 3) m"""
    velocities: Array
    """(k, 3) m/s, zero in the first and the last row"""


@dataclass(frozen=True)
class Segment:
    """One stretch of a plan, executed as one action. It begins and ends at rest."""

    name: str
    times: Array
    """(k,) s, from 0, strictly increasing"""
    positions: Array
    """(k, m) rad"""
    velocities: Array
    """(k, m) rad/s, zero in the first and the last row"""
    ends: tuple[EndCondition, ...] = ()
    path_force: PathForce | None = None
    measures: tuple[Measure, ...] = ()
    """what was measured along it, times from its start"""
    base: BaseWay | None = None
    """of a robot that stands and moves its legs; None: its base stays where it is"""

    @property
    def duration(self) -> float:
        """s"""
        return float(self.times[-1])

    def motion(self, joints: tuple[str, ...]) -> JointTrajectory:
        """The segment as the daemon takes it."""
        return JointTrajectory(
            joints=list(joints),
            times=self.times.tolist(),
            positions=self.positions.tolist(),
            velocities=self.velocities.tolist(),
            path_force=self.path_force,
        )

    def under(self, compound: str, joints: tuple[str, ...], base: BaseWay) -> WholeBody:
        """The same for a robot that stands: the compound task's `posture` follows the knots, its `height` the base's.

        The posture alone would not: where so much mass moves, the last level of whole-body control gives way.
        """
        knots = PostureKnots(
            task="posture",
            joints=list(joints),
            times=self.times.tolist(),
            positions=self.positions.tolist(),
            velocities=self.velocities.tolist(),
        )
        height = FrameKnots(
            task="height",
            times=self.times.tolist(),
            positions=[(x, y, z) for x, y, z in base.positions.tolist()],
            velocities=[(x, y, z) for x, y, z in base.velocities.tolist()],
        )
        return WholeBody(compound=compound, references=[knots, height])


@dataclass(frozen=True)
class Plan:
    """Segments that follow each other without a gap, for the joints of one arm."""

    id: str
    label: str
    arm: str
    joints: tuple[str, ...]
    """m joints, the columns of everything below"""
    segments: tuple[Segment, ...]
    made_from: Mapping[str, int]
    """instance → version"""
    start: Array
    """(m,) rad, where the robot must be commanded to be"""
    clearance: float
    """m, the smallest along the plan: from the object (the tool left out where it may touch) and of the robot from itself"""
    limit_margin: float
    """rad, the smallest distance to a joint's limit"""
    outputs: Mapping[str, float] = field(default_factory=dict)
    """entry_angle, end_angle, arc_centre in rad about the template's joint"""
    key_times: tuple[float, ...] = ()
    """s, when a motion's key frames are passed, in their order"""
    compound: str = ""
    """of a robot that stands and moves its legs: the compound task (docs/wbc.md) under which it follows the plan"""
    base_at_end: Pose | None = None
    """of such a plan: in the world; None: the base stays where it is"""
    gave: tuple[PlanGave, ...] = ()
    """what was not kept, of what may give way"""

    @property
    def duration(self) -> float:
        """s, of all segments"""
        return sum(segment.duration for segment in self.segments)

    def motion(self, segment: Segment) -> JointTrajectory | WholeBody:
        """One of its segments as the daemon takes it."""
        if segment.base is None:
            return segment.motion(self.joints)
        return segment.under(self.compound, self.joints, segment.base)

    def segment(self, name: str) -> Segment:
        """The segment of that name. Raises KeyError naming what there is."""
        for segment in self.segments:
            if segment.name == name:
                return segment
        raise KeyError(f"{name}: plan {self.id} has {', '.join(s.name for s in self.segments)}")

    @property
    def starts(self) -> list[float]:
        """s at which each segment begins"""
        return [0.0, *np.cumsum([segment.duration for segment in self.segments])[:-1].tolist()]

    @cached_property
    def measures(self) -> dict[str, Measure]:
        """name (see `measures`) → what was measured along the plan, times from its start"""
        return joined((segment.measures for segment in self.segments), self.starts)

    @cached_property
    def waypoints(self) -> list[PlanWaypoint]:
        """One a segment and one a key frame that is passed on it: what the way to it keeps at its worst, and how well it is met."""
        found = []
        for segment, start in zip(self.segments, self.starts, strict=True):
            passed = [
                (f"key frame {number}", time - start)
                for number, time in enumerate(self.key_times)
                if start + 1e-6 < time < start + segment.duration - 1e-6
            ]
            begin = 0.0
            for name, end in (*passed, (segment.name, segment.duration)):
                found.append(_waypoint(segment, start, name, begin, end))
                begin = end
        return found

    @cached_property
    def _ghost(self) -> list[PlanSegment]:
        return [_thinned(segment) for segment in self.segments]

    def preview(
        self, fresh: bool, why: str = "", causes: Sequence[StaleCause] = (), *, ghost: bool = True
    ) -> PlanPreview:
        """What clients see of it; the ghost with as few knots as the eye needs, or left out."""
        return PlanPreview(
            id=self.id,
            label=self.label,
            joints=list(self.joints),
            segments=self._ghost if ghost else [],
            made_from=dict(self.made_from),
            fresh=fresh,
            stale_because=why,
            stale_causes=list(causes),
            clearance=self.clearance,
            limit_margin=self.limit_margin,
            duration=self.duration,
            arm=self.arm,
            waypoints=self.waypoints,
            key_times=[round(time, 3) for time in self.key_times],
            gave=list(self.gave),
        )


def _waypoint(segment: Segment, start: float, name: str, begin: float, end: float) -> PlanWaypoint:
    """Of the part of a segment from `begin` to `end` s after its own start, at `start` s of the plan."""
    measures = {measure.name: measure.within(begin, end) for measure in segment.measures}

    def worst(name: str) -> PlanWorst | None:
        measure = measures.get(name)
        if measure is None:
            return None
        found = measure.worst()
        if not np.isfinite(found.value):  # nothing was near at all
            return None
        return PlanWorst(value=round(found.value, 4), time=round(start + found.time, 3), about=found.about)

    def met(name: str) -> float | None:
        measure = measures.get(name)
        at_end = measure is not None and measure.times[-1] >= end - 1e-6
        return round(float(measure.values[-1]), 5) if measure is not None and at_end else None

    return PlanWaypoint(
        name=name,
        time=round(start + end, 3),
        residual=met(RESIDUAL),
        tilt=met(TILT),
        clearance=worst(CLEARANCE),
        limit_margin=worst(LIMIT_MARGIN),
        torque_share=worst(TORQUE_SHARE),
        force_limit=_force_limit(segment),
    )


def _force_limit(segment: Segment) -> float | None:
    """N, that a segment presses with at most, by what ends it or by what it applies; None: neither is said."""
    ends = [end.limit if isinstance(end, ForceEnd) else end.threshold for end in segment.ends if isinstance(end, _FELT)]
    applied = [segment.path_force.limit] if segment.path_force is not None else []
    found = [*([min(ends)] if ends else []), *applied]
    return max(found) if found else None


def _thinned(segment: Segment) -> PlanSegment:
    rows = sorted(_needed(segment.times, segment.positions, 0, len(segment.times) - 1) | {0, len(segment.times) - 1})
    return PlanSegment(
        name=segment.name,
        times=np.round(segment.times[rows], 3).tolist(),
        positions=np.round(segment.positions[rows], 4).tolist(),
    )


def _needed(times: Array, positions: Array, first: int, last: int) -> set[int]:
    """Rows between two that straight lines need to stay within `GHOST_TOLERANCE` of all of them (Douglas and Peucker, in time)."""
    if last - first < 2:
        return set()
    share = ((times[first : last + 1] - times[first]) / (times[last] - times[first]))[:, None]
    straight = positions[first] + share * (positions[last] - positions[first])
    off = np.abs(positions[first : last + 1] - straight).max(axis=1)
    row = first + int(off.argmax())
    if off[row - first] <= GHOST_TOLERANCE:
        return set()
    return {row} | _needed(times, positions, first, row) | _needed(times, positions, row, last)
