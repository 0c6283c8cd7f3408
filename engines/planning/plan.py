"""A plan: timed joint trajectories with the versions of all that they were made from, and why there is none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from handrail.messages import EndCondition, JointTrajectory, PathForce, PlanPreview, PlanSegment

Array = NDArray[np.float64]

START_TOLERANCE = 0.02
"""rad: a plan whose start is further from the robot's command than this in any joint is stale"""


class Infeasible(Exception):
    """There is no plan: `constraint` is missed by `by`, in `unit`. `where` says at which part of the way, `detail` what it is."""

    def __init__(self, constraint: str, by: float, unit: str, where: str = "", detail: str = ""):
        self.constraint, self.by, self.unit, self.where, self.detail = constraint, by, unit, where, detail
        place = f"{where}: " if where else ""
        super().__init__(f"{place}{constraint} {f'{detail}, ' if detail else ''}missed by {by:.3g} {unit}")


class Cancelled(Exception):
    """Planning was told to stop."""


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

    @property
    def duration(self) -> float:
        """s, of all segments"""
        return sum(segment.duration for segment in self.segments)

    def segment(self, name: str) -> Segment:
        """The segment of that name. Raises KeyError naming what there is."""
        for segment in self.segments:
            if segment.name == name:
                return segment
        raise KeyError(f"{name}: plan {self.id} has {', '.join(s.name for s in self.segments)}")

    def stale(self, versions: Mapping[str, int], command: Array | None) -> str:
        """Why the plan may no longer be executed, in words; empty while it may.

        `versions`: instance → version as it stands now; `command` (m,) rad: where the plan's joints are commanded now, None to
        leave the start out (a plan under way has left it).
        """
        for name, version in self.made_from.items():
            if name not in versions:
                return f"{name} was removed after the plan was made"
            if versions[name] != version:
                return f"{name} was changed after the plan was made (version {version}, now {versions[name]})"
        if command is not None:
            off = np.abs(np.asarray(command) - self.start)
            worst = int(off.argmax())
            if not off[worst] <= START_TOLERANCE:  # NaN is stale too
                return (
                    f"the robot is not where the plan starts: {self.joints[worst]} is {off[worst]:.3f} rad off, "
                    f"allowed {START_TOLERANCE:g}; plan anew"
                )
        return ""

    def preview(self, fresh: bool, why: str = "") -> PlanPreview:
        """What clients draw as a ghost: a knot every tenth of a second is plenty for the eye."""
        return PlanPreview(
            id=self.id,
            label=self.label,
            joints=list(self.joints),
            segments=[_thinned(segment) for segment in self.segments],
            made_from=dict(self.made_from),
            fresh=fresh,
            stale_because=why,
            clearance=self.clearance,
            limit_margin=self.limit_margin,
            duration=self.duration,
        )


def _thinned(segment: Segment) -> PlanSegment:
    wanted = np.arange(0.0, segment.duration, 0.1)
    rows = np.unique(np.append(np.searchsorted(segment.times, wanted), len(segment.times) - 1))
    return PlanSegment(
        name=segment.name,
        times=np.round(segment.times[rows], 4).tolist(),
        positions=np.round(segment.positions[rows], 4).tolist(),
    )
